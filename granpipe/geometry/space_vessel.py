"""A vessel in space: its walls, named outlets, straight ends, and what particles can reach in it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from granpipe.errors import CaseError, DataError, KeyPath
from granpipe.field import Array, Box, Boxes, Mask
from granpipe.geometry.openings import Opening
from granpipe.geometry.outline import Outline
from granpipe.geometry.spout import Spout
from granpipe.geometry.wall_mesh import LEVEL, WallMesh, WallOpening

if TYPE_CHECKING:
    from granpipe.case.vessel import OutletSpec

FILE = ("vessel", "file")
OUTLETS = ("vessel", "outlets")

MOST_CELLS = 500_000
"""Of a vessel, in which the way of the particles is looked for: larger ones where it would take more."""

LEAST_CELLS = 5
"""Across an outlet, at least: on fewer, no way to it is looked for."""

MOST_BLOCKS = 40
"""Blocks of one insertion region: LIGGGHTS tries them one after the other for every particle."""

SIDE_FLOW = 0.5
"""Free discharge through an opening in a side wall over that through a level one, a cautious rule: it falls as the
opening is tilted (Sheldon & Durian, Granular Matter 12 (2010) 579)."""

_SAMPLES = 4  # along each side of a cell beside an opening
_OFF = 1.2  # cells by which the distance of a cell from the walls may be wrong: half its diagonal, and between samples
_ROWS, _COLUMNS = 100, 60  # of the grid that areas of levels are taken from
_SAME = 1e-3  # of the vessel's size: a point that names an opening lies as near to it, or inside it


@dataclass(frozen=True)
class SpaceOutlet:
    """An outlet of a vessel in space.

    Parameters
    ----------
    name : that of the case
    opening : where it is
    spout : what lies beyond it in the simulation
    share : its part of the flow
    key : path in the case of what names it
    gap : diameter of the largest sphere that passes it, or the way to it [m]
    """

    name: str
    opening: WallOpening
    spout: Spout
    share: float
    key: KeyPath
    gap: float

    @classmethod
    def of(cls, name: str, opening: WallOpening, share: float, key: KeyPath) -> SpaceOutlet:
        """The outlet by itself.

        Raises
        ------
        CaseError : solids cannot leave through it
        """
        try:
            spout = Spout.of(opening)
        except DataError as error:
            raise CaseError(f"the opening at {_at(opening)} {error}", key) from None
        gap = min(_inscribed(opening.outline), _inscribed(spout.border))
        return cls(name, opening, spout, share, key, gap)

    @property
    def load(self) -> float:
        """Its part of the flow over what part of a level opening's free discharge it lets through."""
        return self.share / (SIDE_FLOW if self.spout.fall else 1.0)


