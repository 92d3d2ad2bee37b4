"""Which sections a fictitious fluid describes, and which need particles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from granpipe.case.outline import Regime, Section, SectionModel
from granpipe.case.schema import Case
from granpipe.dem.sizes import size_classes
from granpipe.errors import KeyPath
from granpipe.geometry.outline import Outline
from granpipe.planning.jenike import hopper_regime

FLATTEST_HOPPER = math.radians(60)
"""Half-angle from the vertical beyond which a narrowing wall is a floor on which solids rest, whatever the case says of
it: Jenike's limit of mass flow on a smooth wall for 30° of internal friction, about the least of bulk solids."""

FUNNEL_REACH = 2.0
"""A funnel disturbs the flow above it up to this many vessel radii: straight pipes shorter than a diameter between
disturbances are not in plug flow."""


@dataclass(frozen=True)
class Floor:
    """A narrowing of the wall on which solids rest, between two levels [m]; or a hopper in funnel flow.

    Parameters
    ----------
    reach : level up to which it disturbs the flow [m]
    text : what it is, for messages
    key : of the case
    certain : a floor by its shape, whatever regime the case gives
    """

    z_top: float
    z_bottom: float
    reach: float
    text: str
    key: KeyPath
    certain: bool


@dataclass(frozen=True)
class SectionNeed:
    """By which model a section is computed.

    Parameters
    ----------
    model : what the case says, or else what the flow needs
    reason : why
    objection : why a fluid does not describe the section; empty where it does
    doubtful : the objection is a caution only
    floor : on which solids rest in the section; no fluid result is right there
    """

    model: SectionModel
    reason: str
    objection: str = ""
    doubtful: bool = False
    floor: Floor | None = None

    @property
    def dem(self) -> str:
        """Why the section is computed with particles; empty where it is not."""
        return self.reason if self.model == "dem" else ""


def section_needs(case: Case, outline: Outline) -> dict[str, SectionNeed]:
    """Section → by which model it is computed and why, from the top down.

    Ranges that no section covers are there too, named by their levels.

    Raises
    ------
    CaseError : the outline does not fit the sections
    """
    floors = [*_floors(case, outline), *_funnel_hoppers(case, outline)]
    found: dict[str, SectionNeed] = {}
    for name, section in section_ranges(case, outline).items():
        above = [other for other, need in found.items() if need.model == "dem"]
        found[name] = _need(case, outline, section, floors, above[-1] if above else "")
    return found


def section_ranges(case: Case, outline: Outline) -> dict[str, Section]:
    """The sections of the case and what they leave uncovered, from the top down."""
    levels = [outline.z_top, *(z for section in case.outline.sections.values() for z in section.z), outline.z_bottom]
    uncovered = [(high, low) for high, low in zip(levels[::2], levels[1::2], strict=True)]
    gaps = {
        f"between z = {high:g} and {low:g} m": Section(z=(high, low))
        for high, low in uncovered
        if high - low > outline.tolerance
    }
    return dict(sorted({**case.outline.sections, **gaps}.items(), key=lambda item: -item[1].z_top))


def _need(case: Case, outline: Outline, section: Section, floors: list[Floor], above: str) -> SectionNeed:
    objection, floor = _objection(outline, section, floors)
    doubtful = False
    fine = "straight: plug flow"
    half_angle = math.atan(max(_slopes(outline, section)))
    if not objection and above:
        objection, doubtful = f"it lies below section {above}, whose flow is not simple", True
    if not objection and half_angle > 0:
        regime, figures = _regime(case, section, half_angle)
        fine = f"{regime} hopper ({figures})"
        objection = "" if regime == "mass_flow" else fine
    if section.model is not None:
        return SectionNeed(section.model, "the case says so", objection, doubtful, floor)
    return SectionNeed("dem" if objection else "fluid", objection or fine, objection, doubtful, floor)


def _objection(outline: Outline, section: Section, floors: list[Floor]) -> tuple[str, Floor | None]:
    """Why a fluid does not describe a section, as far as its shape tells, and the floor in it."""
    floor = next((one for one in floors if _disturbs(one, outline, section)), None)
    certain = floor if floor is not None and floor.certain else None
    for obstacle, polygon in outline.obstacles.items():
        if polygon[:, 1].min() < section.z_top and polygon[:, 1].max() > section.z_bottom:
            return f"obstacle {obstacle} stands in it", certain
    if _widens(outline, section):
        return "it widens: a free surface forms", certain
    for obstacle, polygon in outline.obstacles.items():
        if abs(polygon[:, 1].max() - section.z_bottom) <= outline.tolerance:
            return f"solids rest on obstacle {obstacle} below it", certain
    if floor is not None:
        where = f"; they flow in a funnel up to z = {floor.reach:.4g} m"
        return f"solids rest on {floor.text}{where}", certain
    return "", None


