"""The bulk mask, and the paper's repeated 5×5 Gaussian, kept inside it.

Sparta & Halvorsen (2017), Appendix B, after Davies (1990). The convolution is normalised by the part of its window
that holds data, so that nothing is drawn in from walls, voids or beyond the grid; across the axis the field goes on as
its mirror image (w even, u odd).
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from granpipe.field import Array, Grid, Mask

_KERNEL = np.array([1, 4, 6, 4, 1]) / 16  # binomial: a Gaussian of one cell standard deviation
_REACH = 2
_BULK_PART = 0.5  # of φ_ref: a sharp edge seen through a symmetric window keeps its place at one half
_WALL_PART = 0.2  # the same next to a wall, where random spheres fill a diameter less and less towards it


def bulk_mask(volume: Array, inside_fraction: Array, grid: Grid, packing: float, diameter: float) -> Mask:
    """(nz, nr) True where solids flow or rest.

    The packing is seen through a window about one particle wide, counting only what is inside the outline, so that it
    does not follow single particles. Spheres leave gaps along walls: within a diameter of them less packing will do
    where the nearest place farther away is bulk.

    Parameters
    ----------
    volume : (nz, nr) time-averaged solids [m³]
    inside_fraction : (nz, nr) part of each cell inside the outline
    packing : φ_ref
    diameter : particle diameter [m]
    """
    window = 2 * max(1, round(0.5 * diameter / grid.cell)) + 1
    room = inside_fraction * grid.cell_volume
    seen = ndimage.uniform_filter(volume, window, mode="constant")
    space = ndimage.uniform_filter(room, window, mode="constant")
    inside = inside_fraction > 0
    bulk = inside & (seen > _BULK_PART * packing * space)
    bulk |= inside & (seen > _WALL_PART * packing * space) & _as_away_from_walls(bulk, inside, diameter / grid.cell)
    return _without_specks(bulk, inside)


def _as_away_from_walls(bulk: Mask, inside: Mask, cells: float) -> Mask:
    """`bulk`, but within so many cells of a wall what it is at the nearest cell farther away."""
    vessel = np.pad(inside, ((0, 0), (0, 1)))  # beyond the outermost edge is wall
    core = (ndimage.distance_transform_edt(vessel) > cells)[:, :-1]
    if not core.any():
        return bulk
    row, column = ndimage.distance_transform_edt(~core, return_distances=False, return_indices=True)
    return np.asarray(bulk[row, column])


def _without_specks(bulk: Mask, inside: Mask) -> Mask:
    """Remove single bulk cells, and fill single holes."""
    bulk = bulk & ~_lonely(bulk)
    return np.asarray(bulk | _lonely(inside & ~bulk))


def _lonely(mask: Mask) -> Mask:
    """Cells of `mask` without a neighbour in it."""
    label, count = ndimage.label(mask)
    size = np.bincount(label.ravel(), minlength=count + 1)
    return np.asarray(mask & (size == 1)[label])


def flowing_faces(bulk: Mask, inside_fraction: Array) -> tuple[Mask, Mask]:
    """Faces (nz, nr+1), (nz+1, nr) that may carry flow: next to a bulk cell, and not between it and a wall.

    The axis carries none; the lower and upper end of the grid do.
    """
    inside = inside_fraction > 0
    face_r = np.zeros((bulk.shape[0], bulk.shape[1] + 1), dtype=bool)
    face_r[:, 1:-1] = (bulk[:, 1:] | bulk[:, :-1]) & inside[:, 1:] & inside[:, :-1]
    face_z = np.zeros((bulk.shape[0] + 1, bulk.shape[1]), dtype=bool)
    face_z[1:-1] = (bulk[1:] | bulk[:-1]) & inside[1:] & inside[:-1]
    face_z[0], face_z[-1] = bulk[0], bulk[-1]
    return face_r, face_z


def smooth(flux_r: Array, flux_z: Array, faces: tuple[Mask, Mask], passes: int) -> tuple[Array, Array]:
    """Convolve both components with the Gaussian, `passes` times, within their faces; other faces become 0."""
    face_r, face_z = faces
    flux_r, flux_z = flux_r * face_r, flux_z * face_z
    for _ in range(passes):
        flux_r = _convolve_r(flux_r, face_r)
        flux_z = _convolve_z(flux_z, face_z)
    return flux_r, flux_z


def _convolve_r(flux: Array, face: Mask) -> Array:
    """Radial component: it stands on the edges, so the axis itself is one, known to be 0, and the mirror is odd."""
    known = face.copy()
    known[:, 0] = face[:, 1]
    weight = np.concatenate([known[:, _REACH:0:-1], known], axis=1)
    value = np.concatenate([-flux[:, _REACH:0:-1], flux], axis=1)
    return _normalised(value, weight, face)


def _convolve_z(flux: Array, face: Mask) -> Array:
    """Vertical component: it stands between the edges, and the mirror is even."""
    weight = np.concatenate([face[:, _REACH - 1 :: -1], face], axis=1)
    value = np.concatenate([flux[:, _REACH - 1 :: -1], flux], axis=1)
    return _normalised(value, weight, face)


def _normalised(value: Array, weight: Mask, face: Mask) -> Array:
    """Convolution of the data over that of their weight; both have the mirrored columns in front."""
    top, bottom = _separable(value * weight)[:, _REACH:], _separable(weight.astype(float))[:, _REACH:]
    return np.divide(top, bottom, out=np.zeros_like(top), where=face)


def _separable(array: Array) -> Array:
    along_z = ndimage.convolve1d(array, _KERNEL, axis=0, mode="constant")
    return np.asarray(ndimage.convolve1d(along_z, _KERNEL, axis=1, mode="constant"))
