"""Branches of contacts → bins of rings: compiled loops over contacts and the bins that each branch crosses."""

from __future__ import annotations

import math

import numpy as np

from granpipe.field import Array
from granpipe.homogenize.compiled_numba import compiled

_GAUSS = 0.5 / math.sqrt(3)


@compiled
def add(centre: Array, end: Array, force: Array, r_edges: Array, z_edges: Array, axial: bool, total: Array) -> None:
    """Add ∫ f ⊗ l ds over the part of each branch in each bin to `total` (5, bz, br): rr, θθ, zz, rz, zr.

    l is the branch from `end` to `centre`, s runs from 0 to 1 along it. Components are those at each of its points: the
    branch is cut at the edges of the bins, and each piece has two Gauss points. In a slab, not `axial`, r is x and θ is
    y.
    """
    rows, columns = len(z_edges) - 1, len(r_edges) - 1
    cuts = np.empty(rows + 2 * columns + 6)
    for i in range(len(centre)):
        x, y, z = end[i, 0], end[i, 1], end[i, 2]
        lx, ly, lz = centre[i, 0] - x, centre[i, 1] - y, centre[i, 2] - z
        low, high = min(z, z + lz), max(z, z + lz)
        if high <= z_edges[0] or low >= z_edges[-1]:
            continue
        cuts[0], cuts[1] = 0.0, 1.0
        count = 2
        for edge in z_edges:
            if low < edge < high:
                cuts[count] = (edge - z) / lz
                count += 1
        across = lx * lx + ly * ly
        if not axial:
            for edge in r_edges:
                if min(x, x + lx) < edge < max(x, x + lx):
                    cuts[count] = (edge - x) / lx
                    count += 1
        elif across > 0:
            nearest = -(x * lx + y * ly) / across
            least = (x * ly - y * lx) ** 2 / across
            for edge in r_edges:
                square = (edge * edge - least) / across
                if square > 0:
                    for s in (nearest - math.sqrt(square), nearest + math.sqrt(square)):
                        if 0 < s < 1:
                            cuts[count] = s
                            count += 1
        ordered = np.sort(cuts[:count])
        for k in range(count - 1):
            start, length = ordered[k], ordered[k + 1] - ordered[k]
            if length <= 0:
                continue
            middle = start + 0.5 * length
            row = np.searchsorted(z_edges, z + middle * lz, side="right") - 1
            if row < 0 or row >= rows:
                continue
            distance = math.hypot(x + middle * lx, y + middle * ly) if axial else x + middle * lx
            column = max(np.searchsorted(r_edges[:-1], distance, side="right") - 1, 0)
            for sign in (-1.0, 1.0):
                s = middle + sign * _GAUSS * length
                px, py = x + s * lx, y + s * ly
                r = max(math.hypot(px, py), 1e-300)
                cosine, sine = (px / r, py / r) if axial else (1.0, 0.0)
                fr, ft, fz = (
                    force[i, 0] * cosine + force[i, 1] * sine,
                    force[i, 1] * cosine - force[i, 0] * sine,
                    force[i, 2],
                )
                lr, lt = lx * cosine + ly * sine, ly * cosine - lx * sine
                half = 0.5 * length
                total[0, row, column] += half * fr * lr
                total[1, row, column] += half * ft * lt
                total[2, row, column] += half * fz * lz
                total[3, row, column] += half * fr * lz
                total[4, row, column] += half * fz * lr
