"""The outline of an axisymmetric vessel in the (r, z) plane: areas, volumes and slopes, all exact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from granpipe.field import Array, Grid, Mask
from granpipe.geometry.contacts import AXIS, WALL, Groups, touching_groups
from granpipe.geometry.edges import Edges, Side
from granpipe.geometry.polyline import signed_area
from granpipe.geometry.validate import ZRange, check_obstacles, check_sections, check_wall

if TYPE_CHECKING:
    from granpipe.case.schema import Case

Points = Sequence[Sequence[float]] | Array
RELATIVE_TOLERANCE = 1e-6  # of the vessel's size: nearer points are taken as touching
_LEVELS = 17  # between two corners, to find the widest: Ω is a parabola there


@dataclass(frozen=True, eq=False)
class Outline:
    """A vessel: the outer wall, what stands in it, and the names of its parts. Made by `of` or `from_case`.

    Above its inlet and below its outlet the vessel goes on straight.

    Parameters
    ----------
    wall : (n, 2) points (r, z) [m] from the top down
    obstacles : name → (m, 2) points of a closed polygon [m], anticlockwise in (r, z), last point not repeated
    sections : name → section with z_top and z_bottom [m]
    """

    wall: Array
    obstacles: Mapping[str, Array]
    sections: Mapping[str, ZRange]

    @classmethod
    def of(
        cls,
        wall: Points,
        obstacles: Mapping[str, Points] | None = None,
        sections: Mapping[str, ZRange] | None = None,
    ) -> Outline:
        """Outline from points, checked: CaseError with the key path of what is wrong."""
        points = _points(wall)
        tolerance = _tolerance(points)
        check_wall(points, tolerance)
        polygons = {name: _points(polygon) for name, polygon in (obstacles or {}).items()}
        check_obstacles(points, polygons, tolerance)
        check_sections(sections or {}, points[0, 1], points[-1, 1], tolerance)
        level = _levelled([points, *(_anticlockwise(polygon) for polygon in polygons.values())], tolerance)
        return cls(level[0], dict(zip(polygons, level[1:], strict=True)), dict(sections or {}))

    @classmethod
    def from_case(cls, case: Case) -> Outline:
        """Outline that the case describes, checked.

        Raises
        ------
        CaseError : the outline is not one of a vessel
        """
        return cls.of(case.outline.wall, case.outline.obstacles, case.outline.sections)

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
        """Largest radius of the wall [m]."""
        return float(self.wall[:, 0].max())

    @property
    def inlet_radius(self) -> float:
        """[m]."""
        return float(self.wall[0, 0])

    @property
    def outlet_radius(self) -> float:
        """[m]."""
        return float(self.wall[-1, 0])

    @property
    def tolerance(self) -> float:
        """Distance below which two points are taken as touching [m]."""
        return _tolerance(self.wall)

    @cached_property
    def groups(self) -> Groups:
        """Which of axis, wall and obstacles touch."""
        return touching_groups(self.wall, self.obstacles, self.tolerance)

    def stands_on(self, name: str) -> Literal["wall", "axis", "nothing"]:
        """What an obstacle touches, be it through other obstacles."""
        if self.groups.joined(name, WALL):
            return "wall"
        return "axis" if self.groups.joined(name, AXIS) else "nothing"

    def wall_radius(self, z: ArrayLike, side: Side = "below") -> Array:
        """Radius of the outer wall [m] at heights z; at a ledge just below or just above it."""
        return self._at_wall(z, side)[0]

    def wall_slope(self, z: ArrayLike, side: Side = "below") -> Array:
        """dr/dz of the outer wall at heights z; at a corner just below or just above it."""
        return self._at_wall(z, side)[1]

    def area(self, z: ArrayLike, side: Side = "below") -> Array:
        """Free area Ω(z) [m²], obstacles taken out; at a ledge just below or just above it."""
        heights = np.asarray(z, dtype=float)
        spans, radii = self.edges.at(heights.reshape(-1), side)
        area = np.pi * np.sum(np.where(spans, self.edges.sign[:, None] * radii**2, 0.0), axis=0)
        return np.asarray(self._beyond(heights, side, area.reshape(heights.shape), power=2))

    def intervals(self, z: float, side: Side = "below") -> list[tuple[float, float]]:
        """Free radial intervals (r0, r1) [m] at height z, from the axis outwards; at a ledge just below or above it."""
        solids = sorted(self._solid_intervals(z, side))
        free, reached = [], 0.0
        for r0, r1 in [*solids, (float(self.wall_radius(z, side)), np.inf)]:
            if r0 - reached > self.tolerance:
                free.append((reached, r0))
            reached = max(reached, r1)
        return free

    def contains(self, r: Array, z: Array) -> Mask:
        """(n,) whether points r, z [m] lie in the vessel or on its walls, and in no obstacle."""
        import shapely

        (top, bottom), axis = self.wall[[0, -1], 1], 0.0
        vessel = shapely.Polygon([(axis, top), *self.wall, (axis, bottom)]).buffer(self.tolerance)
        inside = shapely.intersects_xy(vessel, r, z) & (np.asarray(r) >= 0)
        for corners in self.obstacles.values():
            inside &= ~shapely.contains_xy(shapely.Polygon(corners).buffer(-self.tolerance), r, z)
        return np.asarray(inside)

    def volume(self) -> float:
        """Free volume between inlet and outlet [m³], by Pappus' theorem on every edge."""
        return float(np.sum(self.edges.sign * self.edges.frustum_volumes()))

    def widest_area(self) -> float:
        """Free area of the widest level [m²]."""
        heights = np.unique(np.concatenate([self.wall[:, 1], *(corners[:, 1] for corners in self.obstacles.values())]))
        heights = heights[(heights >= self.z_bottom) & (heights <= self.z_top)]
        levels = np.concatenate([a + (b - a) * np.linspace(0, 1, _LEVELS) for a, b in pairwise(heights)])
        return float(max(self.area(levels, "above").max(), self.area(levels, "below").max()))

    def inside_fraction(self, grid: Grid) -> Array:
        """(nz, nr) part of the volume of each cell that lies in the vessel and outside the obstacles; exact."""
        cumulative = self.edges.volume_within(grid)
        fraction = np.diff(cumulative, axis=1) / grid.cell_volume
        rounding = 1e-12 * grid.r_edges[-1] / grid.cell
        fraction[np.abs(fraction) < rounding] = 0.0
        fraction[np.abs(fraction - 1) < rounding] = 1.0
        return fraction

    @cached_property
    def edges(self) -> Edges:
        """The slanted and upright edges of wall and obstacles."""
        return Edges.of(self.wall, self.obstacles)

    def _at_wall(self, z: ArrayLike, side: Side) -> tuple[Array, Array]:
        heights = np.asarray(z, dtype=float)
        edges = self.edges
        spans, radii = edges.at(heights.reshape(-1), side)
        spans &= (edges.owner == 0)[:, None]
        radius = np.sum(np.where(spans, radii, 0.0), axis=0).reshape(heights.shape)
        slope = np.sum(np.where(spans, edges.slope[:, None], 0.0), axis=0).reshape(heights.shape)
        return np.asarray(self._beyond(heights, side, radius, power=1)), slope

    def _beyond(self, z: Array, side: Side, value: Array, power: int) -> Array:
        """Replace the value above the inlet and below the outlet by that of the straight pipe there."""
        scale = np.pi if power == 2 else 1.0
        above = z >= self.z_top if side == "above" else z > self.z_top
        below = z <= self.z_bottom if side == "below" else z < self.z_bottom
        value = np.where(above, scale * self.inlet_radius**power, value)
        return np.where(below, scale * self.outlet_radius**power, value)

    def _solid_intervals(self, z: float, side: Side) -> list[tuple[float, float]]:
        edges = self.edges
        spans, radii = edges.at(np.array([z]), side)
        solids = []
        for owner in range(1, len(self.obstacles) + 1):
            met = np.sort(radii[spans[:, 0] & (edges.owner == owner), 0])
            solids += [(float(r0), float(r1)) for r0, r1 in met.reshape(-1, 2)]
        return solids


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


def _tolerance(wall: Array) -> float:
    return RELATIVE_TOLERANCE * float(np.ptp(wall[:, 1]) + wall[:, 0].max()) if len(wall) else 0.0
