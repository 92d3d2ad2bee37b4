"""The outline of a vessel in the plane of its section: areas, volumes and slopes, all exact.

A body of revolution lies between its axis and its wall, a slab between its left and its right wall. What is called r
is x in a slab; the axis is the left wall of what has no left wall.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from granpipe.errors import CaseError
from granpipe.field import ROUND, Array, Grid, Mask, Measure
from granpipe.geometry.contacts import AXIS, WALL, Groups, touching_groups
from granpipe.geometry.edges import Edges, Side
from granpipe.geometry.polyline import signed_area
from granpipe.geometry.validate import ZRange, check_left, check_obstacles, check_sections, check_wall

if TYPE_CHECKING:
    from granpipe.case.schema import Case

Points = Sequence[Sequence[float]] | Array
RELATIVE_TOLERANCE = 1e-6  # of the vessel's size: nearer points are taken as touching
_LEVELS = 17  # between two corners, to find the widest: Ω is a parabola there


@dataclass(frozen=True, eq=False)
class Outline:
    """A vessel: its walls, what stands between them, and the names of its parts. Made by `of` or `from_case`.

    Above its inlet and below its outlet the vessel goes on straight.

    Parameters
    ----------
    wall : (n, 2) points (r, z) [m] from the top down; in a slab the right wall
    obstacles : name → (m, 2) points of a closed polygon [m], anticlockwise in (r, z), last point not repeated
    sections : name → section with z_top and z_bottom [m]
    left : (m, 2) the axis, or the left wall, from the top down [m]
    measure : what the section stands for
    """

    wall: Array
    obstacles: Mapping[str, Array]
    sections: Mapping[str, ZRange]
    left: Array
    measure: Measure

    @classmethod
    def of(
        cls,
        wall: Points,
        obstacles: Mapping[str, Points] | None = None,
        sections: Mapping[str, ZRange] | None = None,
        left: Points | None = None,
        depth: float | None = None,
        walled: bool = False,
    ) -> Outline:
        """Outline from points, checked: CaseError with the key path of what is wrong.

        Parameters
        ----------
        left, depth : left wall (m, 2) and depth [m] of a slab, of which `wall` is the right one
        walled : whether the slab ends at a front and a back wall
        """
        points = _points(wall)
        measure = ROUND if left is None or depth is None else Measure(depth, axial=False, walled=walled)
        other = points[[0, -1] if len(points) else []] * [0.0, 1.0] if left is None else _points(left)
        tolerance = _tolerance(points, other)
        check_wall(points, tolerance, measure.axial)
        if not measure.axial:
            check_left(other, points, tolerance)
        polygons = {name: _points(polygon) for name, polygon in (obstacles or {}).items()}
        check_obstacles(other, points, polygons, tolerance, measure.axial)
        check_sections(sections or {}, points[0, 1], points[-1, 1], tolerance)
        level = _levelled([points, other, *(_anticlockwise(polygon) for polygon in polygons.values())], tolerance)
        return cls(level[0], dict(zip(polygons, level[2:], strict=True)), dict(sections or {}), level[1], measure)

    @classmethod
    def from_case(cls, case: Case) -> Outline:
        """Outline that the case describes, checked.

        Raises
        ------
        CaseError : the outline is not one of a vessel
        """
        spec = case.outline
        if spec.symmetry == "space":
            raise CaseError("a vessel in space has no outline, which is needed here", ("vessel",))
        return cls.of(spec.right_wall, spec.obstacles, spec.sections, spec.left, spec.depth, spec.walled)

    @property
    def z_top(self) -> float:
        """Height of the inlet [m]."""
        return float(self.wall[0, 1])

    @property
    def z_bottom(self) -> float:
        """Height of the outlet [m]."""
        return float(self.wall[-1, 1])

    @property
    def r_max(self) -> float:
        """Largest radius of the wall, or largest x [m]."""
        return float(self.wall[:, 0].max())

    @property
    def r_min(self) -> float:
        """0, or the least x of a slab [m]."""
        return float(self.left[:, 0].min())

    @property
    def outlet_width(self) -> float:
        """Diameter, or width of the slot [m]."""
        return 2 * self.outlet_radius if self.measure.axial else float(self.wall[-1, 0] - self.left[-1, 0])

    @property
    def straight_ends(self) -> tuple[float, float]:
        """Heights below the inlet and above the outlet to which the walls are straight, nothing between them [m]."""
        obstacles = [polygon[:, 1] for polygon in self.obstacles.values()]
        down = [self.z_top - float(z.max()) for z in obstacles]
        up = [float(z.min()) - self.z_bottom for z in obstacles]
        down += [_straight(wall, self.tolerance) for wall in self.walls]
        up += [_straight(wall[::-1], self.tolerance) for wall in self.walls]
        return min(down), min(up)

    @property
    def walls(self) -> tuple[Array, ...]:
        """The outer wall, or the right and the left one of a slab: (n, 2) points each [m]."""
        return (self.wall,) if self.measure.axial else (self.wall, self.left)

    @property
    def narrowing(self) -> list[tuple[float, float]]:
        """Straight pieces of the wall that narrow downwards: height of the lower end [m], angle from the vertical."""
        pieces = pairwise(self.wall.tolist())
        return [(z1, math.atan2(r0 - r1, z0 - z1)) for (r0, z0), (r1, z1) in pieces if r1 < r0]

    @property
    def left_wall(self) -> list[tuple[float, float]] | None:
        """Points (x, z) of the left wall of a slab [m]; None beside an axis."""
        return None if self.measure.axial else [(float(x), float(z)) for x, z in self.left]

    @property
    def width(self) -> float:
        """Largest diameter, or distance in x between the outermost points of a slab [m]."""
        return 2 * self.r_max if self.measure.axial else self.r_max - self.r_min

    @property
    def levels(self) -> Array:
        """(n,) heights of the corners of the walls, from the top down [m]."""
        return np.unique(self.border[:, 1])[::-1]

    @property
    def halves(self) -> tuple[Outline, ...]:
        """The vessel as its outer walls see it: itself, and the mirror image of a slab, where left is right."""
        return (self,) if self.measure.axial else (self, self.mirrored())

    @property
    def inlet_area(self) -> float:
        """[m²]."""
        return self._end_area(0)

    @property
    def outlet_area(self) -> float:
        """[m²]."""
        return self._end_area(-1)

    def _end_area(self, end: int) -> float:
        return float(self.measure.area(self.left[end, 0], self.wall[end, 0]))

    def of_depth(self, depth: float) -> Outline:
        """The slab with another depth [m]."""
        return replace(self, measure=replace(self.measure, turn=depth))

    def mirrored(self) -> Outline:
        """The mirror image of a slab."""
        turn = np.array([-1.0, 1.0])
        obstacles = {name: polygon[::-1] * turn for name, polygon in self.obstacles.items()}
        return Outline(self.left * turn, obstacles, self.sections, self.wall * turn, self.measure)

    @cached_property
    def border(self) -> Array:
        """(n, 2) corners of the section without its obstacles, anticlockwise from the upper left."""
        return _points(np.concatenate([self.left, self.wall[::-1]]))

    @property
    def inlet_radius(self) -> float:
        """[m]; in a slab x of the right wall there."""
        return float(self.wall[0, 0])

    @property
    def outlet_radius(self) -> float:
        """[m]; in a slab x of the right wall there."""
        return float(self.wall[-1, 0])

    @property
    def tolerance(self) -> float:
        """Distance below which two points are taken as touching [m]."""
        return _tolerance(self.wall, self.left)

    @cached_property
    def groups(self) -> Groups:
        """Which of axis (or left wall), wall and obstacles touch."""
        return touching_groups(self.left, self.wall, self.obstacles, self.tolerance)

    def stands_on(self, name: str) -> Literal["wall", "axis", "nothing"]:
        """What an obstacle touches, be it through other obstacles."""
        if self.groups.joined(name, WALL):
            return "wall"
        return "axis" if self.groups.joined(name, AXIS) else "nothing"

    def wall_radius(self, z: ArrayLike, side: Side = "below") -> Array:
        """Radius of the outer wall [m] at heights z; at a ledge just below or just above it."""
        return self._at_wall(z, side)[0]

    def left_end(self, z: ArrayLike, side: Side = "below") -> Array:
        """0 on the axis, or x of the left wall [m] at heights z; at a ledge just below or just above it."""
        return np.zeros_like(z, dtype=float) if self.measure.axial else -self.mirrored().wall_radius(z, side)

    def hydraulic_diameter(self, z: ArrayLike, side: Side = "below") -> Array:
        """4 × area / perimeter [m] at heights z without obstacles."""
        width = self.wall_radius(z, side) - self.left_end(z, side)
        return self.measure.hydraulic_diameter(2 * width if self.measure.axial else width)

    def wall_slope(self, z: ArrayLike, side: Side = "below") -> Array:
        """dr/dz of the outer wall at heights z; at a corner just below or just above it."""
        return self._at_wall(z, side)[1]

    def area(self, z: ArrayLike, side: Side = "below") -> Array:
        """Free area Ω(z) [m²], obstacles taken out; at a ledge just below or just above it."""
        heights = np.asarray(z, dtype=float)
        spans, radii = self.edges.at(heights.reshape(-1), side)
        reach = np.sum(np.where(spans, self.edges.sign[:, None] * self.measure.reach(radii), 0.0), axis=0)
        area = self.measure.turn * reach.reshape(heights.shape)
        return self._beyond(heights, side, area, self.inlet_area, self.outlet_area)

    def intervals(self, z: float, side: Side = "below") -> list[tuple[float, float]]:
        """Free intervals (r0, r1) [m] at height z, from the left; at a ledge just below or above it."""
        solids = sorted(self._solid_intervals(z, side))
        free, reached = [], float(self.left_end(z, side))
        for r0, r1 in [*solids, (float(self.wall_radius(z, side)), np.inf)]:
            if r0 - reached > self.tolerance:
                free.append((reached, r0))
            reached = max(reached, r1)
        return free

    def contains(self, r: Array, z: Array) -> Mask:
        """(n,) whether points r, z [m] lie in the vessel or on its walls, and in no obstacle."""
        import shapely

        vessel = shapely.Polygon(self.border).buffer(self.tolerance)
        inside = shapely.intersects_xy(vessel, r, z) & ((np.asarray(r) >= 0) | (not self.measure.axial))
        for corners in self.obstacles.values():
            inside &= ~shapely.contains_xy(shapely.Polygon(corners).buffer(-self.tolerance), r, z)
        return np.asarray(inside)

    def volume(self) -> float:
        """Free volume between inlet and outlet [m³], from what lies between each edge and r = 0."""
        return float(np.sum(self.edges.sign * self.edges.volumes(self.measure)))

    def widest_area(self) -> float:
        """Free area of the widest level [m²]."""
        heights = np.unique(
            np.concatenate([self.border[:, 1], *(corners[:, 1] for corners in self.obstacles.values())])
        )
        heights = heights[(heights >= self.z_bottom) & (heights <= self.z_top)]
        levels = np.concatenate([a + (b - a) * np.linspace(0, 1, _LEVELS) for a, b in pairwise(heights)])
        return float(max(self.area(levels, "above").max(), self.area(levels, "below").max()))

    def inside_fraction(self, grid: Grid) -> Array:
        """(nz, nr) part of the volume of each cell that lies in the vessel and outside the obstacles; exact."""
        cumulative = self.edges.volume_within(grid)
        fraction = np.diff(cumulative, axis=1) / grid.cell_volume
        rounding = 1e-12 * np.abs(grid.r_edges).max() / grid.cell
        fraction[np.abs(fraction) < rounding] = 0.0
        fraction[np.abs(fraction - 1) < rounding] = 1.0
        return fraction

    @cached_property
    def edges(self) -> Edges:
        """The slanted and upright edges of walls and obstacles."""
        return Edges.of(self.wall, self.obstacles, None if self.measure.axial else self.left)

    def _at_wall(self, z: ArrayLike, side: Side) -> tuple[Array, Array]:
        heights = np.asarray(z, dtype=float)
        edges = self.edges
        spans, radii = edges.at(heights.reshape(-1), side)
        spans &= (edges.owner == 0)[:, None]
        radius = np.sum(np.where(spans, radii, 0.0), axis=0).reshape(heights.shape)
        slope = np.sum(np.where(spans, edges.slope[:, None], 0.0), axis=0).reshape(heights.shape)
        return self._beyond(heights, side, radius, self.inlet_radius, self.outlet_radius), slope

    def _beyond(self, z: Array, side: Side, value: Array, at_inlet: ArrayLike, at_outlet: ArrayLike) -> Array:
        """Replace the value above the inlet and below the outlet by that of the straight pipe there."""
        above = z >= self.z_top if side == "above" else z > self.z_top
        below = z <= self.z_bottom if side == "below" else z < self.z_bottom
        return np.where(below, at_outlet, np.where(above, at_inlet, value))

    def _solid_intervals(self, z: float, side: Side) -> list[tuple[float, float]]:
        edges = self.edges
        spans, radii = edges.at(np.array([z]), side)
        solids = []
        for owner in range(1, len(self.obstacles) + 1):
            met = np.sort(radii[spans[:, 0] & (edges.owner == owner), 0])
            solids += [(float(r0), float(r1)) for r0, r1 in met.reshape(-1, 2)]
        return solids


def _straight(wall: Array, tolerance: float) -> float:
    """Length of the vertical piece with which a wall (n, 2) begins [m]."""
    bent = np.abs(wall[:, 0] - wall[0, 0]) > tolerance
    last = int(np.argmax(bent)) - 1 if bent.any() else -1
    return abs(float(wall[last, 1] - wall[0, 1]))


def _points(points: Points) -> Array:
    array = np.array(points, dtype=float).reshape(-1, 2)
    array.setflags(write=False)
    return array


def _levelled(chains: list[Array], tolerance: float) -> list[Array]:
    """The same points, heights that differ by rounding only made equal, so that level edges are level."""
    heights = np.unique(np.concatenate(chains)[:, 1])
    level = heights.copy()
    for i in range(1, len(level)):
        if level[i] - level[i - 1] <= tolerance:
            level[i] = level[i - 1]
    return [_points(np.stack([c[:, 0], level[np.searchsorted(heights, c[:, 1])]], axis=1)) for c in chains]


def _anticlockwise(polygon: Array) -> Array:
    return polygon if signed_area(polygon) >= 0 else polygon[::-1]


def _tolerance(wall: Array, left: Array) -> float:
    if not len(wall) or not len(left):
        return 0.0
    return RELATIVE_TOLERANCE * float(np.ptp(wall[:, 1]) + wall[:, 0].max() - left[:, 0].min())
