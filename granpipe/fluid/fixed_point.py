"""Anderson's acceleration of a fixed-point iteration x ← G(x) (Walker & Ni, SIAM J. Numer. Anal. 49 (2011) 1715)."""

from __future__ import annotations

from collections import deque

import numpy as np

from granpipe.field import Array


class Anderson:
    """Proposes the next x from the last few pairs of x and G(x).

    Parameters
    ----------
    scale : (n,) what each entry counts in the least squares
    depth : number of earlier pairs
    damping : part of the way to G(x) that is taken
    """

    def __init__(self, scale: Array, depth: int = 5, damping: float = 0.7) -> None:
        self._scale, self._damping = scale, damping
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=depth + 1)

    def next(self, x: Array, image: Array) -> Array:
        """The next x after G(x) = image."""
        self._pairs.append((x, image - x))
        points = np.stack([p for p, _ in self._pairs], axis=1)
        misses = np.stack([m for _, m in self._pairs], axis=1)
        plain = x + self._damping * misses[:, -1]
        if misses.shape[1] == 1:
            return np.asarray(plain)
        change = np.diff(misses, axis=1)
        share = np.linalg.lstsq(self._scale[:, None] * change, self._scale * misses[:, -1], rcond=1e-8)[0]
        return np.asarray(plain - (np.diff(points, axis=1) + self._damping * change) @ share)
