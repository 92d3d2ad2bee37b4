"""The slope of heaps as a smooth function of friction, with its error, and the pairs that give one slope.

Like the friction of the bulk (`granpipe.fluid.bulk_friction`), the slope grows with sliding friction and levels off;
rolling friction adds to it the more, the less particles slide:

    tan α = c₀ + c₁ s + c₂ s q,   s = 1 − e^(−μ/m),   q = 1 − e^(−μ_r/ρ)

c₀, c₁, c₂ are fitted to the heaps by least squares. Their errors come from the scatter of the heaps about the fit,
which holds both the noise of a heap and what the form cannot follow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from granpipe.errors import RunError
from granpipe.field import Array
from granpipe.repose.heap import Pair

SLIDING_SCALE, ROLLING_SCALE = 0.3, 0.325
"""m, ρ; ρ is that of the bulk friction, and both fit the heaps of docs/validation/repose.md."""

LEAST, MOST = Pair(0.1, 0.0), Pair(1.0, 0.5)
"""Frictions among which pairs are searched. Beyond the most the slope hardly grows."""

CONFIDENCE = 0.95

_TERMS = 3
_FINE = 501  # rolling frictions at which a slope is looked for


@dataclass(frozen=True)
class Crossing:
    """A pair on the valley: sliding friction, the rolling friction that gives the slope, and its 95 % range.

    A range that ends at the least or most rolling friction may reach beyond it.
    """

    pair: Pair
    low: float
    high: float


@dataclass(frozen=True)
class Response:
    """The fitted surface.

    Parameters
    ----------
    coefficients : c₀, c₁, c₂ (3,)
    covariance : of them (3, 3)
    scatter : of the slope of a heap about the surface, standard deviation
    freedom : heaps less coefficients
    """

    coefficients: Array
    covariance: Array
    scatter: float
    freedom: int

    def slope(self, friction: Array | float, rolling: Array | float) -> Array:
        """tan α for friction and rolling friction of any shape."""
        return np.asarray(_terms(friction, rolling) @ self.coefficients)

    def error(self, friction: Array | float, rolling: Array | float) -> Array:
        """Standard error of `slope`."""
        terms = _terms(friction, rolling)
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", terms, self.covariance, terms)))

    @property
    def reach(self) -> tuple[float, float]:
        """Least and greatest slope of any pair."""
        return float(self.slope(LEAST.friction, LEAST.rolling)), float(self.slope(MOST.friction, MOST.rolling))

    def crossing(self, friction: float, slope: float, error: float = 0.0) -> Crossing | None:
        """The rolling friction that gives a slope together with this sliding friction; None where none does.

        Parameters
        ----------
        error : standard error of the wanted slope
        """
        rolling = np.linspace(LEAST.rolling, MOST.rolling, _FINE)
        found = self.slope(friction, rolling)
        if not found[0] <= slope <= found[-1]:
            return None
        good = rolling[self._agrees(friction, rolling, slope, error)]
        return Crossing(Pair(friction, float(np.interp(slope, found, rolling))), float(good.min()), float(good.max()))

    def frictions(self, rolling: float, slope: float, error: float = 0.0) -> tuple[float, float]:
        """95 % range of the sliding friction that gives a slope together with this rolling friction."""
        friction = np.linspace(LEAST.friction, MOST.friction, _FINE)
        good = friction[self._agrees(friction, rolling, slope, error)]
        return float(good.min()), float(good.max())

    def _agrees(self, friction: Array | float, rolling: Array | float, slope: float, error: float) -> Array:
        """Where the surface cannot be told from a slope; the nearest point always belongs to it."""
        apart = np.abs(self.slope(friction, rolling) - slope)
        factor = student.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom)
        return np.asarray((apart <= factor * np.hypot(self.error(friction, rolling), error)) | (apart == apart.min()))


def fit(pairs: Sequence[Pair], slopes: Sequence[float]) -> Response:
    """The surface through measured slopes.

    Raises
    ------
    RunError : the slopes do not grow with both frictions, so that no angle can be inverted
    """
    terms = _terms(np.array([pair.friction for pair in pairs]), np.array([pair.rolling for pair in pairs]))
    coefficients, *_ = np.linalg.lstsq(terms, np.array(slopes), rcond=None)
    freedom = len(pairs) - _TERMS
    scatter = math.sqrt(float(np.sum((terms @ coefficients - slopes) ** 2)) / freedom)
    if not (coefficients[1] > 0 and coefficients[2] > 0):
        raise RunError(
            "the slopes of the heaps do not grow with friction: this material's particles do not pile up as spheres "
            "with friction do; check material.size and contact"
        )
    covariance = np.asarray(scatter**2 * np.linalg.inv(terms.T @ terms), dtype=float)
    return Response(coefficients, covariance, scatter, freedom)


def _terms(friction: Array | float, rolling: Array | float) -> Array:
    """(…, 3): what the coefficients are multiplied with."""
    s = 1 - np.exp(-np.asarray(friction) / SLIDING_SCALE)
    q = 1 - np.exp(-np.asarray(rolling) / ROLLING_SCALE)
    s, q = np.broadcast_arrays(s, q)
    return np.stack([np.ones_like(s), s, s * q], axis=-1)
