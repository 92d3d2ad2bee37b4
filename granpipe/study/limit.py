"""How a field changes along one setting, and its limit: least squares with error bars.

Richardson's extrapolation, face by face: F(x) = F₀ + c xᵖ, with known variances of every F.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.field import Array

CLEAR = 2.0
"""Misfit from which first order is given up, where three points or more can tell.

The lesser misfit alone would take the second order for noise half the time, and the limit for nearer than it is.
"""


@dataclass(frozen=True)
class Slope:
    """How a quantity changes with xᵖ: c is a sum of the values at the points, each with its part.

    Parameters
    ----------
    order : p
    parts : (n,) of each point's values in c
    misfit : Σ of squares of what the line leaves, over what the variances let expect; NaN for two settings, through
        which any power goes alike
    """

    order: float
    parts: Array
    misfit: float

    def between(self, x: float, limit: float = 0.0) -> Array:
        """(n,) part of each point's values in the change from the limit to x."""
        return np.asarray(self.parts * (x**self.order - limit**self.order))


def fit_slope(x: Sequence[float], values: Array, variances: Array, weight: Array) -> Slope:
    """The slope over points of two or more settings.

    Points are weighted by their mean variance, so that the slope is linear in the values.

    Parameters
    ----------
    x : (n,) the setting, in the power in which the first order is expected to be linear
    values : (n, k, …) k components
    variances : (n, …) of the values, all components together
    weight : (…) of each place, 0 where it does not count
    """
    first, second = (_fit(np.asarray(x, dtype=float), order, values, variances, weight) for order in (1.0, 2.0))
    return second if first.misfit > max(CLEAR, second.misfit) else first


def _fit(x: Array, order: float, values: Array, variances: Array, weight: Array) -> Slope:
    means = (variances * weight).reshape(len(x), -1).sum(axis=1)
    scale = means.max() or 1.0
    importance = 1 / np.maximum(means / scale, 1e-12)
    power = x**order
    centre = importance @ power / importance.sum()
    part = importance * (power - centre)
    part = part / (part @ power)
    level, slope = (np.tensordot(parts, values, 1) for parts in (importance / importance.sum(), part))
    rest = values - level - slope * (power - centre).reshape(-1, *[1] * slope.ndim)
    left = ((rest**2).sum(axis=1) * weight).reshape(len(x), -1).sum(axis=1) @ importance / scale
    misfit = float(left / (len(x) - 2)) if len(np.unique(x)) > 2 else np.nan
    return Slope(order, part, misfit)
