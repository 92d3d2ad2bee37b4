"""Mean velocity of the solids on the faces of a grid, through a window as wide as a particle."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

from granpipe.field import Array
from granpipe.homogenize.average import Sums


def solids_velocity(sums: Sums, diameter: float) -> tuple[Array, Array]:
    """(nz, nr+1) radial and (nz+1, nr) vertical velocity Σφv/Σφ at DEM scale [m/s]; 0 where there are no solids.

    The sums run over a window of about one particle diameter, of flow and solids alike: layers of particles along a
    wall move as one, whereas the flux F = φv changes from layer to layer.

    Parameters
    ----------
    diameter : of the particles [m]
    """
    grid = sums.grid
    flux_r, flux_z = sums.mean_flux
    packing = sums.mean_volume / grid.cell_volume
    cells = window_cells(diameter, grid.cell)
    return (
        _windowed(flux_r, _on_faces(packing, 1), grid.measure.weight(grid.r_edges), cells),
        _windowed(flux_z, _on_faces(packing, 0), grid.ring_area, cells),
    )


def window_cells(diameter: float, cell: float) -> int:
    """The odd number of cells that is nearest to a particle diameter, from 1 on."""
    return max(1, 2 * round((diameter / cell - 1) / 2) + 1)


def _windowed(flux: Array, packing: Array, weight: Array, cells: int) -> Array:
    top, bottom = (uniform_filter(one * weight, cells, mode="constant") for one in (flux, packing))
    return np.asarray(np.divide(top, bottom, out=np.zeros_like(top), where=bottom > 1e-9 * bottom.max()))


def _on_faces(values: Array, axis: int) -> Array:
    """Means of neighbouring cells, and the outermost cells themselves at the ends."""
    padded = np.pad(values, [(1, 1) if one == axis else (0, 0) for one in (0, 1)], mode="edge")
    return np.asarray(0.5 * (np.delete(padded, 0, axis) + np.delete(padded, -1, axis)))
