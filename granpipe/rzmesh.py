"""The triangle mesh of a section, r–z or x–z: what the mesher hands to the fluid and the exporters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granpipe.field import ROUND, Array, Mask, Measure

Index = NDArray[np.int64]
Names = NDArray[np.str_]


@dataclass(frozen=True)
class RZMesh:
    """Triangles of an r–z half section, or of the x–z section of a slab, with a name on every boundary edge.

    Names: ``axis``, ``inlet``, ``outlet``, ``wall:<section>`` (or ``wall:<piece>``, counted from the top, where the
    outline has no sections) and ``obstacle:<name>``.

    Parameters
    ----------
    points : (n, 2) r and z [m]
    triangles : (m, 3) points of each triangle, counter-clockwise
    edges : (k, 2) points of each boundary edge, the inside on its left
    names : (k,) name of each boundary edge
    measure : what the section stands for
    """

    points: Array
    triangles: Index
    edges: Index
    names: Names
    measure: Measure = ROUND

    def named(self, prefix: str) -> Mask:
        """(k,) True for the edges whose name is `prefix`, or starts with ``<prefix>:``."""
        return np.asarray((self.names == prefix) | np.char.startswith(self.names, f"{prefix}:"))

    def ends(self) -> Array:
        """(k, 2, 2) [edge, end, (r, z)] coordinates of the boundary edges [m]."""
        return np.asarray(self.points[self.edges])

    def normals(self) -> Array:
        """(k, 2) outward unit normals (r, z) of the boundary edges."""
        along = np.diff(self.ends(), axis=1)[:, 0]
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        return np.asarray(outward / np.hypot(*outward.T)[:, None])

    def outlet(self) -> tuple[float, float]:
        """r of the middle of the outlet, and its radius [m]; of a slot half its width."""
        r = self.ends()[self.named("outlet"), :, 0]
        middle = 0.0 if self.measure.axial else 0.5 * float(r.min() + r.max())
        return middle, float(r.max()) - middle

    def free_area(self, z: Array) -> Array:
        """(...) horizontal free cross-section Ω at the heights `z` [m²], from the boundary edges that cross them.

        Each edge that the level cuts counts ±`Measure.area` from 0, positive where the inside lies towards smaller r.
        Where Ω jumps the value is that just above.
        """
        (r0, z0), (r1, z1) = self.ends().transpose(1, 2, 0)
        level = np.asarray(z)[..., None]
        rising = (z0 <= level) & (level < z1)
        falling = (z1 <= level) & (level < z0)
        part = np.divide(level - z0, z1 - z0, out=np.zeros(np.broadcast(level, z0).shape), where=z0 != z1)
        radius = r0 + part * (r1 - r0)
        return np.asarray(np.sum((rising * 1.0 - falling) * self.measure.area(np.zeros(()), radius), axis=-1))

    def between(self, low: float, high: float) -> tuple[RZMesh, Index]:
        """The triangles whose middles lie between two heights [m], and the points (n',) of this mesh that they keep.

        The ends are as uneven as the triangles are; the edges there are named ``inlet`` and ``outlet``.
        """
        middle = self.points[self.triangles, 1].mean(axis=1)
        kept, triangles = np.unique(self.triangles[(middle > low) & (middle < high)], return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        number = np.full(len(self.points), -1)
        number[kept] = np.arange(len(kept))
        sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        edges, points = sides[first[count == 1]], self.points[kept]
        before = {tuple(sorted(edge)): name for edge, name in zip(number[self.edges].tolist(), self.names, strict=True)}
        cut = np.where(points[edges, 1].mean(axis=1) > 0.5 * (low + high), "inlet", "outlet")
        names = [before.get(tuple(sorted(edge)), end) for edge, end in zip(edges.tolist(), cut, strict=True)]
        named = np.array(names, dtype=self.names.dtype)
        return replace(self, points=points, triangles=triangles, edges=edges, names=named), kept
