"""What kind of vessel a case describes, for errors that are known from vessels of the same kind."""

from __future__ import annotations

import math
from itertools import pairwise

from granpipe.case.schema import Case
from granpipe.dem.sizes import size_classes
from granpipe.fluid.friction_error import Kind, Scene
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.sections import FLATTEST_HOPPER, section_needs


def scene_of(case: Case, outline: Outline) -> Scene | None:
    """The vessel, its openings and friction as far as errors of a fluid depend on them; None for a slab.

    Raises
    ------
    CaseError : the outline does not fit the sections
    """
    if not outline.measure.axial:
        return None
    gap = min(opening.gap for opening in find_openings(outline))
    return Scene(
        kind=_kind(case, outline),
        half_angle=math.degrees(_half_angle(outline)),
        opening=gap / size_classes(case.material.size).sauter_diameter,
        internal=bulk_friction(case).internal,
        wall=bulk_friction(case).wall,
        open_outlet=case.dem.outlet == "open",
    )


def _kind(case: Case, outline: Outline) -> Kind:
    """By what is hardest to describe in it."""
    if any(need.floor is not None for need in section_needs(case, outline).values()):
        return "floor"
    widens = any(below[0] > above[0] + outline.tolerance for above, below in pairwise(outline.wall.tolist()))
    if widens or outline.obstacles:
        return "free surface"
    return "hopper" if _half_angle(outline) > 0 else "pipe"


def _half_angle(outline: Outline) -> float:
    """Of the flattest part of the wall that is no floor, from the vertical [rad]."""
    return max((angle for _, angle in outline.narrowing if angle <= FLATTEST_HOPPER), default=0.0)