@dataclass(frozen=True, eq=False)
class SpaceVessel:
    """A vessel in space. Above its inlet it goes on straight, beyond its outlets by their spouts and tubes.

    Parameters
    ----------
    walls : from triangles
    outlets : all openings but the inlet
    """

    walls: WallMesh
    outlets: tuple[SpaceOutlet, ...]

    @classmethod
    def of(
        cls, points: Array, triangles: NDArray[np.int64], outlets: Mapping[str, OutletSpec], unit: float = 1.0
    ) -> SpaceVessel:
        """The vessel of a case, checked.

        Parameters
        ----------
        points : (n, 3) corners of the walls [m]
        triangles : (m, 3) which of them each triangle has
        outlets : name → place and share; none where there is one outlet
        unit : length of the unit of their places [m]

        Raises
        ------
        CaseError : the walls are not those of a vessel, or the outlets are others
        """
        try:
            walls = WallMesh.of(points, triangles)
        except DataError as error:
            raise CaseError(f"the walls do not make a vessel: {error}; is vessel.unit right, and z up?", FILE) from None
        cls(walls, ())._check_pieces()
        if len(walls.inlets) > 1:
            places = " and ".join(f"({one.centre[0]:.4g}, {one.centre[1]:.4g}) m" for one in walls.inlets)
            raise CaseError(f"{len(walls.inlets)} openings at the top, at {places}; close all but the inlet", FILE)
        found = cls(walls, tuple(_named(walls, outlets, unit)))
        found._check_spouts()
        return found

    @property
    def inlet(self) -> WallOpening:
        """The opening at the top."""
        return self.walls.inlets[0]

    @property
    def z_top(self) -> float:
        """Height of the inlet [m]."""
        return self.inlet.z

    @property
    def z_bottom(self) -> float:
        """Height of its lowest point [m]."""
        return float(self.walls.ends[2, 0])

    @property
    def rises(self) -> tuple[float, ...]:
        """Height of the upper edge of each outlet's tube over the lowest point [m]."""
        return tuple(max(0.0, one.spout.z - self.z_bottom) for one in self.outlets)

    @property
    def at_bottom(self) -> bool:
        """Whether all solids leave at its lowest level."""
        slack = LEVEL * (self.z_top - self.z_bottom)
        return all(rise <= slack and not one.spout.fall for rise, one in zip(self.rises, self.outlets, strict=True))

    @property
    def middle(self) -> float:
        """Middle between its ends along y [m]."""
        return 0.5 * float(self.walls.ends[1].sum())

    @property
    def outlet_area(self) -> float:
        """Of the tubes of all outlets [m²]."""
        return sum(one.spout.area for one in self.outlets)

    @property
    def plate_speeds(self) -> tuple[float, ...]:
        """Speed of the plate in each outlet, over the mean speed of the flow through all of them."""
        return tuple(one.share * self.outlet_area / one.spout.area for one in self.outlets)

    @property
    def openings(self) -> tuple[Opening, ...]:
        """The outlets as narrowings of the way from the inlet."""
        return tuple(
            Opening(
                "outlet" if len(self.outlets) == 1 else f"outlet {one.name}",
                one.opening.z, 0.0, 0.5 * one.gap, one.gap, one.opening.area, True, one.key,
            )
            for one in self.outlets
        )  # fmt: skip

    def with_passages(self, cell: float) -> SpaceVessel:
        """The vessel with gaps that are those of the whole way from the inlet, looked for on cells of a size [m].

        A narrowing may be seen some cells too wide.

        Raises
        ------
        CaseError : no way leads to an outlet
        """
        lowest = min(one.spout.z for one in self.outlets)
        cells = self._cells(self.z_top, min(self.z_bottom, lowest - (0.0 if self.at_bottom else 3 * cell)), cell)
        return replace(self, outlets=tuple(replace(one, gap=self._passage(one, cells)) for one in self.outlets))

    @cached_property
    def outline(self) -> Outline:
        """The body of revolution that has the same area at each height: what limits and forecasts go by."""
        (x0, x1), (y0, y1), (z0, z1) = self.walls.ends.tolist()
        across = np.linspace(x0, x1, _COLUMNS + 1), np.linspace(y0, y1, _COLUMNS + 1)
        grid = Box(across[0], np.linspace(z0, z1, _ROWS + 1), across[1], flat=False)
        area = self.walls.inside_fraction(grid).sum(axis=(1, 2)) * grid.ring_area[0]
        radius = np.sqrt(np.maximum(area, 1e-9 * area.max()) / math.pi)
        ends = np.sqrt(np.array([self.inlet.area, self.outlet_area]) / math.pi)
        wall = np.column_stack([np.r_[ends[0], radius[::-1], ends[1]], np.r_[z1, grid.z_centres[::-1], z0]])
        return Outline.of(wall)

    def inside_fraction(self, grid: Box) -> Array:
        """(nz, ny, nx) part of each cell inside the walls."""
        kept = self._fractions.get(grid.shape)
        if kept is None or kept[0] != grid.cell:
            kept = self._fractions[grid.shape] = grid.cell, self.walls.inside_fraction(grid)
        return kept[1]

    @cached_property
    def _fractions(self) -> dict[tuple[int, ...], tuple[float, Array]]:
        return {}

    def contains(self, points: Array) -> Mask:
        """(n,) which points (n, 3) lie in the vessel or in its straight ends."""
        from shapely import Polygon, contains_xy

        found = self.walls.contains(points)
        above = np.flatnonzero(points[:, 2] >= self.inlet.z)
        found[above] |= contains_xy(Polygon(self.inlet.border), points[above, 0], points[above, 1])
        return found | (self.left_by(points) >= 0)

    def left_by(self, points: Array) -> NDArray[np.int64]:
        """(n,) number of the outlet beyond which points (n, 3) lie; −1 where beyond none."""
        found = np.full(len(points), -1)
        for number, one in enumerate(self.outlets):
            found[one.spout.within(points)] = number
        return found

    def beyond(self, grid: Box) -> NDArray[np.int64]:
        """(nz+2, ny+2, nx+2) number of the outlet beyond which a cell lies that touches its opening; −1 of all others.

        Cells of the grid, and one more on every side.
        """
        found = np.full([n + 2 for n in grid.shape], -1)
        edges = [np.r_[2 * one[0] - one[1], one, 2 * one[-1] - one[-2]] for one in grid.lines]
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        for number, outlet in enumerate(self.outlets):
            corners, near = outlet.opening.corners[:, ::-1], []
            for line, low, high in zip(edges, corners.min(axis=0), corners.max(axis=0), strict=True):
                size = line[1] - line[0]
                first, last = np.searchsorted(line, [low - 1.5 * size, high + 1.5 * size])
                near.append(slice(max(0, first - 1), min(len(line) - 1, last)))
            sides = [
                (line[at][:, None] + share * (line[1] - line[0])).ravel() for line, at in zip(edges, near, strict=True)
            ]
            z, y, x = np.meshgrid(*sides, indexing="ij")
            within = outlet.spout.within(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(z.shape)
            shape = [n for at in near for n in (at.stop - at.start, _SAMPLES)]
            found[tuple(near)][within.reshape(shape).any(axis=(1, 3, 5))] = number
        return found

    def surface(self, top: float, bottom: float, most_rows: int = 100) -> Array:
        """(n, 3, 3) triangles of the walls, with straight ends up to `top` and down to `bottom` [m].

        Parameters
        ----------
        most_rows : of triangles in a straight end, of which there are as many as keep them from being thin
        """
        ends = [(self.inlet.corners, top), *((one.spout.ring, bottom) for one in self.outlets)]
        spouts = [one.spout.surface for one in self.outlets]
        return np.concatenate([self.walls.surface, *spouts, *(straight(ring, z, most_rows) for ring, z in ends)])

    def _passage(self, outlet: SpaceOutlet, cells: _Cells) -> float:
        """Diameter [m] of the largest sphere that may pass from the inlet to an outlet, at the most."""
        grid, inside = cells.grid, cells.distance > 0
        if outlet.gap < LEAST_CELLS * cells.size:
            return outlet.gap
        level = np.arange(grid.shape[0])[:, None, None]
        if self.at_bottom:
            end = _within(grid, outlet.opening.border)[None] & (level < 2) & inside
        else:
            end = outlet.spout.within(grid_points(grid)).reshape(grid.shape) & inside
        start = inside & (level >= grid.shape[0] - 2)
        low, high = 0.0, 0.5 * outlet.gap
        if not _joined(inside, start, end):
            raise CaseError(f"no way leads from the inlet to the outlet at {_at(outlet.opening)}", outlet.key)
        while high - low > 0.1 * cells.size:
            middle = 0.5 * (low + high)
            joined = _joined(cells.distance + _OFF * cells.size >= middle, start, end)
            low, high = (middle, high) if joined else (low, middle)
        return min(outlet.gap, 2 * high)

    def insertion(self, top: float, bottom: float, margin: float, cell: float, height: float) -> tuple[Boxes, ...]:
        """Where particles are put in, from the top down: cells in blocks that particles from above reach.

        Solids spread sideways by one cell on two cells down: 63°, steeper than any angle of repose, so that nothing is
        put where it would not lie. What is left free along walls fills by itself.

        Parameters
        ----------
        top, bottom : height range [m]; in the tube of an outlet that rises above the lowest, so much less far down
        margin : distance of centres from the walls [m]
        cell : edge of the cells, at the least [m]
        height : of what is filled as one, at most [m]

        Raises
        ------
        CaseError : no particle finds room at the inlet
        """
        while True:
            cells = self._cells(top, bottom, cell)
            free = cells.distance >= margin + (_OFF + 0.5 * math.sqrt(3)) * cells.size
            if not self.at_bottom:
                points = grid_points(cells.grid)
                tube, floor = self.left_by(points), bottom + np.append(self.rises, 0.0)
                free &= ~((tube >= 0) & (points[:, 2] - 0.5 * cells.size < floor[tube])).reshape(free.shape)
            layers = [_rectangles(layer) for layer in _reached(free)]
            if max(map(len, layers), default=0) <= MOST_BLOCKS:
                break
            cell *= 1.5
        return tuple(_slabs(cells.grid, layers, height))

    def _cells(self, top: float, bottom: float, cell: float) -> _Cells:
        """The vessel between two heights in cells of about a size, or larger ones [m]."""
        surface = self.surface(top + cell, bottom - cell, 1)
        x0, y0, _ = surface.min(axis=(0, 1)).tolist()
        x1, y1, _ = surface.max(axis=(0, 1)).tolist()
        cell = max(cell, ((x1 - x0) * (y1 - y0) * (top - bottom) / MOST_CELLS) ** (1 / 3))
        grid = Box.within((x0, x1), (y0, y1), (bottom, top), cell, flat=False, cut=True)
        edges = grid.lines
        steps = [float(one[1] - one[0]) for one in edges]
        free = self.contains(grid_points(grid)).reshape(grid.shape)
        walls = sampled(surface, 0.25 * min(steps))
        place = [np.searchsorted(one, at) - 1 for one, at in zip(edges, walls.T[::-1], strict=True)]
        there = (place[0] >= 0) & (place[0] < grid.shape[0])
        free[tuple(np.clip(at, 0, size - 1)[there] for at, size in zip(place, grid.shape, strict=True))] = False
        beside = np.pad(free, ((0, 0), (1, 1), (1, 1)))  # beyond the outermost cells is no vessel
        distance = ndimage.distance_transform_edt(beside, steps)[:, 1:-1, 1:-1]
        return _Cells(grid, np.asarray(distance), max(steps))

    def _check_pieces(self) -> None:
        """CaseError unless one piece has all openings, and all others lie inside it."""
        walls = self.walls
        if walls.opened > 1:
            places = ", ".join(_at(one) for one in (*walls.inlets, *walls.outlets))
            raise CaseError(
                f"{walls.opened} pieces have openings of their own; they must be joined to one, and obstacles closed "
                f"on all sides; openings are at {places}",
                FILE,
            )
        for part in range(1, int(walls.parts.max()) + 1):
            corners = walls.surface[walls.parts == part].reshape(-1, 3)
            inside = walls.contains(corners, np.full(len(corners), part))
            if inside.mean() < 0.5:  # corners that touch other walls may be told either way
                raise CaseError(
                    "the walls are not one piece: a second one lies outside the vessel or within an obstacle, at "
                    f"{_place(corners[int(np.argmin(inside))])}; leave it out",
                    FILE,
                )

    def _check_spouts(self) -> None:
        """CaseError unless what lies beyond each outlet is clear of the walls and of what lies beyond the others."""
        from shapely import Polygon

        size = float(np.ptp(self.walls.ends, axis=1).max())
        walls = sampled(self.walls.surface, 0.01 * size)
        for number, one in enumerate(self.outlets):
            clear = 1e-3 * math.sqrt(one.opening.area)
            off = walls - clear * one.opening.normal  # walls that end at the opening are not in its way
            met = off[one.spout.within(off)]
            if len(met):
                raise CaseError(
                    f"the tube that leads down from it would meet the walls at {_place(met[0])}; move it, or draw a "
                    "pipe that leads away from them",
                    one.key,
                )
            for other in self.outlets[:number]:
                both = Polygon(one.spout.border).intersection(Polygon(other.spout.border)).area
                if both > 1e-6 * one.spout.area or other.spout.within(_corners(one.spout.surface)).any():
                    raise CaseError(f"the tubes below it and below {other.name} would meet; move one of them", one.key)


def straight(corners: Array, z: float, most_rows: int) -> Array:
    """(n, 3, 3) triangles of the upright wall from a ring (m, 3) to a height [m]."""
    widths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    rows = int(np.clip(math.ceil(np.abs(z - corners[:, 2]).max() / (10 * widths.min())), 1, most_rows))
    rings = np.repeat(corners[None], rows + 1, axis=0)
    part = (np.arange(1, rows + 1) / rows)[:, None]
    rings[1:, :, 2] = (1 - part) * corners[:, 2] + part * z
    a, b = rings[:-1], rings[1:]
    following_a, following_b = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    halves = (np.stack([a, following_a, following_b], axis=2), np.stack([a, following_b, b], axis=2))
    return np.concatenate([half.reshape(-1, 3, 3) for half in halves])


def sampled(triangles: Array, spacing: float) -> Array:
    """(m, 3) points on triangles (n, 3, 3), no place on which is farther than 1.12 `spacing` from one [m].

    In rows along the longest side, which grow shorter towards the third corner.
    """
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # from each corner to the next
    first = sides.argmax(axis=1)
    a, b, c = (triangles[np.arange(len(triangles)), (first + k) % 3] for k in range(3))
    length = sides.max(axis=1)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / length
    rows = np.maximum(1, np.ceil(height / spacing)).astype(np.int64)
    owner = np.repeat(np.arange(len(triangles)), rows + 1)
    up = (np.arange(len(owner)) - np.repeat(np.cumsum(rows + 1) - rows - 1, rows + 1)) / rows[owner]
    begin, end = (one[owner] + up[:, None] * (c - one)[owner] for one in (a, b))
    pieces = np.maximum(1, np.ceil((1 - up) * length[owner] / spacing)).astype(np.int64)
    row = np.repeat(np.arange(len(owner)), pieces + 1)
    along = (np.arange(len(row)) - np.repeat(np.cumsum(pieces + 1) - pieces - 1, pieces + 1)) / pieces[row]
    return np.asarray(begin[row] + along[:, None] * (end - begin)[row])


@dataclass(frozen=True)
class _Cells:
    """A vessel in cells.

    Parameters
    ----------
    grid, size : of the cells, and the longest of their edges [m]
    distance : (nz, ny, nx) of their middles from that of the nearest cell with a wall in it, or outside [m]
    """

    grid: Box
    distance: Array
    size: float


def _named(walls: WallMesh, outlets: Mapping[str, OutletSpec], unit: float) -> Sequence[SpaceOutlet]:
    """The outlets with their names and shares, each opening once."""
    openings = walls.outlets
    places = ", ".join(f"{_at(one)} of {one.area:.2g} m²" for one in openings)
    if not outlets:
        if len(openings) > 1:
            raise CaseError(
                f"missing; there are {len(openings)} openings below the top, at {places}; close those that are holes",
                OUTLETS,
            )
        return [SpaceOutlet.of("outlet", openings[0], 1.0, FILE)]
    size = float(np.ptp(walls.ends, axis=1).max())
    found: dict[int, SpaceOutlet] = {}
    for name, spec in outlets.items():
        away = [_away(one, unit * np.array(spec.at)) for one in openings]
        nearest = int(np.argmin(away))
        key = (*OUTLETS, name, "at")
        if away[nearest] > _SAME * size:
            raise CaseError(
                f"lies {away[nearest]:.3g} m from the nearest opening below the top; these are at {places} "
                "(in metres here)",
                key,
            )
        if nearest in found:
            raise CaseError(f"is the same opening as that of {found[nearest].name}; openings are at {places}", key)
        found[nearest] = SpaceOutlet.of(name, openings[nearest], spec.share, key)
    for k, one in enumerate(openings):
        if k not in found:
            raise CaseError(f"no outlet is named for the opening at {_at(one)} of {one.area:.2g} m²", OUTLETS)
    return [found[k] for k in sorted(found)]


def _away(opening: WallOpening, point: Array) -> float:
    """Distance of a point from an opening [m]."""
    from shapely import Point, Polygon, distance

    across = float((point - opening.corners.mean(axis=0)) @ opening.normal)
    place = point @ opening.plane
    return math.hypot(float(distance(Polygon(opening.outline), Point(place))), across)


def _at(opening: WallOpening) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*opening.centre, round(opening.z, 9) + 0.0)


