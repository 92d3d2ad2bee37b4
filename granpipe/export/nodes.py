"""Values on the nodes of the grid, from the fluxes on the faces of its cells.

Programs that import a field interpolate between points; they need points on the axis and on the walls, where the
field of cells and faces has none. Nothing is averaged across a void or a wall: a face counts only where solids touch
it and no wall cuts it, and a node that has such faces on one side only is extrapolated from that side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from granpipe.errors import DataError
from granpipe.field import ROUND, Array, Field, Mask, Measure

Values = TypeVar("Values", Array, Mask)

WHOLE = 1 - 1e-6  # a cell is wholly inside the outline from here on
GROWN_LAYERS = 8  # of nodes; at the end of a wall that crosses six cells per row, 80° from the vertical, it takes seven


@dataclass(frozen=True)
class Nodes:
    """The field on the nodes of its grid, at the flow rate of the case. Velocities are 0 away from the solids.

    Parameters
    ----------
    r, z : (nr+1,), (nz+1,) coordinates of the nodes [m]
    bulk_u, bulk_w : (nz+1, nr+1) bulk velocity U = F/φ_ref, radial and vertical [m/s]
    solids : (nz+1, nr+1) True on the corners of `cells`
    cells : (nz, nr) True where solids flow or rest, out to the walls
    particle_u, particle_w : (nz+1, nr+1) particle velocity v = F/φ [m/s]; None where the field has no packing
    packing : (nz+1, nr+1) solids fraction φ; None where the field has none
    psi : (nz+1, nr+1) Stokes stream function of the bulk velocity [m³/s per radian]; None where the field has none
    measure : what the plane stands for: in x–z r is x
    """

    r: Array
    z: Array
    bulk_u: Array
    bulk_w: Array
    solids: Mask
    cells: Mask
    particle_u: Array | None = None
    particle_w: Array | None = None
    packing: Array | None = None
    psi: Array | None = None
    measure: Measure = ROUND


def nodal_values(field: Field) -> Nodes:
    """Bring a field onto its nodes; DataError where it holds a value that is not a number."""
    cells = solid_cells(field)
    bulk_u, bulk_w = _on_nodes(field, cells, *(field.bulk_packing * open_part(field, axis) for axis in (1, 0)))
    nodes = Nodes(
        r=field.grid.r_edges,
        z=field.grid.z_edges,
        bulk_u=bulk_u,
        bulk_w=bulk_w,
        solids=corner_sum(cells) > 0,
        cells=cells,
        psi=None if field.psi is None else field.psi * field.velocity_scale,
        measure=field.grid.measure,
    )
    if field.packing_fraction is not None:
        packing = np.where(field.inside_fraction > 0, field.packing_fraction, 0.0)
        particle_u, particle_w = _on_nodes(field, cells, *(_occupied(field, packing, axis) for axis in (1, 0)))
        packing = _packing_on_nodes(field, cells, packing)
        nodes = replace(nodes, particle_u=particle_u, particle_w=particle_w, packing=packing)
    _refuse_nan(nodes)
    return nodes


def nodal_errors(field: Field) -> Nodes | None:
    """Standard errors of the bulk velocities on the nodes, in the place of the velocities; None unless all are known.

    They are interpolated as the velocities are, which takes neighbouring faces to err together: at most too large.
    """
    if field.flux_r_se is None or field.flux_z_se is None:
        return None
    if np.isnan(field.flux_r_se).any() or np.isnan(field.flux_z_se).any():
        return None
    return nodal_values(replace(field, flux_r=field.flux_r_se, flux_z=field.flux_z_se, packing_fraction=None, psi=None))


def solid_cells(field: Field) -> Mask:
    """(nz, nr) bulk cells, and the slivers (under half inside the outline) that share a face with one.

    Without its slivers a sloping wall would be a staircase that leaves parts of the vessel without values.
    """
    sliver = (field.inside_fraction > 0) & (field.inside_fraction < 0.5)
    bulk = np.pad(field.bulk, 1)
    beside = bulk[:-2, 1:-1] | bulk[2:, 1:-1] | bulk[1:-1, :-2] | bulk[1:-1, 2:]
    return np.asarray(field.bulk | (sliver & beside))


def triangles(nodes: Nodes) -> NDArray[np.intp]:
    """(2 × number of solid cells, 3) flat node indices, anticlockwise: each solid cell cut along one diagonal."""
    iz, ir = np.nonzero(nodes.cells)
    lower_left = iz * len(nodes.r) + ir
    upper_left = lower_left + len(nodes.r)
    halves = np.stack(
        [
            np.stack([lower_left, lower_left + 1, upper_left + 1], axis=1),
            np.stack([lower_left, upper_left + 1, upper_left], axis=1),
        ],
        axis=1,
    )
    return np.asarray(halves.reshape(-1, 3))


def corner_sum(cells: Array | Mask) -> Array:
    """(nz+1, nr+1) sum of the up to four cells around each node."""
    padded = np.pad(np.asarray(cells, dtype=float), 1)
    return np.asarray(padded[:-1, :-1] + padded[:-1, 1:] + padded[1:, :-1] + padded[1:, 1:])


def cell_sum(nodes: Array | Mask) -> Array:
    """(nz, nr) sum of the four corners of each cell."""
    values = np.asarray(nodes, dtype=float)
    return np.asarray(values[:-1, :-1] + values[:-1, 1:] + values[1:, :-1] + values[1:, 1:])


def open_part(field: Field, axis: int) -> Array:
    """Part of each face across `axis` (0: z, 1: r) inside the outline, estimated from the cells on its two sides.

    A face between a cell wholly inside and one wholly outside carries the wall itself: there a flux of zero is a true
    value, and the face counts as open.
    """
    inside = field.inside_fraction
    before, behind = _sides(inside, axis)
    if axis == 0 and len(inside) > 1:  # a sloping wall goes on beyond the ends
        before[0] = np.clip(2 * inside[0] - inside[1], 0, 1)
        behind[-1] = np.clip(2 * inside[-1] - inside[-2], 0, 1)
    on_wall = (np.minimum(before, behind) == 0) & (np.maximum(before, behind) > WHOLE)
    return np.asarray(np.where(on_wall, 1.0, 0.5 * (before + behind)))


def _sides(cells: Values, axis: int) -> tuple[Values, Values]:
    """Values of the cells before and behind each face across `axis`; beyond the grid the nearest cell's."""
    width = [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
    padded = np.pad(cells, width, mode="edge")
    return (padded[:-1], padded[1:]) if axis == 0 else (padded[:, :-1], padded[:, 1:])


def _occupied(field: Field, packing: Array, axis: int) -> Array:
    """Part of each face across `axis` that solids occupy: φ of the cells on its two sides, per whole face as F is."""
    return np.asarray(0.5 * np.add(*_sides(packing * field.inside_fraction, axis)))


def _sampled(open_: Array, cells: Mask, axis: int) -> Mask:
    """Faces that give a value: touched by solids and wholly open; in a passage too narrow for those, open in part.

    The open part of a face that a wall cuts is only an estimate, up to a quarter off: extrapolation beats it.
    """
    touched = np.logical_or(*_sides(cells, axis)) & (open_ > 0)
    whole = touched & (open_ > WHOLE)
    passage, _ = label(touched, structure=[[0, 0, 0], [1, 1, 1], [0, 0, 0]])
    return np.asarray(whole | (touched & ~np.isin(passage, passage[whole])))


def _on_nodes(field: Field, cells: Mask, part_r: Array, part_z: Array) -> tuple[Array, Array]:
    """Radial and vertical velocity on the nodes, 0 away from the solids: the fluxes divided by a part of their faces.

    A ring's mean of a + b r² is its value at the mean of r²: interpolating w in r² makes plug and parabola exact, and
    on the axis it is the even symmetry of w.
    """
    grid = field.grid
    sampled_r, sampled_z = (_sampled(open_part(field, axis), cells, axis) for axis in (1, 0))
    edges = grid.r_edges**2 if grid.measure.axial else grid.r_edges
    u, known_u = _between(_divided(field.flux_r, part_r).T, sampled_r.T, grid.z_centres, grid.z_edges)
    w, known_w = _between(_divided(field.flux_z, part_z), sampled_z, 0.5 * (edges[1:] + edges[:-1]), edges)
    u, w = _grown(u.T, known_u.T, cells), _grown(w, known_w, cells)
    if grid.measure.axial:
        u[:, 0] = 0.0  # by symmetry
    solids = corner_sum(cells) > 0
    return np.where(solids, u, 0.0) * field.flow_scale, np.where(solids, w, 0.0) * field.flow_scale


def _divided(total: Array, part: Array) -> Array:
    """total/part, 0 where the part is 0."""
    return np.asarray(np.divide(total, part, out=np.zeros_like(total), where=part > 0))


def _between(values: Array, valid: Mask, places: Array, nodes: Array) -> tuple[Array, Mask]:
    """Values at `nodes` (…, n+1) from values at the `places` (…, n) between them, and where there are any."""
    (v3, v1, v2, v4), (ok3, ok1, ok2, ok4) = _neighbours(values), _neighbours(valid)
    x3, x1, x2, x4 = _neighbours(places)
    with np.errstate(divide="ignore", invalid="ignore"):  # beyond the ends there is no place; `valid` says so
        middle = v1 + (v2 - v1) * (nodes - x1) / (x2 - x1)
        from_before = np.where(ok3, _limited(v1, (v1 - v3) * (nodes - x1) / (x1 - x3)), v1)
        from_behind = np.where(ok4, _limited(v2, (v2 - v4) * (nodes - x2) / (x2 - x4)), v2)
    return np.select([ok1 & ok2, ok1, ok2], [middle, from_before, from_behind], 0.0), ok1 | ok2


def _neighbours(values: Values) -> tuple[Values, ...]:
    """For each node: the second and first place before it, the first and second behind it (0 beyond the ends)."""
    count = values.shape[-1] + 1
    padded = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(2, 2)])
    return tuple(padded[..., k : k + count] for k in range(4))


