"""Between which walls enlarged particles are simulated, and where walls may not be set back."""

from __future__ import annotations

from typing import NamedTuple

from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.dem.sizes import size_classes
from granpipe.errors import CaseError
from granpipe.geometry.outline import Outline
from granpipe.geometry.set_back import WALLS_KEY, set_back

POSSIBLE_FIELDS = ("residence_time", "age")
"""What of homogenize.fields follows from the flow alone; the rest is summed over particles, some in the solid."""

SHARE = 0.5
"""Part of (k − 1) Sauter radii by which walls are set back.

With all of it, centres come as near to the walls as the material's, but the slow layer along a wall, which is k times
as thick, then lies in the drawn solid: flow is too fast there where it is too slow between walls as drawn
(docs/validation/set_back.md).
"""

MOST_COMPARED = 2.0
"""Coarse-grain factor up to which fields were compared with those of the material's own particles."""

UNKNOWN = (
    f"compared with the material's own particles for dem.coarse_grain_factor up to {MOST_COMPARED:g} only "
    "(docs/validation/set_back.md)"
)


class Walls(NamedTuple):
    """The vessel that particles see, and the choice that made it another one than that drawn."""

    outline: Outline
    decision: Decision | None


def walls_of(case: Case, outline: Outline) -> Walls:
    """The walls of a DEM run: as drawn, or set back by `SHARE` of (k − 1) times the material's Sauter radius.

    The Sauter radius, because a size has its share of what touches a wall by its surface; grid and wall mesh go by it,
    too.

    Raises
    ------
    CaseError : the case asks for what cannot be had between walls that are set back
    """
    factor = case.dem.coarse_grain_factor
    if case.dem.walls == "as_drawn" or factor == 1:
        return Walls(outline, None)
    distance = SHARE * (factor - 1) * size_classes(case.material.size).sauter_diameter / 2
    try:
        _check(case)
        found = set_back(outline, distance)
    except CaseError as error:
        if case.dem.walls == "set_back":
            raise
        return Walls(outline, Decision("walls", "as drawn", f"not set back: {error.message}"))
    criterion = (
        f"{SHARE:g} (k − 1) Sauter radii into the solid, with k = {factor:g}; the field is cut at the walls as drawn"
    )
    warning = "" if factor <= MOST_COMPARED else UNKNOWN
    return Walls(found, Decision("walls", f"back {distance:.3g} m", criterion, warning=warning))


def check_whole(case: Case) -> None:
    """CaseError where walls would be set back in a part of the vessel."""
    if case.dem.walls == "set_back":
        raise CaseError(
            "set_back is possible where particles fill the whole vessel, not in a hybrid: set model: dem, or leave it "
            "out",
            WALLS_KEY,
        )


def check_dumps(case: Case) -> None:
    """CaseError where dumps would be averaged between other walls than those that the case draws."""
    if case.dem.walls == "set_back":
        raise CaseError(
            "dumps are averaged between the walls that the case draws: draw those that the particles had, and leave it "
            "out",
            WALLS_KEY,
        )


def _check(case: Case) -> None:
    if case.outline.symmetry == "plane":
        raise CaseError("walls can be set back in bodies of revolution only: in a slab, leave it out", WALLS_KEY)
    if case.dem.outlet == "open":
        raise CaseError(
            "walls set back widen an open outlet, and its discharge with it: set dem.outlet: plate, or leave it out",
            WALLS_KEY,
        )
    if others := [name for name in case.homogenize.fields if name not in POSSIBLE_FIELDS]:
        raise CaseError(
            f"{others[0]} is summed over particles, and between walls set back some of them lie in the solid: leave it "
            "out, or set dem.walls: as_drawn",
            ("homogenize", "fields"),
        )