def _place(point: Array) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*point)


def _corners(triangles: Array) -> Array:
    return triangles.reshape(-1, 3)


def _inscribed(corners: Array) -> float:
    """Diameter [m] of the largest circle in a polygon (n, 2)."""
    from shapely import Polygon, maximum_inscribed_circle

    border = Polygon(corners)
    return 2 * float(maximum_inscribed_circle(border, 1e-3 * math.sqrt(border.area)).length)


def grid_points(grid: Box) -> Array:
    """(cells, 3) middles of the cells of a grid [m]."""
    z, y, x = np.meshgrid(*map(_middles, grid.lines), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _middles(edges: Array) -> Array:
    return 0.5 * (edges[1:] + edges[:-1])


def _within(grid: Box, border: Array) -> Mask:
    """(ny, nx) columns whose middle lies in a polygon, or the one nearest to its middle."""
    from shapely import Polygon, contains_xy

    x, y = np.meshgrid(grid.r_centres, _middles(grid.y_edges))
    found = np.asarray(contains_xy(Polygon(border), x, y))
    if not found.any():
        middle = border.mean(axis=0)
        found.flat[int(np.argmin(np.hypot(x - middle[0], y - middle[1])))] = True
    return found


def _joined(free: Mask, start: Mask, end: Mask) -> bool:
    """Whether a way through free cells leads from one set of them to another."""
    number, _ = ndimage.label(free | start | end)
    begins, ends = np.unique(number[start]), np.unique(number[end])
    return bool(len(np.intersect1d(begins[begins > 0], ends[ends > 0])))


def _reached(free: Mask) -> list[Mask]:
    """The free cells of each layer, from the top down, that particles from above reach."""
    found: list[Mask] = []
    for k, layer in enumerate(free[::-1]):
        above = found[-1] if found else layer
        spread = ndimage.binary_dilation(above) if k % 2 else above
        found.append(np.asarray(layer & spread))
    return found


def _rectangles(layer: Mask) -> tuple[tuple[int, int, int, int], ...]:
    """A layer as few rectangles: first and last column and row, ends excluded."""
    left = layer.copy()
    found = []
    while left.any():
        row, column = map(int, np.unravel_index(int(np.argmax(left)), left.shape))
        end = column + int(np.argmin(np.r_[left[row, column:], False]))
        last = row + 1
        while last < len(left) and left[last, column:end].all():
            last += 1
        left[row:last, column:end] = False
        found.append((column, end, row, last))
    return tuple(found)


def _slabs(grid: Box, layers: Sequence[tuple[tuple[int, int, int, int], ...]], height: float) -> list[Boxes]:
    """Layers, from the top down, in slabs no higher than `height` [m] and of few blocks; equal ones made one."""
    x, y, z = grid.r_edges.tolist(), grid.y_edges.tolist(), grid.z_edges.tolist()
    slabs: list[Boxes] = []
    blocks: list[tuple[float, ...]] = []
    begun = z[-1]
    for k, layer in enumerate(layers):
        high, low = z[-1 - k], z[-2 - k]
        same = k > 0 and layer == layers[k - 1]
        fresh = [] if same else [(x[a], x[b], y[c], y[d]) for a, b, c, d in layer]
        if blocks and (begun - low > height * (1 + 1e-9) or len(blocks) + len(fresh) > MOST_BLOCKS):
            slabs.append(Boxes(tuple(blocks)))
            blocks, fresh, same = [], [(x[a], x[b], y[c], y[d]) for a, b, c, d in layer], False
        if not blocks:
            begun = high
        if same:
            blocks = [(*one[:4], low, one[5]) if one[4] == high else one for one in blocks]
        blocks += [(*one, low, high) for one in fresh]
    return [*slabs, *([Boxes(tuple(blocks))] if blocks else [])]
