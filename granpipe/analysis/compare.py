"""Two fields of one vessel compared: their difference beyond statistical error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Mask, cell_squares, section_rows

ONE_SIDED_95 = 1.645


@dataclass(frozen=True)
class Difference:
    """Difference of two fields over some cells, relative to the first: E = √(Σ A |δU|² / Σ A |U|²), A ring areas.

    Parameters
    ----------
    name : of the section, or "whole"
    observed : E as it stands
    noise : what the statistical errors of both contribute to it on average
    noise_free : √(E² − noise²), 0 where noise explains all
    upper : 95 % upper bound of the noise-free difference
    """

    name: str
    observed: float
    noise: float
    noise_free: float
    upper: float

    def verdict(self, tolerance: float) -> str:
        """Whether they agree: the upper bound within the tolerance; else they differ, or noise leaves it unresolved."""
        if self.upper <= tolerance:
            return "agree"
        return "differ" if self.noise_free > tolerance else "unresolved"


def compare(one: Field, other: Field, levels: Mapping[str, tuple[float, float]], diameter: float) -> list[Difference]:
    """Differences over the whole and over each section, bulk cells of both only.

    The bound takes the cells' errors as correlated over one particle diameter: a sum over n cells varies like one over
    n (h/d)² independent ones. Bulk velocities at the flow rate of each case are compared.

    Parameters
    ----------
    one, other : fields on the same grid; a standard error that a field does not have counts as none
    levels : section → upper and lower end [m]
    diameter : particle diameter d [m]

    Raises
    ------
    DataError : the fields have different grids, or no bulk in common
    """
    grid = one.grid
    if grid.shape != other.grid.shape or not np.allclose(grid.z_edges, other.grid.z_edges):
        raise DataError(
            f"the grids differ ({grid.shape[0]} × {grid.shape[1]} cells of {grid.cell:g} m and {other.grid.shape[0]} × "
            f"{other.grid.shape[1]} of {other.grid.cell:g} m); set the same homogenize.cell in both cases"
        )
    if not (one.bulk & other.bulk).any():
        raise DataError("the fields have no cell in common in which solids flow or rest; there is nothing to compare")
    cells = Cells.of(one, other)
    shared = max(1.0, (diameter / grid.cell) ** 2)
    return [cells.compare(name, rows, shared) for name, rows in section_rows(grid, levels).items()]


def difference_table(found: Iterable[Difference], tolerance: float) -> str:
    """The differences as a table for people, with a verdict for each."""
    lines = [f"{'section':<12}{'difference':>12}{'noise':>10}{'noise-free':>12}{'95 % below':>12}"]
    for d in found:
        numbers = f"{d.observed:>12.2%}{d.noise:>10.2%}{d.noise_free:>12.2%}{d.upper:>12.2%}"
        lines.append(f"{d.name:<12}{numbers}  {d.verdict(tolerance)}")
    return "\n".join(lines)


@dataclass(frozen=True)
class Cells:
    """(nz, nr) squares at the middle of each cell [m²/s²]: of the first field, of the difference, of its error."""

    weight: Array
    field: Array
    apart: Array
    variance: Array

    @classmethod
    def of(cls, one: Field, other: Field) -> Cells:
        a, b = one.velocity_scale, other.velocity_scale
        return cls(
            weight=np.where(one.bulk & other.bulk, one.grid.ring_area, 0.0),
            field=cell_squares(one.flux_r * a, one.flux_z * a),
            apart=cell_squares(one.flux_r * a - other.flux_r * b, one.flux_z * a - other.flux_z * b),
            variance=error_squares(one) + error_squares(other),
        )

    def _sums(self, rows: Mask) -> tuple[float, float, float]:
        """Σ A |δU|², Σ A σ², and the variance of the first, Σ A² σ² (2 σ² + 4 |δU|²), over some rows."""
        weight, square, variance = (array[rows] for array in (self.weight, self.apart, self.variance))
        spread = float((weight**2 * variance * (2 * variance + 4 * np.maximum(square - variance, 0))).sum())
        return float((weight * square).sum()), float((weight * variance).sum()), spread

    def compare(self, name: str, rows: Mask, shared: float) -> Difference:
        total = float((self.weight * self.field)[rows].sum())
        if total == 0:
            return Difference(name, 0.0, 0.0, 0.0, 0.0)
        observed, noise, spread = self._sums(rows)
        free = max(0.0, observed - noise)
        upper = free + ONE_SIDED_95 * sqrt(shared * spread)
        return Difference(name, *(sqrt(value / total) for value in (observed, noise, free, upper)))


def error_squares(field: Field) -> Array:
    """(nz, nr) squared standard error of the bulk velocity; neighbouring faces share their particles, so no less."""
    if field.flux_r_se is None or field.flux_z_se is None:
        return np.zeros(field.grid.shape)
    squares = cell_squares(field.flux_r_se * field.velocity_scale, field.flux_z_se * field.velocity_scale)
    return np.nan_to_num(squares, nan=0.0)
