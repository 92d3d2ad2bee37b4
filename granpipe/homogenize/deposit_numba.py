"""Discs → rings: compiled loops over spheres, rows and Gauss points.

The part of a disc of radius s at axis distance D within radius R of the axis is A = R² θ_axis + s² θ_disc − k/2, with k
four times the area of the triangle of sides R, D, s, and θ its angles, by half-angle formulas, which need no quadrant;
the integral of cos φ over the arc of the circle R inside the disc is k/D.
"""

from __future__ import annotations

import math

from granpipe.field import Array
from granpipe.homogenize.compiled_numba import compiled

_TOP = (-1.615753718733365076637e1, -7.500855792314704667340e1, -1.228866684490136173410e2, -6.485021904942025371773e1)
_BOTTOM = (1.650270098316988542046e2, 4.328810604912902668951e2, 4.853903996359136964868e2, 1.945506571482613964425e2)


@compiled
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


@compiled
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
    arc_part = arc_weight / D
    disc = math.pi * square
    inside = 0.0
    for edge in range(first, last + 1):
        R = r_edges[edge]
        across, inner, outer, far = R + D + s, R + s - D, R + D - s, D + s - R
        if inner <= 0.0:
            continue
        if outer <= 0.0:
            area = math.pi * R * R
        elif far <= 0.0:
            area = disc
        else:
            product = across * outer * far
            k = math.sqrt(inner * product)
            area = min(2 * (R * R * _angle(k, across * outer) + square * _angle(k, across * far)) - 0.5 * k, disc)
            arcs[edge] += arc_part * k
        rings[edge - 1] += weight * (area - inside)
        inside = area
    if last < edges - 1:
        rings[last] += weight * (disc - inside)


@compiled
def _angle(y: float, x: float) -> float:
    """Arctangent of y/x for x, y > 0 to the last digit, faster than the C library's ``atan2``.

    The rational function of Cephes' ``atan`` (Moshier, Methods and Programs for Mathematical Functions, 1989).
    """
    if y > 2.414213562373095 * x:  # tan 3π/8
        turn, x = 0.5 * math.pi, -x / y
    elif y > 0.66 * x:
        turn, x = 0.25 * math.pi, (y - x) / (y + x)
    else:
        turn, x = 0.0, y / x
    w = x * x
    top = -8.750608600031904122785e-1
    for c in _TOP:
        top = top * w + c
    bottom = w + 2.485846490142306297962e1
    for c in _BOTTOM:
        bottom = bottom * w + c
    return turn + (x * w * top / bottom + x)
