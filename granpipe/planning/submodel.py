"""Sub-models: the part of a vessel that needs DEM, cut out as a case of its own, in the z of its parent.

Sparta & Halvorsen (2017), their hybrid approach: the problematic sections are cut out, completed by a feeder and a
plate, and simulated alone. Here every sub-model is an ordinary case, so everything that makes a DEM run makes this one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from granpipe.case.outline import OutlineSpec, Point, Polygon, Section
from granpipe.case.schema import Case
from granpipe.errors import CaseError

Side = Literal["above", "below"]

WALLS = ("wall", "left", "right")
KINDS = ("symmetry", *WALLS, "depth", "front_and_back")
"""What an outline has beside obstacles and sections."""

SEAM_DIAMETERS = 5.0
"""Margin beyond a seam in particle diameters d90: entrance and plate order the particles near them."""

SEAM_DIAMETERS_OF_VESSEL = 0.5
"""Margin beyond a seam in hydraulic diameters of the vessel: what a flow between straight walls needs to become a plug.

What differs from a developed creeping flow dies away as exp(−4.46 z/R) in a pipe and as exp(−2.11 z/h) between walls
2 h apart (least eigenvalues of Stokes flow there), so that half of 2 R, or of 4 h, does the same for both."""


@dataclass(frozen=True)
class Span:
    """A run of neighbouring sections that need DEM, and the range that its sub-model covers [m].

    `top` and `bottom` bound the sections; `cut_top` and `cut_bottom` add the margins, where the vessel goes on.
    """

    sections: tuple[str, ...]
    top: float
    bottom: float
    cut_top: float
    cut_bottom: float

    @property
    def name(self) -> str:
        """What to call its sub-model: first and last section."""
        return "_".join(dict.fromkeys((self.sections[0], self.sections[-1])))

    def on_levels(self, levels: Sequence[float]) -> Span:
        """The same span, cut where a grid has levels [m], outwards."""
        return replace(
            self,
            cut_top=min(z for z in levels if z >= self.cut_top - 1e-9),
            cut_bottom=max(z for z in levels if z <= self.cut_bottom + 1e-9),
        )


def spans(case: Case, needs: dict[str, str], d90: float, diameter: Callable[[float, Side], float]) -> tuple[Span, ...]:
    """Merge neighbouring sections that need DEM and give each run its margins.

    Parameters
    ----------
    needs : section → why it needs DEM; empty where it does not
    d90 : particle diameter [m]
    diameter : hydraulic diameter [m] at a height, just "above" or "below" it
    """
    sections = case.outline.sections
    top, bottom = case.outline.right_wall[0][1], case.outline.right_wall[-1][1]
    runs: list[list[str]] = []
    previous = ""
    for name in sections:  # ordered from the top
        if needs[name]:
            if runs and previous == runs[-1][-1]:
                runs[-1].append(name)
            else:
                runs.append([name])
        previous = name
    found: list[Span] = []
    for run in runs:
        high, low = sections[run[0]].z_top, sections[run[-1]].z_bottom
        up = max(SEAM_DIAMETERS * d90, SEAM_DIAMETERS_OF_VESSEL * diameter(high, "above"))
        down = max(SEAM_DIAMETERS * d90, SEAM_DIAMETERS_OF_VESSEL * diameter(low, "below"))
        span = Span(tuple(run), high, low, min(top, high + up), max(bottom, low - down))
        if found and found[-1].cut_bottom < span.cut_top:  # the margins meet: one sub-model serves both
            last = found.pop()
            between = tuple(
                n for n, s in sections.items() if last.bottom >= s.z_top - 1e-9 and s.z_bottom >= high - 1e-9
            )
            span = Span((*last.sections, *between, *run), last.top, low, last.cut_top, span.cut_bottom)
        found.append(span)
    return tuple(found)


def sub_case(case: Case, span: Span) -> Case:
    """The case of a span alone: outline, obstacles and sections cut at its levels, everything else as in its parent.

    Raises
    ------
    CaseError : a cut passes through an obstacle
    """
    obstacles = {}
    for name, polygon in case.outline.obstacles.items():
        low, high = min(z for _, z in polygon), max(z for _, z in polygon)
        if low >= span.cut_bottom and high <= span.cut_top:
            obstacles[name] = polygon
        elif low < span.cut_top and high > span.cut_bottom:
            raise CaseError(
                f"the sub-model of section {span.name} ends at z = {span.cut_bottom:g} … {span.cut_top:g} m, inside "
                "this obstacle; let a section with model: dem reach past it",
                ("outline", "obstacles", name),
            )
    sections = {
        name: Section(
            **section.model_dump(exclude_unset=True, exclude={"model"})  # all of it is DEM now, whatever it was
            | {"z": (min(section.z_top, span.cut_top), max(section.z_bottom, span.cut_bottom))}
        )
        for name, section in case.outline.sections.items()
        if section.z_bottom < span.cut_top and section.z_top > span.cut_bottom
    }
    kept = {key: getattr(case.outline, key) for key in KINDS if key in case.outline.model_fields_set}
    walls = {key: _cut(value, span.cut_top, span.cut_bottom) for key, value in kept.items() if key in WALLS}
    outline = OutlineSpec(**kept | {"unit": "m", "obstacles": obstacles, "sections": sections} | walls)
    homogenize = case.homogenize.model_copy(update={"fields": ()})  # the whole vessel's field has no use for them
    return case.model_copy(
        update={
            "name": f"{case.name}-{span.name}",
            "outline": outline,
            "homogenize": homogenize,
            "model": "dem",
            "total_error": None,
        }
    )


def _cut(wall: Polygon, top: float, bottom: float) -> Polygon:
    """The part of a wall between two levels; at a ledge on the cut, the side that lies within."""
    inside = [point for point in wall if bottom < point[1] < top]
    return (_at(wall, top, "below"), *inside, _at(wall, bottom, "above"))


def _at(wall: Polygon, z: float, side: Side) -> Point:
    """The point of a wall at a level, on the segment that goes on above or below it."""
    for (r0, z0), (r1, z1) in pairwise(wall):
        if z0 > z1 and (z0 >= z > z1 if side == "below" else z0 > z >= z1):
            return r0 + (r1 - r0) * (z0 - z) / (z0 - z1), z
    raise ValueError(f"z = {z:g} m lies outside the wall")
