"""Keys of `outline`: walls, obstacles and sections, or the drawing that gives them; values in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from granpipe.case.units import UnitError, length_unit, tidy
from granpipe.case.values import File, Group, Identifier, Levels, OneOf, Points, Quantity, Short, refuse

Point = tuple[float, float]
Polygon = tuple[Point, ...]
Regime = Literal["mass_flow", "funnel_flow", "undecided"]
SectionModel = Literal["fluid", "dem"]
Symmetry = Literal["axis", "plane", "space"]
FrontAndBack = Literal["periodic", "walls"]
Up = Literal["x", "-x", "y", "-y", "z", "-z"]
SLAB = ("left", "right", "depth")
"""Keys of a slab."""

LEVEL_TOLERANCE = 1e-9  # m; levels nearer than this are one level

CURVE_PIECES, CURVE_PIECE, CURVE_TURN = 3, 0.1, math.radians(30)
"""Pieces that make a curve, at least; the height of each over that of the wall, and the turn to the next, at most."""

ROUNDING = 0.05
"""Height of a curve over that of the wall below which it is no section of its own."""


class Section(Group):
    """A part of the vessel between two levels."""

    short: ClassVar[str] = "z"

    z: Annotated[tuple[float, float], Levels()] = Field(
        description="Upper and lower level. Short form: the levels themselves, as in `a: [5.9, 4.9]`."
    )
    regime: Annotated[Regime | None, OneOf(Regime)] = Field(
        default=None,
        description="How the hopper flows (Jenike's terms), if you know it; overrides the formula. A wall "
        "more than 60° from the vertical is a floor all the same.",
    )
    wall_factor: Annotated[float | None, Quantity(at_least=0, at_most=1)] = Field(
        default=None,
        description="Wall speed as a part of the mean vertical speed at that level, for the fluid model. "
        "Unless given: 1 on straight walls, in hoppers by a law in wall friction and angle that was fit to DEM.",
    )
    model: Annotated[SectionModel | None, OneOf(SectionModel)] = Field(
        default=None,
        description="Model of this section; overrides the planner's choice.",
    )

    @property
    def z_top(self) -> float:
        """Upper level [m]."""
        return self.z[0]

    @property
    def z_bottom(self) -> float:
        """Lower level [m]."""
        return self.z[1]


class DrawingSpec(Group):
    """The drawing that gives wall and obstacles."""

    file: Annotated[str, File()] = Field(
        description="Drawing of the vessel's inside, in place of `wall` and `obstacles`: DXF, CSV, COMSOL's .mphtxt, "
        "STEP, BREP, STL or OBJ; relative to the folder of the case file. `granpipe outline FILE` shows what it holds."
    )
    axis: Annotated[float | None, Quantity()] = Field(
        default=None,
        description="Where the axis lies across the direction that points up, in the drawing's unit. Unless given, "
        "found: on a layer axis, by symmetry, or at 0.",
    )
    up: Annotated[Up | None, OneOf(Up)] = Field(
        default=None, description="Direction of the drawing that points up. Unless given: y in a plane, found in 3-D."
    )
    tolerance: Annotated[float | None, Quantity(above=0)] = Field(
        default=None,
        description="How far a curve may lie off the straight lines that stand for it, in the drawing's unit. Unless "
        "given: 1e-4 of the drawing's size.",
    )
    unit: Annotated[str | None, Identifier()] = None


DRAWING_KEYS = DrawingSpec.model_fields.keys() - {"unit"}
"""Keys of `outline` that belong to a drawing; none is left in a resolved case."""


class OutlineSpec(Group):
    """The vessel's inside: half of its section through the axis, or the section of a slab."""

    unit: Annotated[str, Identifier()] = Field(
        default="m", description="Unit of every coordinate of the outline: m, cm, mm, ft, …."
    )
    symmetry: Annotated[Symmetry, OneOf(Symmetry)] = Field(
        default="axis",
        description="`axis`: a body of revolution, given by `wall`. `plane`: a slab between two walls that are alike "
        "all along y, as a hopper with a slot, given by `left`, `right` and `depth`; it is computed by particles, as a "
        "fluid or as a hybrid, or averaged from your own dumps. `space` is what granpipe writes "
        "beside a `vessel`, which gives the walls then.",
    )
    wall: Annotated[Polygon | None, Points(at_least=2)] = Field(
        default=None,
        description="Points [r, z] of the inner wall from the inlet (top) down to the outlet; two points at one level "
        "make a ledge. Nothing overhangs: z never rises. Needed with `symmetry: axis`.",
    )
    left: Annotated[Polygon | None, Points(at_least=2)] = Field(
        default=None,
        description="Points [x, z] of the left wall of a slab, from the top down as `wall`. The two walls begin at one "
        "height and end at one height; they need not be mirror images.",
    )
    right: Annotated[Polygon | None, Points(at_least=2)] = Field(
        default=None, description="Points [x, z] of the right wall of a slab."
    )
    depth: Annotated[float | None, Quantity(above=0)] = Field(
        default=None,
        description="Depth of a slab along y, in `unit`. Flow rates are those of this depth; with a depth of one metre "
        "they are per metre.",
    )
    front_and_back: Annotated[FrontAndBack, OneOf(FrontAndBack)] = Field(
        default="periodic",
        description="Where the depth of a slab ends. `periodic`: the slab is so deep that its ends are not felt, and "
        "particles fill a slice of it between periodic faces. `walls`: a front and a back wall, and particles fill the "
        "whole depth between them; the field is the mean over the depth. By particles only.",
    )
    obstacles: dict[Annotated[str, Identifier()], Annotated[Polygon, Points(at_least=3, closed=True)]] = Field(
        default_factory=dict,
        description="Closed polygons [r, z] by name: on the wall, on the axis (r = 0), or free rings.",
    )
    sections: dict[
        Annotated[str, Identifier()],
        Annotated[Section, Short(Levels())],
    ] = Field(
        default_factory=lambda data: _sections_by_slope(*(data.get(wall) or () for wall in ("wall", "left", "right"))),
        description="Parts of the vessel between two levels, by name. Unless given: one for each change of wall slope, "
        "named s1, s2, …, from the top. A curve of short pieces is one, and a rounding goes with the wall beside it.",
    )

    @property
    def right_wall(self) -> Polygon:
        """The outer wall of a body of revolution, or the right one of a slab."""
        wall = self.wall if self.symmetry == "axis" else self.right
        assert wall is not None  # the validator below refuses it
        return wall

    @property
    def walled(self) -> bool:
        """Whether a slab ends at a front and a back wall."""
        return self.front_and_back == "walls"

    @property
    def levels(self) -> dict[str, tuple[float, float]]:
        """Section → its upper and lower level [m]."""
        return {name: section.z for name, section in self.sections.items()}

    @model_validator(mode="before")
    @classmethod
    def _in_metres(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or not isinstance(data.get("unit", "m"), str):
            return data
        factor = _length_unit(data.get("unit", "m"))
        scaled = {key: _scaled(value, factor) for key, value in data.items() if key != "unit"}
        return scaled | ({"unit": "m"} if "unit" in data else {})

    @model_validator(mode="before")
    @classmethod
    def _without_empty(cls, data: Any) -> Any:
        """`obstacles:` or `sections:` with nothing below it but comments is as good as absent."""
        if not isinstance(data, Mapping):
            return data
        return {key: value for key, value in data.items() if value is not None or key not in ("obstacles", "sections")}

    @model_validator(mode="after")
    def _walls_of_its_symmetry(self) -> OutlineSpec:
        needed = {"axis": ("wall",), "plane": SLAB, "space": ()}[self.symmetry]
        for key in ("wall", *SLAB):
            given = getattr(self, key) is not None
            if key in needed and not given:
                refuse(f"missing; `symmetry: {self.symmetry}` needs it", (key,))
            if given and key not in needed:
                refuse(f"belongs to `symmetry: {'plane' if key in SLAB else 'axis'}`; leave it out", (key,))
        if self.walled and self.symmetry != "plane":
            refuse("only a slab, `symmetry: plane`, has a front and a back; leave it out", ("front_and_back",))
        return self

    @field_validator("sections")
    @classmethod
    def _downwards(cls, sections: dict[str, Section]) -> dict[str, Section]:
        return dict(sorted(sections.items(), key=lambda item: -item[1].z_top))


def _length_unit(unit: str) -> float:
    try:
        return length_unit(unit)
    except UnitError as error:
        refuse(str(error), ("unit",))


def _scaled(value: Any, factor: float) -> Any:
    """Every number in nested lists and mappings (but not a section's wall factor) times the factor."""
    if isinstance(value, Mapping):
        return {key: item if key == "wall_factor" else _scaled(item, factor) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_scaled(item, factor) for item in value]
    return tidy(value * factor) if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _sections_by_slope(*walls: Polygon) -> dict[str, Section]:
    """One section per run of wall segments of equal slope, of all walls; a curve is one, ledges only separate."""
    levels: list[float] = []
    for z in sorted({z for wall in walls for span in _spans(wall) for z in span}, reverse=True):
        if not levels or levels[-1] - z > LEVEL_TOLERANCE:
            levels.append(z)
    return {f"s{index}": Section(z=span) for index, span in enumerate(pairwise(levels), start=1)}


def _spans(wall: Polygon) -> list[tuple[float, float]]:
    """Upper and lower ends of what is one section along a wall, from the top down."""
    if not wall:
        return []
    height = wall[0][1] - wall[-1][1]
    curves = _curves(_runs(wall), CURVE_PIECE * height)
    for rounding in [curve for curve in curves if len(curve) > 1 and _height(curve) < ROUNDING * height]:
        k = curves.index(rounding)  # between two walls: it goes with the one that slopes more
        beside = [other for other in curves[max(0, k - 1) : k + 2] if other is not rounding and other[0].height > 0]
        if beside:
            joined = max(beside, key=lambda other: abs(other[0].slope))
            joined[:] = sorted([*joined, *rounding], key=lambda run: -run.top)
            curves.remove(rounding)
    return [(curve[0].top, curve[-1].bottom) for curve in curves if curve[0].height > 0]


def _curves(runs: list[_Run], piece: float) -> list[list[_Run]]:
    """Runs of one slope; those of a curve, of pieces no longer than this, together."""
    chains: list[list[_Run]] = []
    for run in runs:
        if chains and _go_on(chains[-1][-1], run, piece):
            chains[-1].append(run)
        else:
            chains.append([run])
    return [part for chain in chains for part in ([chain] if len(chain) >= CURVE_PIECES else [[run] for run in chain])]


def _go_on(run: _Run, below: _Run, piece: float) -> bool:
    """Whether two pieces may belong to one curve."""
    small = all(0 < one.height < piece for one in (run, below))
    return small and abs(math.atan(below.slope) - math.atan(run.slope)) < CURVE_TURN


def _height(curve: list[_Run]) -> float:
    return curve[0].top - curve[-1].bottom


def _runs(wall: Polygon) -> list[_Run]:
    """What has one slope, from the top down; a ledge has no height."""
    runs: list[_Run] = []
    for (r0, z0), (r1, z1) in pairwise(wall):
        if z0 - z1 <= LEVEL_TOLERANCE:
            runs.append(_Run(0.0, z0, z0))
            continue
        slope = (r1 - r0) / (z1 - z0)
        if runs and runs[-1].height > 0 and abs(slope - runs[-1].slope) < 1e-9:
            runs[-1] = _Run(slope, runs[-1].top, z1)
        else:
            runs.append(_Run(slope, z0, z1))
    return runs


class _Run(NamedTuple):
    """A piece of wall of one slope dr/dz between two levels."""

    slope: float
    top: float
    bottom: float

    @property
    def height(self) -> float:
        return self.top - self.bottom
