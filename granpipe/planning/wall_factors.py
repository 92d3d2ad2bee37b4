"""Which wall factor the hoppers of a fluid have, what it follows from, and the error to be expected."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from granpipe.case.outline import Section
from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.errors import CaseError
from granpipe.fluid.wall_factor import wall_factor_law
from granpipe.geometry.outline import Outline


class WallFriction(NamedTuple):
    """Friction of particles on the wall, where it comes from, and whether the case says it."""

    value: float
    source: str
    given: bool


def wall_friction(case: Case) -> WallFriction:
    """The friction that the wall factor follows from: the contact law's, or the tangent of the bulk's angle."""
    contact = case.contact
    if "friction" in contact.wall.model_fields_set:
        return WallFriction(contact.wall.friction, "contact.wall.friction", True)
    if "friction" in contact.model_fields_set:
        return WallFriction(contact.wall.friction, "contact.friction", True)
    if (angle := case.material.wall_friction_angle) is not None:
        return WallFriction(math.tan(angle), "tan of material.wall_friction_angle", True)
    return WallFriction(contact.wall.friction, "assumed", False)


def wall_factor_decisions(case: Case, outline: Outline, sections: Mapping[str, Section]) -> Iterator[Decision]:
    """One decision for each of the sections that has a converging wall.

    Raises
    ------
    CaseError : a slab's is missing, for which there is no law
    """
    if case.fluid.walls == "slip":
        return
    law, friction = wall_factor_law(), wall_friction(case)
    for name, section in sections.items():
        angle = _half_angle(outline, section)
        if angle <= 0:
            continue
        label = f"wall factor {'of section ' * (name in case.outline.sections)}{name}"
        if not outline.measure.axial:
            yield _of_a_slab(name, label, section, angle)
            continue
        fitted = law.factor(angle, friction.value)
        factor = fitted if section.wall_factor is None else section.wall_factor
        error = law.expected_error(angle, friction.value, factor)
        wall = f"wall friction {friction.value:.3g} ({friction.source}), {math.degrees(angle):.1f}° from the vertical"
        source = "law fit to DEM" if section.wall_factor is None else f"the case says so; {fitted:.2g} by the law"
        notes = []
        if not friction.given:
            notes.append(f"contact.wall.friction is not given; {friction.value:.3g} is assumed")
        if not law.covers(angle):
            notes.append(f"no cone as flat as {math.degrees(angle):.0f}° was measured")
        yield Decision(
            label,
            f"{factor:.2g}",
            f"{source}; {wall}; expect an error of about {error:.0%} of the velocity there",
            warning="; ".join(notes),
        )


def sections_without_law(case: Case, outline: Outline, sections: Mapping[str, Section]) -> list[str]:
    """Those whose walls converge in a slab and have no wall factor: a fluid of them cannot be planned."""
    if outline.measure.axial or case.fluid.walls == "slip":
        return []
    return [name for name, one in sections.items() if one.wall_factor is None and _half_angle(outline, one) > 0]


def _half_angle(outline: Outline, section: Section) -> float:
    """Of the flattest of the converging walls of a section, from the vertical [rad]; 0 and less: none."""
    corners = [z for z in outline.levels if section.z_bottom < z < section.z_top]
    slopes = [half.wall_slope([section.z_top, *corners], "below").max() for half in outline.halves]
    return math.atan(max(slopes))


def _of_a_slab(name: str, label: str, section: Section, angle: float) -> Decision:
    tilt = f"{math.degrees(angle):.1f}° from the vertical"
    if section.wall_factor is None:
        raise CaseError(
            f"missing for the walls of section {name}, {tilt}; the law of wall factors was fit to cones, and there is "
            "none for a slab: give 1 for solids that slide like a plug, less for rough walls",
            ("outline", "sections", name, "wall_factor"),
        )
    criterion = f"the case says so; {tilt}, both walls alike; no law was fit to slabs, and the error is not known"
    return Decision(label, f"{section.wall_factor:.2g}", criterion)
