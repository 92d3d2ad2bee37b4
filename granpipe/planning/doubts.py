"""What makes one doubt that a drawing says what its author meant: absurd sizes, sections with gaps between them."""

from __future__ import annotations

from collections.abc import Iterator

from granpipe.case.schema import Case
from granpipe.dem.gaps import LEAST_GAP
from granpipe.dem.sizes import simulated_classes, size_classes
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.planning.sections import section_ranges

LARGE_VESSEL = 50.0
"""Radius or height [m] from which coordinates without a unit are more likely millimetres."""

SMALL_VESSEL = 0.01
"""Height [m] below which metres that were read as millimetres are more likely."""

COHESIVE = 30e-6
"""Diameter [m] below which dry powders cohere. Source: Geldart's group C (1973), about 30 µm."""


def doubts(case: Case, outline: Outline) -> Iterator[str]:
    """Questions to the author of a case, as notes."""
    height = outline.z_top - outline.z_bottom
    size = f"the vessel is {height:.3g} m high and {outline.width:.3g} m wide"
    if (hint := unit_hint(case, outline)) or max(0.5 * outline.width, height) >= LARGE_VESSEL:
        yield f"{size}{hint or '; is outline.unit right?'}"
    largest = 2 * size_classes(case.material.size).largest
    if largest < COHESIVE:
        yield (
            f"material.size: particles of at most {largest:.3g} m hold together, and cohesion is not modelled; are the "
            "sizes right?"
        )
    for name, section in section_ranges(case, outline).items():
        if name not in case.outline.sections:
            yield f"no section covers z = {section.z_bottom:g} … {section.z_top:g} m; is a level of a section mistyped?"


def unit_hint(case: Case, outline: Outline) -> str:
    """A question where coordinates in mm may have been read as metres or the reverse; otherwise nothing."""
    if outline.z_top - outline.z_bottom < SMALL_VESSEL:
        return "; is outline.unit right?"
    if "unit" in case.outline.model_fields_set or max(0.5 * outline.width, abs(outline.z_top)) < LARGE_VESSEL:
        return ""
    return f"; the vessel is {outline.width:g} m wide: did you mean outline.unit: mm?"


def size_hint(case: Case, outline: Outline) -> str:
    """A question where the openings are too narrow for sizes that may have been diameters, not radii."""
    classes = simulated_classes(case)
    narrowest = min(opening.gap for opening in find_openings(outline)) / classes.d90
    if case.material.size.radius is None or not 0.5 * LEAST_GAP <= narrowest < LEAST_GAP:
        return ""
    return "; material.size gives radii: if these are diameters, write diameter"
