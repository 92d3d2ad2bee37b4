"""The bulk mask, and the article's repeated 5×5 Gaussian, kept inside it.

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
_BULK_PART = 0.03  # of φ_ref: the layer that slides down a free surface is fast and thin in solids


def bulk_mask(volume: Array, inside_fraction: Array, grid: Grid, packing: float, diameter: float) -> Mask:
    """(nz, nr) True where solids flow or rest.

    Void is where next to no solids ever are: less than 3 % of φ_ref, as `seen_packing` sees it. The dilute edge of a
    stream belongs to it: it is about a particle wide, but on a free surface and below a lip it carries a good part of
    the flow. Islands and holes smaller than a particle are cleared away.

    Parameters
    ----------
    volume : (nz, nr) time-averaged solids [m³]
    inside_fraction : (nz, nr) part of each cell inside the outline
    packing : φ_ref
    diameter : particle diameter [m]
    """
    inside = inside_fraction > 0
    bulk = inside & (seen_packing(volume, inside_fraction, grid, diameter) > _BULK_PART * packing)
    particle = (diameter / grid.cell) ** bulk.ndim
    bulk &= ~_specks(bulk, particle)
    return np.asarray(bulk | _specks(inside & ~bulk, particle))


def seen_packing(volume: Array, inside_fraction: Array, grid: Grid, diameter: float) -> Array:
    """(nz, nr) solids fraction of what is inside the outline, through a window half a particle wide: no wall layers."""
    window = 2 * max(1, round(0.25 * diameter / grid.cell)) + 1
    solids = ndimage.uniform_filter(volume, window, mode="constant")
    space = ndimage.uniform_filter(inside_fraction * grid.cell_volume, window, mode="constant")
    return np.asarray(np.divide(solids, space, out=np.zeros_like(solids), where=inside_fraction > 0))


def _specks(mask: Mask, least: float) -> Mask:
    """Connected parts of `mask` of fewer cells than `least`."""
    label, count = ndimage.label(mask)
    size = np.bincount(label.ravel(), minlength=count + 1)
    return np.asarray(mask & (size < least)[label])


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
