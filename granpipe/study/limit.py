"""How a field changes along one setting, and its limit: least squares with error bars.

Richardson's extrapolation, face by face: F(x) = F₀ + c xᵖ, with known variances of every F.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.field import Array

ORDERS = (1.0, 2.0)
"""Powers p that are tried where three or more points can tell them apart; the first one otherwise."""


@dataclass(frozen=True)
class Slope:
    """How a quantity changes with xᵖ.

    Parameters
    ----------
    order : p
    value : c, of the shape of one point's values
    variance : of c, of the shape of one point's variances
    misfit : Σ of squares of what the line leaves, over what the variances let expect; NaN for two points
    """

    order: float
    value: Array
    variance: Array
    misfit: float

    def between(self, x: float, limit: float = 0.0) -> tuple[Array, Array]:
        """Change from the limit to x, and its variance."""
        step = x**self.order - limit**self.order
        return self.value * step, self.variance * step**2


def fit_slope(x: Sequence[float], values: Array, variances: Array, weight: Array) -> Slope:
    """The slope over two or more points.

    Points are weighted by their mean variance, so that the slope is linear in the values and its own variance exact.

    Parameters
    ----------
    x : (n,) the setting, in the power in which the first order is expected to be linear
    values : (n, k, …) k components
    variances : (n, …) of the values, all components together
    weight : (…) of each place, 0 where it does not count
    """
    orders = ORDERS if len(x) > 2 else ORDERS[:1]
    found = [_fit(np.asarray(x, dtype=float), order, values, variances, weight) for order in orders]
    return min(found, key=lambda slope: slope.misfit) if len(x) > 2 else found[0]


def _fit(x: Array, order: float, values: Array, variances: Array, weight: Array) -> Slope:
    means = (variances * weight).reshape(len(x), -1).sum(axis=1)
    scale = means.max() or 1.0
    importance = 1 / np.maximum(means / scale, 1e-12)
    power = x**order
    centre = importance @ power / importance.sum()
    part = importance * (power - centre)
    part = part / (part @ power)
    slope = np.tensordot(part, values, 1)
    level = np.tensordot(importance / importance.sum(), values, 1)
    rest = values - level - slope * (power - centre).reshape(-1, *[1] * slope.ndim)
    left = ((rest**2).sum(axis=1) * weight).reshape(len(x), -1).sum(axis=1) @ importance / scale
    misfit = float(left / (len(x) - 2)) if len(x) > 2 else np.nan
    return Slope(order, slope, np.tensordot(part**2, variances, 1), misfit)
