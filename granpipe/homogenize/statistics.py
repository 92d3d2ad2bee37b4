"""Statistics of a correlated run: onset of the steady state, blocks, standard errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array
from granpipe.homogenize.average import Sums, merge

LEAST_BLOCKS = 7
_BATCH = 5  # MSER-5


def onset(*series: Array) -> int:
    """Number of samples to leave out at the beginning, at most half of them: MSER-5 of several series together.

    White (1997): of all truncations, the one whose remaining mean has the smallest estimated error, s²/n of what is
    left, on means of five samples. Several series are summed, each over its own variance in the second half of the
    run, so that none is steady before all are; the columns of one series count together as one.

    Parameters
    ----------
    series : (n,) or (n, k) each, of the same n samples: row flows, mass, kinetic energy
    """
    count = len(series[0]) // _BATCH
    if count < 2:
        return 0
    batches = [_batch_means(np.asarray(one, dtype=float).reshape(len(one), -1)) for one in series]
    left = np.arange(count, 0, -1)[: count // 2 + 1]
    spread = sum(_spread_of_rest(one, len(left)) for one in batches)
    return int(np.argmin(spread / left.astype(float) ** 2)) * _BATCH


def _batch_means(series: Array) -> Array:
    """(n // 5, k) means of five samples."""
    count = len(series) // _BATCH
    return np.asarray(series[: count * _BATCH].reshape(count, _BATCH, -1).mean(axis=1))


def _spread_of_rest(batches: Array, truncations: int) -> Array:
    """(truncations,) Σ(x − mean)² of what is left without the first 0, 1, 2 … batches, over the late variance."""
    late = batches[len(batches) // 2 :].var(axis=0)
    if not (late > 0).any():
        return np.zeros(truncations)
    scaled = batches[:, late > 0] / np.sqrt(late[late > 0])
    left = np.arange(len(batches), 0, -1)[:truncations, None]
    # sums of all remainders at once, taken backwards
    total = np.cumsum(scaled[::-1], axis=0)[::-1][:truncations]
    square = np.cumsum(scaled[::-1] ** 2, axis=0)[::-1][:truncations]
    return np.asarray((square - total**2 / left).mean(axis=1))


def blocks(parts: Sequence[Sums], least: int = LEAST_BLOCKS) -> list[Sums]:
    """Join neighbouring segments into the longest equal blocks that leave at least `least` of them.

    Long blocks are nearly independent of each other; left-over segments at the beginning go into no block.
    """
    if len(parts) < least:
        raise DataError(f"{len(parts)} segments give no standard error; at least {least} are needed: average longer")
    ordered = sorted(parts, key=lambda part: part.start)
    length = len(ordered) // least
    first = len(ordered) % length
    return [merge(ordered[at : at + length]) for at in range(first, len(ordered), length)]


def standard_error(values: Array) -> Array:
    """Standard error of the mean of (blocks, …) values along the first axis."""
    return np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))
