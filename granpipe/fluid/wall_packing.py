"""The packing of spheres along a wall: a fluid's field as a volume average of particles sees it.

No sphere's centre comes nearer to a wall than its radius. Along it the packing rises from nothing to more than in the
bulk and dies away in layers; the flux of solids, packing times velocity, does the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granpipe.field import Array, Field, flux_from_psi

BULK = 0.61
"""Packing fraction of a poured bed of equal spheres, far from walls."""

ORDER = 0.57
"""Part of the layering of a poured bed that one in flow keeps: mean of the packings (not the velocities) that DEM gave
in the hoppers of fourteen cones, where it was 0.30 to 0.83 (`benchmarks/friction_fluid.py order`)."""

_FIRST = 0.637  # how far the first layer reaches, in diameters
_FAR = 12.0  # beyond, the packing is that of the bulk
_STEP = 1e-3


def wall_packing(distance: Array) -> Array:
    """Packing over that of the bulk at some distances from a wall in sphere diameters, of equal spheres in flow.

    The packing of poured beds by de Klerk (AIChE J. 49 (2003) 2022), with the layers behind the first one weakened.
    """
    x = np.asarray(distance, dtype=float)
    first = (2.53 * x - 2.14 * x**2) / BULK
    swing = 0.29 * np.exp(-0.6 * x) * np.cos(2.3 * np.pi * (x - 0.16)) + 0.15 * np.exp(-0.9 * x)
    return np.where(x <= 0, 0.0, np.where(x <= _FIRST, first, 1 - ORDER * swing / BULK))


def mean_wall_packing(distance: Array, width: float, diameters: Array, shares: Array) -> Array:
    """`wall_packing` averaged over a width about each distance, and over the sizes of a mixture by volume.

    Parameters
    ----------
    distance : from the wall [m], any shape
    width : of the average [m], such as a cell
    diameters, shares : of the classes of size [m], and their shares of the volume, which sum to 1
    """
    x = np.arange(-_STEP / 2, _FAR, _STEP)
    content = np.concatenate([[0.0], np.cumsum(wall_packing(x[1:] - _STEP / 2)) * _STEP])

    def filled(reach: Array) -> Array:
        inside = np.interp(reach, x, content)
        return np.asarray(inside + np.maximum(reach - x[-1], 0.0))

    total = np.zeros(np.shape(distance))
    for diameter, share in zip(diameters, shares, strict=True):
        ends = [(distance + side * width) / diameter for side in (-0.5, 0.5)]
        total += share * (filled(ends[1]) - filled(ends[0])) * diameter / width
    return total


def packed_along_walls(field: Field, distance: Array, diameters: Array, shares: Array) -> Field:
    """The field with its vertical flux times the packing along walls, every level scaled to the whole flow.

    Parameters
    ----------
    distance : (nz+1, nr) from the middle of each horizontal face to the nearest solid [m]
    diameters, shares : as for `mean_wall_packing`
    """
    grid = field.grid
    packed = field.flux_z * mean_wall_packing(distance, grid.cell, diameters, shares)
    packed *= (field.flux_z @ grid.ring_area / (packed @ grid.ring_area))[:, None]
    part = np.cumsum(packed * grid.ring_area, axis=1) / grid.measure.turn
    psi = np.concatenate([np.zeros((len(packed), 1)), part], axis=1)
    flux_r, flux_z = flux_from_psi(psi, grid)
    return replace(field, flux_r=flux_r, flux_z=flux_z, psi=psi)
