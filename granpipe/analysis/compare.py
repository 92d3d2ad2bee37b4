"""Two fields of one vessel compared: their difference beyond statistical error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Box, Field, Grid, Mask, cell_squares, section_rows

ONE_SIDED_95 = 1.645

NOISE_MARGIN = 0.3
"""Part by which the square of the noise may be larger than the standard errors say: fields of several seeds scatter by
0.96 to 1.13 times what they claim (docs/validation/space_vessels.md)."""


@dataclass(frozen=True)
class Difference:
    """Difference of two fields over some cells, relative to the first: E = √(Σ A |δU|² / Σ A |U|²).

    A are areas of rings; in space they are all the same.

    Parameters
    ----------
    name : of the section, or "whole"
    observed : E as it stands
    noise : what the statistical errors of both contribute to it on average
    noise_free : √(E² − noise²), 0 where noise explains all
    upper : 95 % upper bound of the noise-free difference
    noise_known : whether that is all the noise there is; else the bound holds the rest of it, and is too high
    """

    name: str
    observed: float
    noise: float
    noise_free: float
    upper: float
    noise_known: bool = True

    @property
    def lower(self) -> float:
        """95 % lower bound of the noise-free difference, with a margin for noise that is told too small."""
        spread = self.upper**2 - self.noise_free**2
        return sqrt(max(0.0, self.observed**2 - (1 + NOISE_MARGIN) * self.noise**2 - spread))

    def verdict(self, tolerance: float) -> str:
        """Whether they agree (upper bound within the tolerance) or differ (lower one beyond it); else unresolved."""
        if self.upper <= tolerance:
            return "agree"
        return "differ" if self.noise_known and self.lower > tolerance else "unresolved"


def compare(one: Field, other: Field, levels: Mapping[str, tuple[float, float]], diameter: float) -> list[Difference]:
    """Differences over the whole and over each section, bulk cells of both only.

    The bound takes the cells' errors as correlated over one particle diameter: a sum over n cells varies like one over
    n (h/d)² independent ones, in space n (h/d)³. Bulk velocities at the flow rate of each case are compared.

    Parameters
    ----------
    one, other : fields on the same grid; an error bar that a field does not have counts as none
    levels : section → upper and lower end [m]
    diameter : particle diameter d [m]

    Raises
    ------
    DataError : the fields have different grids, or no bulk in common
    """
    grid = one.grid
    if len(grid.shape) != len(other.grid.shape):
        raise DataError(
            "one of the fields is in space, the other is not; compare two of a kind: average the snapshots of the run "
            "in space (dem.keep_snapshots: all) on the rings of the other by `granpipe homogenize --case`"
        )
    if grid.measure.axial != other.grid.measure.axial:
        raise DataError("one field is that of a body of revolution, the other is not; compare two of a kind")
    if grid.shape != other.grid.shape or not _same_edges(grid, other.grid):
        raise DataError(
            f"the grids differ ({_described(grid)} and {_described(other.grid)}); set the same homogenize.cell in both "
            "cases"
        )
    if not np.allclose(grid.r_edges, other.grid.r_edges, rtol=0, atol=1e-6 * grid.cell):
        ends = (f"{edges[0]:.4g} … {edges[-1]:.4g} m" for edges in (grid.r_edges, other.grid.r_edges))
        raise DataError(
            f"the fields lie at different {grid.measure.letter}: {' and '.join(ends)}; these are two vessels"
        )
    if not (one.bulk & other.bulk).any():
        raise DataError("the fields have no cell in common in which solids flow or rest; there is nothing to compare")
    cells = Cells.of(one, other)
    shared = max(1.0, (diameter / grid.cell) ** len(grid.shape))
    known = not any(map(lacks_error_bar, (one, other)))
    found = (cells.compare(name, rows, shared) for name, rows in section_rows(grid, levels).items())
    return [replace(difference, noise_known=known) for difference in found]


def lacks_error_bar(field: Field) -> bool:
    """Whether a field is an average over particles whose noise is not known; a fluid has none."""
    return field.raw_flux_z is not None and field.flux_z_se is None


def difference_table(found: Iterable[Difference], tolerance: float) -> str:
    """The differences as a table for people, with a verdict for each."""
    lines = [f"{'section':<12}{'difference':>12}{'noise':>10}{'noise-free':>12}{'95 % below':>12}"]
    for d in found:
        noise = f"{d.noise:>10.2%}{d.noise_free:>12.2%}" if d.noise_known else f"{'unknown':>10}{'unknown':>12}"
        numbers = f"{d.observed:>12.2%}{noise}{d.upper:>12.2%}"
        lines.append(f"{d.name:<12}{numbers}  {d.verdict(tolerance)}")
    return "\n".join(lines)


@dataclass(frozen=True)
class Cells:
    """Squares at the middle of each cell [m²/s²], (nz, nr) or (nz, ny, nx): of the first field, of the difference, of
    its error.
    """

    weight: Array
    field: Array
    apart: Array
    variance: Array

    @classmethod
    def of(cls, one: Field, other: Field) -> Cells:
        a, b = one.velocity_scale, other.velocity_scale
        return cls(
            weight=np.where(one.bulk & other.bulk, one.grid.ring_area, 0.0),
            field=_squares(*(a * flux for flux in _fluxes(one))),
            apart=_squares(*(a * flux - b * its for flux, its in zip(_fluxes(one), _fluxes(other), strict=True))),
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
        return Difference(name, sqrt(observed / total), sqrt(noise / total), sqrt(free / total), sqrt(upper / total))


def error_squares(field: Field) -> Array:
    """Squared standard error of the bulk velocity in each cell; faces beside it share their particles, so no less."""
    errors = [field.flux_r_se, field.flux_z_se, *([] if field.flux_y is None else [field.flux_y_se])]
    known = [error * field.velocity_scale for error in errors if error is not None]
    if len(known) < len(errors):
        return np.zeros(field.grid.shape)
    return np.nan_to_num(_squares(*known), nan=0.0)


def thirds(grid: Grid) -> dict[str, tuple[float, float]]:
    """Upper, middle and lower third of a grid's height: upper and lower level of each [m]."""
    levels = np.linspace(grid.z_edges[-1], grid.z_edges[0], 4).tolist()
    return dict(zip(("upper third", "middle third", "lower third"), pairwise(levels), strict=True))


def _fluxes(field: Field) -> tuple[Array, ...]:
    """Along r and z, and in space along y."""
    return field.flux_r, field.flux_z, *(() if field.flux_y is None else (field.flux_y,))


def _squares(r: Array, z: Array, y: Array | None = None) -> Array:
    """Square of a vector in the middle of each cell, from its components on the faces."""
    if y is None:
        return cell_squares(r, z)
    middles = 0.5 * (r[..., 1:] + r[..., :-1]), 0.5 * (y[:, 1:] + y[:, :-1]), 0.5 * (z[1:] + z[:-1])
    return np.asarray(sum(one**2 for one in middles))


def _same_edges(one: Grid, other: Grid) -> bool:
    pairs = [(one.z_edges, other.z_edges)]
    if isinstance(one, Box) and isinstance(other, Box) and not one.flat:
        pairs = list(zip(one.lines, other.lines, strict=True))
    return all(np.allclose(a, b, atol=1e-6 * one.cell) for a, b in pairs)


def _described(grid: Grid) -> str:
    return f"{' × '.join(map(str, grid.shape))} cells of {grid.cell:g} m"
