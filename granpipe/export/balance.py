"""Mass-balance error of linear interpolation between the exported nodes.

The field itself balances in every cell. A program that interpolates u and w linearly between nodes sees a field that
does not exactly: the flow through its levels varies, and its divergence is a false source of what it carries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.export.nodes import Nodes, cell_sum, open_part
from granpipe.field import Array, Field, Measure, level_flow


@dataclass(frozen=True)
class Balance:
    """Flows of bulk through every level at the flow rate of the case, and the divergence of the interpolated field.

    Parameters
    ----------
    z : (nz+1,) levels [m]
    flow_rate : what the case asks for [m³/s]
    field : (nz+1,) flow of the field itself [m³/s], positive downwards
    grid : (nz+1,) of the values interpolated in every cell, as the grid files and the spreadsheet give them
    sectionwise : (nz+1,) of the values interpolated in the solid cells alone
    divergence_max, divergence_rms : of (1/r)∂(ru)/∂r + ∂w/∂z at the centres of the solid cells that no wall cuts [1/s]
    false_source : integral of its absolute value over these cells, divided by the flow rate [1]
    """

    z: Array
    flow_rate: float
    field: Array
    grid: Array
    sectionwise: Array
    divergence_max: float
    divergence_rms: float
    false_source: float


def balance_of(field: Field, nodes: Nodes) -> Balance:
    """Measure the balance of what is exported."""
    flow_rate = field.bulk_flow * field.flow_scale
    segments = -_level_flow(nodes, field.grid.measure) * open_part(field, 0)
    solid = np.pad(nodes.cells, ((1, 0), (0, 0))) | np.pad(nodes.cells, ((0, 1), (0, 0)))
    whole = nodes.cells & (field.inside_fraction == 1)
    divergence = interpolated_divergence(nodes)[whole]
    volume = np.broadcast_to(field.grid.cell_volume, field.grid.shape)[whole]
    return Balance(
        z=nodes.z,
        flow_rate=flow_rate,
        field=level_flow(field.flux_z, field.grid) * field.velocity_scale,
        grid=segments.sum(axis=1),
        sectionwise=np.where(solid, segments, 0.0).sum(axis=1),
        divergence_max=float(np.max(np.abs(divergence), initial=0.0)),
        divergence_rms=float(np.sqrt(divergence**2 @ volume / volume.sum())) if volume.size else 0.0,
        false_source=float(np.abs(divergence) @ volume / flow_rate),
    )


def interpolated_divergence(nodes: Nodes) -> Array:
    """(nz, nr) (1/r)∂(ru)/∂r + ∂w/∂z of the bilinear velocity at the centres of the cells [1/s]; in a slab ∂u/∂x."""
    dr, dz = np.diff(nodes.r), np.diff(nodes.z)[:, None]
    u, w = nodes.bulk_u, nodes.bulk_w
    du_dr = 0.5 * (np.diff(u, axis=1)[:-1] + np.diff(u, axis=1)[1:]) / dr
    dw_dz = 0.5 * (np.diff(w, axis=0)[:, :-1] + np.diff(w, axis=0)[:, 1:]) / dz
    if not nodes.measure.axial:
        return np.asarray(du_dr + dw_dz)
    centre = 0.5 * (nodes.r[1:] + nodes.r[:-1])
    return np.asarray(0.25 * cell_sum(u) / centre + du_dr + dw_dz)


def _level_flow(nodes: Nodes, measure: Measure) -> Array:
    """(nz+1, nr) ∫ 2πr w dr, or depth × ∫ w dx, between neighbouring nodes, w linear [m³/s]."""
    r0, r1 = nodes.r[:-1], nodes.r[1:]
    w0, w1 = nodes.bulk_w[:, :-1], nodes.bulk_w[:, 1:]
    if not measure.axial:
        return np.asarray(measure.turn * (r1 - r0) * 0.5 * (w0 + w1))
    return np.asarray(np.pi / 3 * (r1 - r0) * (w0 * (2 * r0 + r1) + w1 * (r0 + 2 * r1)))