def _disturbs(floor: Floor, outline: Outline, section: Section) -> bool:
    """Whether a floor lies in or below a section that its funnel reaches; a ledge at the inlet lies in the first."""
    at_inlet = min(floor.z_bottom, section.z_top) >= outline.z_top - outline.tolerance
    below = floor.z_bottom < section.z_top - outline.tolerance
    return (below or at_inlet) and floor.reach > section.z_bottom + outline.tolerance


def _levels(outline: Outline, section: Section) -> list[float]:
    return [section.z_top, *(float(z) for z in outline.levels if section.z_bottom < z < section.z_top)]


def _slopes(outline: Outline, section: Section) -> list[float]:
    """Outward slopes of all walls below the corners in a section."""
    return [float(half.wall_slope(z, "below")) for half in outline.halves for z in _levels(outline, section)]


def _widens(outline: Outline, section: Section) -> bool:
    ledge = any(
        half.wall_radius(z, "below") > half.wall_radius(z, "above") + outline.tolerance
        for half in outline.halves
        for z in _levels(outline, section)
    )
    return ledge or min(_slopes(outline, section)) < 0


def _regime(case: Case, section: Section, half_angle: float) -> tuple[Regime, str]:
    """How a hopper flows, and by what."""
    material, said = case.material, section.regime
    if case.outline.symmetry == "plane":
        return said or "undecided", "the case says so" if said else "outline.sections.….regime is not given"
    if material.internal_friction_angle is not None and material.wall_friction_angle is not None:
        computed, jenike = hopper_regime(half_angle, material.internal_friction_angle, material.wall_friction_angle)
        return said or computed, f"the case says so, Jenike {computed}: {jenike}" if said else jenike
    if said is None:
        return "undecided", "neither outline.sections.….regime nor the bulk friction angles are given"
    return said, "the case says so"


def _floors(case: Case, outline: Outline) -> Iterator[Floor]:
    """Narrowing ledges and nearly level parts of the wall.

    Those that together are narrower than the radius of the smallest particle hold none and are left out.
    """
    sides = ("wall",) if outline.measure.axial else ("right", "left")
    for half, side in zip(outline.halves, sides, strict=True):
        yield from _floors_of(case, half, side)


def _floors_of(case: Case, outline: Outline, side: str) -> Iterator[Floor]:
    """Those of the right wall; `side` is its key."""
    wall = [(float(r), float(z)) for r, z in outline.wall]
    level = [r1 < r0 and math.atan2(r0 - r1, z0 - z1) > FLATTEST_HOPPER for (r0, z0), (r1, z1) in pairwise(wall)]
    widths = [r0 - r1 for ((r0, _), (r1, _)), flat in zip(pairwise(wall), level, strict=True) if flat]
    if sum(widths) <= max(size_classes(case.material.size).smallest, outline.tolerance):
        return
    starts = [i for i, flat in enumerate(level) if flat and not (i and level[i - 1])]
    for start in starts:
        end = next((i for i in range(start, len(level)) if not level[i]), len(level))
        (r0, z0), (r1, z1) = wall[start], wall[end]
        where = f"at z = {z1:.4g} m" if z0 - z1 <= outline.tolerance else f"from z = {z0:.4g} to {z1:.4g} m"
        kind = "the ledge" if z0 - z1 <= outline.tolerance else "the floor"
        narrows = (
            f"the radius from {r0:.4g} to {r1:.4g} m"
            if side == "wall"
            else f"the vessel on the {side} by {r0 - r1:.4g} m"
        )
        text = f"{kind} {where}, which narrows {narrows}"
        yield Floor(z0, z1, _reach(outline, r0, z0), text, ("outline", side, end), certain=True)


def _funnel_hoppers(case: Case, outline: Outline) -> Iterator[Floor]:
    """Sections that are hoppers in funnel flow, by the case or by Jenike's formula."""
    for name, section in case.outline.sections.items():
        half_angle = math.atan(max(_slopes(outline, section)))
        if half_angle > 0 and _regime(case, section, half_angle)[0] == "funnel_flow":
            reach = _reach(outline, float(outline.wall_radius(section.z_top, "below")), section.z_top)
            text = f"the walls of the funnel-flow hopper {name} ({_regime(case, section, half_angle)[1]})"
            yield Floor(section.z_top, section.z_bottom, reach, text, ("outline", "sections", name), certain=False)


def _reach(outline: Outline, radius: float, z: float) -> float:
    """Level up to which a funnel below z disturbs the flow [m]: no further than the next widening above it."""
    if not outline.measure.axial:
        radius = 0.5 * (radius + float(outline.mirrored().wall_radius(z, "above")))
    widenings = [
        z1
        for half in outline.halves
        for (r0, _), (r1, z1) in pairwise(half.wall.tolist())
        if r1 > r0 and z1 >= z - outline.tolerance
    ]
    return float(min([z + FUNNEL_REACH * radius, *widenings]))
