"""OBJ: corners and triangles. Faces with more corners are cut into triangles; all else in the file is passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granpipe.drawings.lines import Points
from granpipe.errors import CaseError

_BENT = 1e-6  # cosine by which a corner of a convex face may turn the wrong way


def read_obj(path: Path) -> tuple[Points, NDArray[np.int64]]:
    """(n, 3) corners and (m, 3) which of them each triangle has.

    Raises
    ------
    CaseError : a line is damaged, a face has corners that are not there, or is not convex
    """
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        kind, *words = line.split("#")[0].split() or [""]
        try:
            if kind == "v":
                points.append([float(one) for one in words[:3]])
                if len(words) < 3:
                    raise ValueError
            elif kind == "f":
                face = [int(word.split("/")[0]) for word in words]
                corners = [one - 1 if one > 0 else len(points) + one for one in face]  # below 0: counted from here
                if 0 in face or min(corners, default=0) < 0 or max(corners, default=0) >= len(points):
                    raise CaseError(f"line {number}: a face with corners that are not there")
                if len(face) < 3:
                    raise ValueError
                if len(face) > 3 and not _convex(np.array([points[one] for one in corners])):
                    raise CaseError(f"line {number}: a face of {len(face)} corners is not convex: export triangles")
                triangles += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
        except ValueError:
            raise CaseError(f"line {number} is damaged: {line.strip()[:60]!r}") from None
    return np.array(points, dtype=float).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _convex(corners: Points) -> bool:
    """Whether a polygon (n, 3) turns one way all round."""
    sides = np.roll(corners, -1, axis=0) - corners
    turns = np.cross(np.roll(sides, 1, axis=0), sides)
    normal = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0]).sum(axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    return bool((turns @ normal >= -_BENT * np.linalg.norm(normal) * lengths * np.roll(lengths, 1)).all())
