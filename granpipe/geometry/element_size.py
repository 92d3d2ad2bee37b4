"""How large the triangles of the r–z section may be: a field that grows at a fixed rate away from its sources.

Sources are the boundary (the local width of the channel over the number of elements across it), the narrowest places
(a corner facing a wall) and the corners, where the speed of a moving wall jumps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import Array, Mask
from granpipe.geometry.polyline import cross, nearest_points
from granpipe.rzmesh import Index

GROWTH = 0.3  # of the element size per unit of distance
FIRST_SAMPLES = 16  # per boundary edge
MOST_SAMPLES = 20_000
PASSES = 12  # of halving the distance between samples
SHARP = np.deg2rad(12)  # walls that turn by less are one smooth wall
TOLERANCE = 1e-6  # of the vessel's size: nearer points are one (OpenCascade's own is 1e-7)


@dataclass(frozen=True)
class ElementSize:
    """The largest field that does not exceed its sources and grows no faster than `GROWTH`.

    Parameters
    ----------
    r, z, size : (n,) place and element size of each source [m]
    bands : lower end, upper end and element size of further sources that fill whole ranges of z [m]
    """

    r: Array
    z: Array
    size: Array
    bands: tuple[tuple[float, float, float], ...] = ()

    def at(self, r: float, z: float) -> float:
        """Element size at one point [m]."""
        near = float((self.size + GROWTH * np.hypot(self.r - r, self.z - z)).min())
        return min(near, *(size + GROWTH * max(low - z, z - high, 0.0) for low, high, size in self.bands), np.inf)

    def at_all(self, points: Array) -> Array:
        """(n,) element size at each point (n, 2) [m]."""
        return np.array([self.at(r, z) for r, z in points])

    def joined(self, points: Array, size: Array) -> ElementSize:
        """With more sources; those that others overrule are left out."""
        r, z = np.append(self.r, points[:, 0]), np.append(self.z, points[:, 1])
        everything = ElementSize(r, z, np.append(self.size, size))
        allowed = everything.at_all(np.stack([r, z], axis=1))
        kept = everything.size <= allowed * (1 + 1e-12)
        return ElementSize(r[kept], z[kept], everything.size[kept])


def element_size(
    edges: Array, axis: Mask, end: Mask, law_heights: Array, cells_across: float, corner_refinement: float
) -> ElementSize:
    """Size field of a section.

    Parameters
    ----------
    edges : (k, 2, 2) straight pieces of the boundary, the inside on their left [m]
    axis, end : (k,) which of them lie on the axis, and on inlet or outlet
    law_heights : (n,) heights where the speed of the wall jumps [m]
    cells_across : elements from the axis to the wall; half as many fit between two walls
    corner_refinement : how much smaller the elements at corners are

    Raises
    ------
    MeshError : a gap between walls or obstacles is too long and narrow for a mesh
    """
    nothing = ElementSize(np.zeros(1), np.zeros(1), np.full(1, np.inf))
    wide = nothing.joined(*_widths(edges, axis, end, cells_across)).joined(*_narrows(edges, axis, cells_across))
    return wide.joined(*_corners(edges, axis, end, law_heights, wide, corner_refinement))


def _widths(edges: Array, axis: Mask, end: Mask, cells_across: float) -> tuple[Array, Array]:
    """Samples (n, 2) along the boundary and the element size (n,) that the width of the channel gives them."""
    owner = np.repeat(np.flatnonzero(~end), FIRST_SAMPLES)
    part = np.tile((np.arange(FIRST_SAMPLES) + 0.5) / FIRST_SAMPLES, np.count_nonzero(~end))
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    step = np.full(len(part), 1 / FIRST_SAMPLES)
    points, sizes = np.empty((0, 2)), np.empty(0)
    for _ in range(PASSES):
        place = edges[owner, 0] + part[:, None] * (edges[owner, 1] - edges[owner, 0])
        size = _width(place, owner, edges, axis) / cells_across
        points, sizes = np.vstack([points, place]), np.append(sizes, size)
        _refuse_excess(edges, sizes, cells_across)
        coarse = step * length[owner] > 2 * size  # split there: two samples in the place of one
        owner, step = np.repeat(owner[coarse], 2), np.repeat(step[coarse] / 2, 2)
        part = np.repeat(part[coarse], 2) + step * np.tile([-0.5, 0.5], np.count_nonzero(coarse))
    known = np.isfinite(sizes)
    return points[known], sizes[known]


def _refuse_excess(edges: Array, sizes: Array, cells_across: float) -> None:
    """MeshError where a long narrow gap would ask for more elements than one can solve for."""
    if len(sizes) > MOST_SAMPLES:
        ratio = edges[..., 0].max() / (0.5 * cells_across * sizes.min())
        raise MeshError(
            f"the vessel's radius is {ratio:.3g} times a gap between walls or obstacles, which is too long and narrow "
            f"to be meshed (more than {MOST_SAMPLES} elements along the boundary): close the gap or widen it"
        )


def _width(points: Array, owner: Index, edges: Array, axis: Mask) -> Array:
    """(n,) distance along the inward normal to the boundary across, doubled between two walls; inf where there is none.

    Neighbours of a point's own edge do not count: a wedge has no width at its tip.
    """
    along = edges[:, 1] - edges[:, 0]
    normal, between = _inward(edges)[owner, None], edges[None, :, 0] - points[:, None]
    turn = cross(normal, along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = cross(between, along[None]) / turn
        part = cross(between, normal) / turn
    seen = (distance > 0) & (part >= 0) & (part <= 1) & ~_neighbours(edges)[owner]
    halved = axis[owner, None] | axis[None, :]
    return np.asarray(np.where(seen, distance * np.where(halved, 1.0, 2.0), np.inf).min(axis=1))


def _inward(edges: Array) -> Array:
    """(k, 2) unit normals towards the inside, which is on the left."""
    along = edges[:, 1] - edges[:, 0]
    return np.asarray(np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None])


def _meets(a: Array, b: Array) -> Mask:
    """(n, m) which points a[i] and b[j] are the same."""
    return np.asarray(np.linalg.norm(a[:, None] - b, axis=2) < TOLERANCE * np.abs(a).max())


def _neighbours(edges: Array) -> Mask:
    """(k, k) which edges share an end (or are the same)."""
    count, ends = len(edges), edges.reshape(-1, 2)
    return np.asarray(_meets(ends, ends).reshape(count, 2, count, 2).any(axis=(1, 3)))


def _narrows(edges: Array, axis: Mask, cells_across: float) -> tuple[Array, Array]:
    """Places where a corner faces another piece of the boundary: both ends of the shortest way, and the size there."""
    corner = edges[:, 0]
    distance, foot = nearest_points(corner, edges)
    height = np.einsum("nkd,kd->nk", corner[:, None] - foot, _inward(edges))
    facing = (distance > TOLERANCE * np.abs(edges).max()) & (height > 0.5 * distance)
    at, across = np.nonzero(facing)
    size = distance[at, across] * np.where(axis[at] | axis[across], 1.0, 2.0) / cells_across
    return np.vstack([corner[at], foot[at, across]]), np.tile(size, 2)


def _corners(
    edges: Array, axis: Mask, end: Mask, law_heights: Array, wide: ElementSize, refinement: float
) -> tuple[Array, Array]:
    """Corners of walls and obstacles and jumps along the outlet (n, 2), and the size there (n,)."""
    alike = (end[:, None] == end) & ~axis[:, None] & ~axis
    before, after = np.nonzero(_meets(edges[:, 1], edges[:, 0]) & alike)
    corner, along = edges[after, 0], edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=1)
    turn = np.abs(np.arctan2(cross(along[before], along[after]), np.sum(along[before] * along[after], axis=1)))
    upright = np.abs(along[:, 0]) < TOLERANCE * length
    jump = np.isclose(corner[:, 1:], law_heights, rtol=0, atol=TOLERANCE * np.abs(edges).max()).any(axis=1)
    sharp = (turn > SHARP) | (upright[before] != upright[after]) | jump | end[before]
    room = np.minimum(np.minimum(length[before], length[after]), wide.at_all(corner))
    return corner[sharp], room[sharp] / refinement
