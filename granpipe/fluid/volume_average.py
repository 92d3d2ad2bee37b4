"""A fluid's field as a volume average of spheres sees it: particles are not points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granpipe.field import Array, Field, flux_from_psi

WIDTH = 0.22
"""Standard deviation of the average over the particle size: that of a sphere's volume along one axis, 1/√20."""


def volume_averaged(field: Field, width: float) -> Field:
    """The field with its vertical flux averaged over a Gaussian of this standard deviation [m], and ψ made of it.

    Nothing is taken from beyond the walls, so there the flux falls off; every level is scaled to the whole flow.
    """
    from scipy.ndimage import gaussian_filter

    grid = field.grid
    inside = field.inside_fraction
    open_faces = np.vstack([inside[:1], np.minimum(inside[1:], inside[:-1]), inside[-1:]]) > 0
    if width <= 0.1 * grid.cell:
        return field
    spread = gaussian_filter(field.flux_z, width / grid.cell, mode=["nearest", "reflect"], truncate=3.0) * open_faces
    carried = spread @ grid.ring_area
    spread *= (field.flux_z @ grid.ring_area / carried)[:, None]
    psi = _psi(spread, field)
    flux_r, flux_z = flux_from_psi(psi, grid)
    return replace(field, flux_r=flux_r, flux_z=flux_z, psi=psi)


def _psi(flux_z: Array, field: Field) -> Array:
    """(nz+1, nr+1) ψ of a vertical flux, 0 on the axis: the flux is ∂ψ/∂r over r."""
    part = np.cumsum(flux_z * field.grid.ring_area, axis=1) / (2 * np.pi)
    return np.concatenate([np.zeros((len(flux_z), 1)), part], axis=1)
