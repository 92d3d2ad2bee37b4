"""How a line in the (r, z) plane becomes triangles of revolution that LIGGGHTS takes: facets, rows, tips and details.

Every row between two points of the line is a ring of equal flat trapezoids, so that a horizontal cut at any height is a
regular polygon. Its corners stand outside the circle by the factor that gives polygon and circle the same area.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import acos, ceil, cos, hypot, pi, radians, sin, sqrt

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import Array
from granpipe.geometry.polyline import distance_to

CHORD_ERROR = 0.1
"""Height of a facet's circle above its chord, in particle diameters: facets are as few as this allows."""
FEWEST_FACETS = 12
MOST_FACETS = 240
"""Beyond it the triangles that meet in the plate's centre become too thin."""
TARGET_ANGLE = radians(5.0)
"""Rows are cut where a triangle would have a smaller angle than this."""
SMALLEST_ANGLE = radians(1.0)
"""Refused below; LIGGGHTS warns below 0.5° and gives up below 0.018°."""


@dataclass(frozen=True)
class Turn:
    """One full turn in flat facets.

    Parameters
    ----------
    facets : per turn, a multiple of 4 so that quarters are equal
    allowance : how far the surface may lie from the true one [m]
    """

    facets: int
    allowance: float

    @classmethod
    def within(cls, radius: float, particle_diameter: float) -> Turn:
        """As few facets as the chord error allows at this radius [m].

        Raises
        ------
        MeshError : the walls would need more facets per turn than LIGGGHTS takes
        """
        allowance = CHORD_ERROR * particle_diameter
        fewest = pi / acos(max(1 - allowance / radius, cos(pi / FEWEST_FACETS)))
        if fewest > MOST_FACETS:
            raise MeshError(
                f"particles of {particle_diameter:.3g} m in a vessel of radius {radius:.3g} m would need {fewest:.0f} "
                f"wall facets per turn; LIGGGHTS takes about {MOST_FACETS}: raise dem.coarse_grain_factor"
            )
        return cls(4 * ceil(fewest / 4 - 1e-9), allowance)

    @classmethod
    def of(cls, facets: int, particle_diameter: float) -> Turn:
        """So many facets, whatever their chord error."""
        return cls(facets, CHORD_ERROR * particle_diameter)

    @classmethod
    def chosen(cls, facets: int | None, radius: float, particle_diameter: float) -> Turn:
        """So many facets as a case gives; None: as few as the chord error allows, or MeshError."""
        return cls.within(radius, particle_diameter) if facets is None else cls.of(facets, particle_diameter)

    def chord_error(self, radius: float) -> float:
        """How far the circle of this radius stands above the middle of a facet's chord [m]."""
        return radius * (1 - cos(pi / self.facets))

    @property
    def scale(self) -> float:
        """Radius of the polygon's corners over that of the circle of the same area."""
        step = 2 * pi / self.facets
        return sqrt(step / sin(step))

    @property
    def inward(self) -> float:
        """Part of the radius by which the middle of a facet lies inside the circle."""
        return 1 - self.scale * cos(pi / self.facets)

    def circle(self, x: Array, y: Array) -> Array:
        """Radius of the circle whose polygon, with a corner at y = 0, goes through points (x, y) [m]."""
        half = pi / self.facets
        from_middle = np.arctan2(y, x) % (2 * half) - half
        return np.asarray(np.hypot(x, y) * np.cos(from_middle) / (self.scale * cos(half)))

    def width(self, radius: float) -> float:
        """Length of a facet's horizontal side [m]."""
        return 2 * self.scale * radius * sin(pi / self.facets)

    def smallest_angle(self, start: Array, end: Array) -> float:
        """Smallest angle [rad] of the triangles in the row between two points (r, z)."""
        narrow, wide = sorted((self.width(start[0]), self.width(end[0])))
        side = hypot(self.scale * (end[0] - start[0]), end[1] - start[1])
        if narrow == 0:
            return _smallest_angle(wide, side, side)
        diagonal = sqrt(side**2 + narrow * wide)  # of an isosceles trapezoid (Ptolemy)
        return min(_smallest_angle(narrow, side, diagonal), _smallest_angle(wide, side, diagonal))


def generatrix(points: Array, turn: Turn, what: str) -> Array:
    """The line (n, 2) made fit for its triangles: blunt tips, no tiny steps, long rows cut; (m, 2).

    MeshError where that would move the surface by more than the allowance.
    """
    fit = _without_tiny_steps(_with_blunt_tips(points, turn), turn, what)
    rows = [_cut(start, end, turn) for start, end in pairwise(fit)]
    return np.concatenate([fit[:1], *rows])