def _limited(near: Array, change: Array) -> Array:
    """Extrapolated value, kept between zero and twice the nearest one: at a steep edge a line overshoots."""
    return np.clip(near + change, np.minimum(0.0, 2 * near), np.maximum(0.0, 2 * near))


def _grown(values: Array, known: Mask, cells: Mask) -> Array:
    """Continue the values on nodes into the solid cells that no open face reaches (those that a wall cuts).

    Layer by layer: along the grid lines where two known nodes lie in line before, otherwise the mean of the known
    corners of the node's own solid cells. Beyond a few layers there is no telling, and the solids stay at rest.
    """
    values = np.where(known, values, 0.0)
    needed = corner_sum(cells) > 0
    for _ in range(GROWN_LAYERS):
        inline, lines = _inline(values, known & needed)
        count = cell_sum(known) * cells
        mean = corner_sum(_divided(cell_sum(values) * cells, count))
        around = corner_sum(count > 0)
        new = needed & ~known & (around > 0)
        layer = np.where(lines > 0, _divided(inline, lines), _divided(mean, around))
        values = np.where(new, layer, values)
        known = known | new
    return values


def _inline(values: Array, known: Mask) -> tuple[Array, Array]:
    """Sum of what the lines through two known nodes, from each of the four sides, give; and the number of lines."""
    total, lines = np.zeros_like(values), np.zeros_like(values)
    for turn in range(4):
        turned, ok = np.rot90(values, turn), np.rot90(known, turn)
        near, far = _neighbours(turned)[1], _neighbours(turned)[0]
        both = (_neighbours(ok)[1] & _neighbours(ok)[0])[..., :-1]
        line = _limited(near, near - far)[..., :-1]
        total += np.rot90(np.where(both, line, 0.0), -turn)
        lines += np.rot90(both.astype(float), -turn)
    return total, lines


def _packing_on_nodes(field: Field, cells: Mask, packing: Array) -> Array:
    """φ on the nodes: of the solid cells around a node; where there is none, of what cells the outline holds."""
    solid, empty = field.inside_fraction * cells, field.inside_fraction * ~cells
    in_solids = _divided(corner_sum(packing * solid), corner_sum(solid))
    in_voids = _divided(corner_sum(packing * empty), corner_sum(empty))
    return np.where(corner_sum(cells) > 0, in_solids, in_voids)


def _refuse_nan(nodes: Nodes) -> None:
    for name in ("bulk_u", "bulk_w", "particle_u", "particle_w", "packing", "psi"):
        values = getattr(nodes, name)
        if values is not None and not np.isfinite(values).all():
            iz, ir = np.argwhere(~np.isfinite(values))[0]
            raise DataError(
                f"the field's {name} is not a number at r = {nodes.r[ir]:.6g} m, z = {nodes.z[iz]:.6g} m;"
                " it cannot be exported: check the run that made it"
            )
