"""Discs → Cartesian cells: cut into rectangles, exactly, by compiled loops over spheres, rows and Gauss points.

With a and b the distances of two edges from a disc's centre, at most its radius s, the part of the disc between its
centre lines and these edges is P(a, b) = |a b| where their corner lies inside it, g(|a|) + g(|b|) − π s²/4 otherwise,
g(a) = (a √(s² − a²) + s² asin(a/s))/2, with the sign of a b. Rectangles are second differences of P, so that whatever
the cells, the disc is kept. Through a face flows the velocity across it times the chord of the disc on its edge.
"""

from __future__ import annotations

import math

import numpy as np

from granpipe.field import Array
from granpipe.homogenize.compiled_numba import compiled


@compiled
def add(
    position: Array,
    radius: Array,
    velocity: Array,
    x_edges: Array,
    y_edges: Array,
    z_edges: Array,
    flat: bool,
    cut: bool,
    node: Array,
    weight: Array,
    volume: Array,
    flow_x: Array,
    flow_z: Array,
    flow_y: Array,
) -> None:
    """Add spheres to (nz, ny, nx) volume and the flows through the faces; in the plane ny is 1, and flow_y unused."""
    rows = len(z_edges) - 1
    cell = (z_edges[-1] - z_edges[0]) / rows
    along_x, along_y = np.empty((2, len(x_edges))), np.empty((2, len(y_edges)))
    for n in range(len(radius)):
        x, y, z, a = position[n, 0], position[n, 1], position[n, 2], radius[n]
        low, high = z - a, z + a
        for row in range(max(math.floor((low - z_edges[0]) / cell), 0), rows):
            start, end = max(z_edges[row], low), min(z_edges[row + 1], high)
            half = 0.5 * (end - start)
            if half <= 0:
                if z_edges[row] > high:
                    break
                continue
            for g in range(len(node)):
                offset = start + half + half * node[g] - z
                share = half * weight[g]
                s = math.sqrt(max(a * a - offset * offset, 0.0))
                first_x, last_x = _edges(x, s, x_edges, True, along_x)
                first_y, last_y = _edges(y, s, y_edges, not flat or cut, along_y)
                _areas(s, share, first_x, last_x, first_y, last_y, along_x, along_y, volume[row])
                for j in range(first_y, last_y):
                    for i in range(first_x, last_x + 1):
                        chord = _chord(along_x[0, i], along_y[0, j], along_y[0, j + 1], s)
                        flow_x[row, j, i] += share * velocity[n, 0] * chord
                if not flat:
                    for j in range(first_y, last_y + 1):
                        for i in range(first_x, last_x):
                            chord = _chord(along_y[0, j], along_x[0, i], along_x[0, i + 1], s)
                            flow_y[row, j, i] += share * velocity[n, 1] * chord
        for level in range(max(math.floor((low - z_edges[0]) / cell) + 1, 0), rows + 1):
            offset = z_edges[level] - z
            if offset >= a:
                break
            s = math.sqrt(max(a * a - offset * offset, 0.0))
            first_x, last_x = _edges(x, s, x_edges, True, along_x)
            first_y, last_y = _edges(y, s, y_edges, not flat or cut, along_y)
            _areas(s, velocity[n, 2], first_x, last_x, first_y, last_y, along_x, along_y, flow_z[level])


@compiled
def _edges(centre: float, s: float, edges: Array, cut: bool, along: Array) -> tuple[int, int]:
    """First and last of the edges of a grid that enclose a disc; their distance from its centre, at most s, and g."""
    cells = len(edges) - 1
    first, last = 0, cells
    if cut:
        step = (edges[-1] - edges[0]) / cells
        first = max(math.floor((centre - s - edges[0]) / step), 0)
        last = min(math.floor((centre + s - edges[0]) / step) + 1, cells)
    for k in range(first, last + 1):
        a = min(max(edges[k] - centre, -s), s) if cut else (s if k else -s)
        along[0, k] = a
        sine = min(abs(a) / s, 1.0) if s > 0 else 0.0
        along[1, k] = 0.5 * s * s * (sine * math.sqrt(1 - sine * sine) + math.asin(sine))
    return first, last


@compiled
def _areas(
    s: float,
    weight: float,
    first_x: int,
    last_x: int,
    first_y: int,
    last_y: int,
    along_x: Array,
    along_y: Array,
    cells: Array,
) -> None:
    """Add weight × the part of a disc in each rectangle to (ny, nx) cells."""
    for j in range(first_y, last_y):
        lower = _part(along_x, first_x, along_y, j, s)
        upper = _part(along_x, first_x, along_y, j + 1, s)
        for i in range(first_x, last_x):
            next_lower = _part(along_x, i + 1, along_y, j, s)
            next_upper = _part(along_x, i + 1, along_y, j + 1, s)
            cells[j, i] += weight * ((next_upper - upper) - (next_lower - lower))
            lower, upper = next_lower, next_upper


@compiled
def _part(along_x: Array, i: int, along_y: Array, j: int, s: float) -> float:
    """P(a, b): the part of a disc between its centre lines and two edges, with the sign of a b."""
    a, b = along_x[0, i], along_y[0, j]
    if a * a + b * b < s * s:
        return float(a * b)
    beyond = max(along_x[1, i] + along_y[1, j] - 0.25 * math.pi * s * s, 0.0)
    return math.copysign(beyond, a * b)


@compiled
def _chord(edge: float, low: float, high: float, s: float) -> float:
    """Length of the chord of a disc on an edge, between two ends."""
    half = math.sqrt(max(s * s - edge * edge, 0.0))
    return min(max(high, -half), half) - min(max(low, -half), half)