def _smallest_angle(a: float, b: float, c: float) -> float:
    """Smallest angle of the triangle with these sides: it lies opposite the shortest."""
    a, b, c = sorted((a, b, c))
    return acos(min(1.0, (b * b + c * c - a * a) / (2 * b * c)))


def _with_blunt_tips(points: Array, turn: Turn) -> Array:
    """Cut needle tips on the axis to a small disc: the triangles that meet there would be too thin."""
    line = [*points]
    if line[0][0] == 0:
        line[:1] = _tip(line[0], line[1], turn)
    if line[-1][0] == 0:
        line[-1:] = _tip(line[-1], line[-2], turn)[::-1]
    return np.array(line)


def _tip(apex: Array, base: Array, turn: Turn) -> list[Array]:
    """The apex, or the disc that replaces it, as points from the axis outwards."""
    if turn.smallest_angle(apex, base) >= TARGET_ANGLE or apex[1] == base[1]:
        return [apex]
    part = min(turn.allowance / base[0], 0.5)
    rim = apex + part * (base - apex)
    return [np.array([0.0, rim[1]]), rim]


def _without_tiny_steps(points: Array, turn: Turn, what: str) -> Array:
    """Leave out points, where edges are too short for facets of this width and the particles cannot tell."""
    while True:
        angles = [turn.smallest_angle(a, b) if _is_short(a, b, turn) else pi for a, b in pairwise(points)]
        worst = int(np.argmin(angles))
        if angles[worst] >= SMALLEST_ANGLE:
            return points
        moved, i = min(((_change(points, i), i) for i in (worst, worst + 1)), key=lambda pair: pair[0])
        if moved > turn.allowance:
            (r0, z0), (r1, z1) = points[worst], points[worst + 1]
            width = turn.width(max(r0, r1))
            raise MeshError(
                f"{what}: the edge from [{r0:g}, {z0:g}] to [{r1:g}, {z1:g}] is {hypot(r1 - r0, z1 - z0):.3g} m long "
                f"beside wall facets {width:.3g} m wide; LIGGGHTS refuses such thin triangles: make it at least "
                f"{width * SMALLEST_ANGLE * 1.1:.3g} m long, or leave it out"
            )
        points = np.delete(points, i, axis=0)


def _is_short(start: Array, end: Array, turn: Turn) -> bool:
    """Whether the row is lower than its facets are wide, so that cutting it makes its triangles only thinner."""
    return hypot(end[0] - start[0], end[1] - start[1]) < turn.width(max(start[0], end[0]))


def _change(points: Array, i: int) -> float:
    """How far the line moves where point i is left out [m]; its ends must stay."""
    if i in (0, len(points) - 1):
        return float("inf")
    return float(distance_to(points[i : i + 1], points[[i - 1, i + 1]][None])[0])


def _cut(start: Array, end: Array, turn: Turn) -> Array:
    """Points after the first of an edge, cut into as few rows as the target angle needs; (rows, 2).

    An edge from the axis stays whole: its angle there is the same however short it is.
    """
    if min(start[0], end[0]) == 0:
        return end[None]
    rows = 1
    line = _rows(start, end, rows)
    while _thin(line, turn):
        rows += 1
        line = _rows(start, end, rows)
    return line[1:]


def _thin(line: Array, turn: Turn) -> bool:
    """Whether a row has too small an angle because it is long."""
    return any(not _is_short(a, b, turn) and turn.smallest_angle(a, b) < TARGET_ANGLE for a, b in pairwise(line))


def _rows(start: Array, end: Array, rows: int) -> Array:
    """The edge cut into rows whose lengths grow with the radius, so that all have about the same shape."""
    part = np.linspace(0.0, 1.0, rows + 1)
    small, large = sorted((float(start[0]), float(end[0])))
    if small > 0 and large > 1.001 * small:
        radius = start[0] * (end[0] / start[0]) ** part
        part = (radius - start[0]) / (end[0] - start[0])
        part[0], part[-1] = 0.0, 1.0
    return np.asarray(start + part[:, None] * (end - start))


def triangle_angles(corners: Array) -> Array:
    """(n, 3) angles [rad] of triangles (n, corner, xyz)."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1), axis=2)
    a, b, c = sides, np.roll(sides, -1, axis=1), np.roll(sides, -2, axis=1)
    return np.asarray(np.arccos(np.clip((b**2 + c**2 - a**2) / (2 * b * c), -1, 1)))
