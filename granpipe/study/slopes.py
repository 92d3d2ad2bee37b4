"""How the bulk velocity changes along an axis of a study: sums of its points' fields, and what noise does to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.analysis.compare import error_squares
from granpipe.field import Array, Field, Grid, cell_vectors
from granpipe.study.limit import Slope, fit_slope

SAME_SETTING = 1e-6
"""Settings that differ by less, relative, are the same."""


def same_setting(one: float, other: float) -> bool:
    """Whether two settings are the same."""
    return bool(np.isclose(one, other, rtol=SAME_SETTING, atol=0))


@dataclass(frozen=True)
class Term:
    """A field in a sum.

    Parameters
    ----------
    factor : by which it counts
    field : the field
    source : name of the run that it was averaged from; fields of one run share their noise
    """

    factor: float
    field: Field
    source: str


def total(terms: Iterable[Term], grid: Grid) -> tuple[Array, Array]:
    """A sum of fields: (2, nz, nr) velocity in the middle of each cell, and its variance (nz, nr).

    Fields of different runs are independent. Of two of one run, such as a whole average and one seen on larger cells,
    the noisier one is taken as the other with noise of its own added, so that their covariance is the smaller variance.
    """
    velocity, variance = np.zeros((2, *grid.shape)), np.zeros(grid.shape)
    runs: dict[str, list[tuple[float, Array]]] = {}
    for term in terms:
        velocity += term.factor * middles(term.field)
        runs.setdefault(term.source, []).append((term.factor, error_squares(term.field)))
    for of_run in runs.values():
        for factor, square in of_run:
            variance += sum(factor * other * np.minimum(square, its) for other, its in of_run)
    return velocity, variance


def middles(field: Field) -> Array:
    """(2, nz, nr) bulk velocity in the middle of each cell, at the flow rate of the case [m/s]."""
    return cell_vectors(field.flux_r, field.flux_z) * field.velocity_scale


@dataclass(frozen=True)
class AxisFit:
    """How the field changes along an axis: of which order in its setting, and how well that describes the points."""

    axis: str
    points: int
    order: float
    misfit: float | None


@dataclass(frozen=True)
class AxisPoint:
    """A point of an axis: its setting, in the power in which the error is expected to be linear, and its field."""

    setting: float
    field: Field
    source: str


@dataclass(frozen=True)
class AxisSlope:
    """How the bulk velocity changes along an axis.

    Parameters
    ----------
    fit : its order and misfit
    slope : over the settings as parts of the largest
    points : that it goes by
    limit : of the setting
    weight : (nz, nr) area of each ring, 0 where one of the fields is no bulk [m²]
    """

    fit: AxisFit
    slope: Slope
    points: tuple[AxisPoint, ...]
    limit: float
    weight: Array

    @classmethod
    def of(cls, axis: str, points: Sequence[AxisPoint], limit: float, noise: float = 1.0) -> AxisSlope:
        """From points of two settings or more.

        Parameters
        ----------
        noise : square of it, over that of the fields' standard errors
        """
        unit = max(point.setting for point in points)
        bulk = np.all([point.field.bulk for point in points], axis=0)
        weight = np.where(bulk, points[0].field.grid.ring_area, 0.0)
        slope = fit_slope(
            [point.setting / unit for point in points],
            np.array([middles(point.field) for point in points]),
            noise * np.array([error_squares(point.field) for point in points]),
            weight,
        )
        misfit = None if np.isnan(slope.misfit) else slope.misfit
        return cls(AxisFit(axis, len(points), slope.order, misfit), slope, tuple(points), limit, weight)

    def change(self, setting: float, other: float) -> list[Term]:
        """Velocity at one setting less that at another, as a sum of fields; none between equal ones."""
        if same_setting(setting, other):
            return []
        unit = max(point.setting for point in self.points)
        factors = self.slope.between(setting / unit, other / unit)
        return [
            Term(float(factor), point.field, point.source) for factor, point in zip(factors, self.points, strict=True)
        ]
