"""How far particles overlap: the measure of softness, taken from a bed as it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.field import Array


@dataclass(frozen=True)
class Overlap:
    """Overlap of the touching pairs of a bed over their mean diameter, δ / (a₁ + a₂).

    Parameters
    ----------
    mean : over the contacts
    p99 : 99th percentile
    contacts : number of pairs that touch
    """

    mean: float
    p99: float
    contacts: int


def measure_overlap(position: Array, radius: Array) -> Overlap:
    """Overlap of spheres at (n, 3) positions with (n,) radii [m]; all 0 where none touch."""
    from scipy.spatial import cKDTree

    if not len(radius):
        return Overlap(0.0, 0.0, 0)
    one, other = cKDTree(position).query_pairs(2 * float(radius.max()), output_type="ndarray").T
    distance = np.linalg.norm(position[one] - position[other], axis=1)
    touching = distance < radius[one] + radius[other]
    relative = 1 - distance[touching] / (radius[one] + radius[other])[touching]
    if not len(relative):
        return Overlap(0.0, 0.0, 0)
    return Overlap(float(relative.mean()), float(np.quantile(relative, 0.99)), len(relative))
