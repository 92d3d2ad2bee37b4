"""Rate of strain of a field: D = (∇v + ∇vᵀ)/2 of a velocity, by differences between the faces of each cell."""

from __future__ import annotations

import numpy as np

from granpipe.field import Array, Field, Mask

COMPONENTS = ("strain_rr", "strain_tt", "strain_zz", "strain_rz")

_WHOLE = 1 - 1e-6


def strain_rate(field: Field, velocity: tuple[Array, Array] | None = None) -> Array:
    """(4, nz, nr) rr, θθ, zz, rz of the rate of strain at DEM scale [1/s]; NaN in voids and in cells that a wall cuts.

    In the plane x–z these are xx, yy, which is 0, zz and xz.

    rr + θθ + zz is the divergence of the cell, 0 of the bulk velocity of a field that conserves. rz is found on the
    nodes among whole cells of solids, and on the axis, where it is 0; beside a wall it is that of the nodes on the
    other side.

    Parameters
    ----------
    velocity : (nz, nr+1) radial and (nz+1, nr) vertical, on the faces [m/s]; the bulk velocity F/φ_ref unless given
    """
    grid, h = field.grid, field.grid.cell
    across = float(grid.r_edges[1] - grid.r_edges[0])  # h but for rounding on rings
    u, w = velocity or (field.flux_r / field.bulk_packing, field.flux_z / field.bulk_packing)
    known = field.bulk & (field.inside_fraction > _WHOLE)
    axial = grid.measure.axial
    around = 0.5 * (u[:, 1:] + u[:, :-1]) / grid.r_centres if axial else np.zeros(grid.shape)
    sheared = np.zeros(tuple(size + 1 for size in grid.shape))
    sheared[1:-1, 1:-1] = 0.5 * (np.diff(u, axis=0)[:, 1:-1] / h + np.diff(w, axis=1)[1:-1] / across)
    free = _inner_nodes(known, axial)
    count = _corners(free.astype(float))
    shear = np.divide(_corners(sheared * free), count, out=np.full(grid.shape, np.nan), where=count > 0)
    found = np.array([np.diff(u, axis=1) / across, around, np.diff(w, axis=0) / h, shear])
    return np.where(known & (count > 0), found, np.nan)


def shear_rate(strain: Array) -> Array:
    """(nz, nr) √(2 D:D) of (4, nz, nr) components: the shear rate of simple shear."""
    rr, tt, zz, rz = strain
    return np.asarray(np.sqrt(2 * (rr**2 + tt**2 + zz**2 + 2 * rz**2)))


def _inner_nodes(known: Mask, axial: bool) -> Mask:
    """(nz+1, nr+1) nodes whose four cells are all known; on the axis two make do."""
    padded = np.pad(known, ((1, 1), (0, 1)))
    padded = np.concatenate([padded[:, :1] & axial, padded], axis=1)
    return np.asarray(padded[1:, 1:] & padded[:-1, 1:] & padded[1:, :-1] & padded[:-1, :-1])


def _corners(nodes: Array) -> Array:
    """(nz, nr) sums over the four nodes of each cell."""
    return np.asarray(nodes[1:, 1:] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[:-1, :-1])
