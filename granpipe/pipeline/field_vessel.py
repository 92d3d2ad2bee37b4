"""Whether a field is that of a vessel: the free area of every row of its grid against that of the outline."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid
from granpipe.geometry.outline import Outline

TOLERANCE = 0.01
"""Largest part of a row's free area that may lie outside the other's outline; the same vessel gives 0 to rounding."""


def check_vessel(field: Field, outline: Outline, path: Path) -> None:
    """Make sure that a field read from `path` is one of this vessel; one in space is not looked at.

    Raises
    ------
    DataError : it is the field of another one
    """
    if len(field.grid.shape) == 3:
        return
    low, high, slack = field.grid.z_edges[0], field.grid.z_edges[-1], 0.5 * field.grid.cell
    if field.grid.measure.axial != outline.measure.axial:
        found = f"it is one in {kind_of(field.grid)}"
    elif low < outline.z_bottom - slack or high > outline.z_top + slack:
        found = f"it covers z = {low:.4g} … {high:.4g} m, the vessel z = {outline.z_bottom:.4g} … {outline.z_top:.4g} m"
    else:
        found = other_vessel(field, outline)
    if found:
        raise DataError(f"{path} is not the field of the case beside it: {found}; run the case again")


def check_case(field: Field, case: Case, path: Path) -> None:
    """Make sure that a field read from `path` is one of this case; of one in space only that it is in space.

    Raises
    ------
    DataError : it is the field of another one
    """
    if case.vessel is None:
        check_vessel(field, Outline.from_case(case), path)
    elif len(field.grid.shape) != 3:
        found = f"it is one in {kind_of(field.grid)}"
        raise DataError(f"{path} is not the field of the case beside it: {found}; run the case again")


def other_vessel(field: Field, outline: Outline, low: float = -inf, high: float = inf) -> str:
    """What tells that the vessel of a field is another one between two levels [m]; empty if it is the same.

    The field lies on rings or in the plane x–z, as the vessel's own does; a slab may have another depth.
    """
    grid = field.grid
    if grid.measure.walled != outline.measure.walled:
        one, other = ("", "not ") if grid.measure.walled else ("not ", "")
        return f"it is {one}the mean between a front and a back wall, the vessel {other}one that has them"
    rows = (grid.z_centres > low) & (grid.z_centres < high)
    wide = replace(grid, r_edges=_beyond(grid.r_edges, outline.r_min, outline.r_max))
    here = outline.inside_fraction(wide)[rows]
    there = np.zeros_like(here)
    there[:, wide.where(grid)[1]] = field.inside_fraction[rows]
    apart = (np.abs(here - there) @ wide.ring_area) / (here @ wide.ring_area)
    worst = int(apart.argmax())
    if apart[worst] <= TOLERANCE:
        return ""
    return (
        f"at z = {grid.z_centres[rows][worst]:.4g} m {apart[worst]:.0%} of the section lies outside that of the outline"
    )


def kind_of(grid: Grid) -> str:
    """In what a field lies, for messages."""
    return "x, y and z" if len(grid.shape) == 3 else f"{grid.measure.letter} and z"


def _beyond(edges: Array, low: float, high: float) -> Array:
    """Edges (n,) of equal width, continued on both sides until they reach two ends."""
    width = edges[1] - edges[0]
    left, right = (max(0, int(np.ceil(gap / width - 1e-9))) for gap in (edges[0] - low, high - edges[-1]))
    return np.concatenate(
        [edges[0] - width * np.arange(left, 0, -1), edges, edges[-1] + width * np.arange(1, right + 1)]
    )
