"""The deposit of `granpipe.homogenize.deposit` as compiled loops; imported only where numba is installed.

Same slices, same points, same formulas: the two agree to rounding.
"""

from __future__ import annotations

import math

import numba

from granpipe.field import Array

_LEAST_K2 = 1e-200


@numba.njit(cache=True, error_model="numpy")
def add(
    z: Array,
    distance: Array,
    radius: Array,
    radial_velocity: Array,
    vertical_velocity: Array,
    r_edges: Array,
    z_edges: Array,
    node: Array,
    weight: Array,
    volume: Array,
    flow_r: Array,
    flow_z: Array,
) -> None:
    """Add spheres to (nz, nr) volume, (nz, nr+1) flow_r and (nz+1, nr) flow_z."""
    rows = len(z_edges) - 1
    cell = (z_edges[-1] - z_edges[0]) / rows
    unused = flow_r[0]
    for i in range(len(z)):
        a, D = radius[i], distance[i]
        low, high = z[i] - a, z[i] + a
        for row in range(max(math.floor((low - z_edges[0]) / cell), 0), rows):
            start, end = max(z_edges[row], low), min(z_edges[row + 1], high)
            half = 0.5 * (end - start)
            if half <= 0:
                if z_edges[row] > high:
                    break
                continue
            for g in range(len(node)):
                offset = start + half + half * node[g] - z[i]
                share = half * weight[g]
                _disc(
                    D,
                    a * a - offset * offset,
                    r_edges,
                    cell,
                    share,
                    share * radial_velocity[i],
                    volume[row],
                    flow_r[row],
                )
        for level in range(max(math.floor((low - z_edges[0]) / cell) + 1, 0), rows + 1):
            offset = z_edges[level] - z[i]
            if offset >= a:
                break
            _disc(D, a * a - offset * offset, r_edges, cell, vertical_velocity[i], 0.0, flow_z[level], unused)


@numba.njit(cache=True, error_model="numpy")
def _disc(
    D: float, square: float, r_edges: Array, cell: float, weight: float, arc_weight: float, rings: Array, arcs: Array
) -> None:
    """Add weight × area of a disc to the rings, arc_weight × k/D to the edges that cut it."""
    if square <= 0:
        return
    s = math.sqrt(square)
    edges = len(r_edges)
    first = max(math.floor((D - s) / cell) + 1, 1)
    if first >= edges:
        return
    # a centre inside the outermost radius keeps its disc: the outermost edge then does not cut it
    last = min(math.floor((D + s) / cell), edges - 2 if r_edges[-1] >= D else edges - 1)
    inside = 0.0
    for edge in range(first, last + 1):
        R = r_edges[edge]
        across, inner, outer, far = R + D + s, R + s - D, R + D - s, D + s - R
        k = math.sqrt(max(across * inner * outer * far, _LEAST_K2))
        axis_angle = math.atan(k / max(across * outer, 0.0))
        disc_angle = math.atan(k / max(across * far, 0.0))
        area = min(2 * (R * R * axis_angle + square * disc_angle) - 0.5 * k, math.pi * square)
        rings[edge - 1] += weight * (area - inside)
        arcs[edge] += arc_weight * k / D
        inside = area
    if last < edges - 1:
        rings[last] += weight * (math.pi * square - inside)
