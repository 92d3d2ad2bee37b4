"""Whether a field is that of a vessel: the free area of every row of its grid against that of the outline."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid
from granpipe.geometry.outline import Outline

TOLERANCE = 0.01
"""Largest part of a row's free area that may lie outside the other's outline; the same vessel gives 0 to rounding."""


def check_vessel(field: Field, outline: Outline, path: Path) -> None:
    """Make sure that a field read from `path` is one of this vessel; one of a plane or of space is not looked at.

    Raises
    ------
    DataError : it is the field of another one
    """
    if not field.grid.measure.axial:
        return
    low, high, slack = field.grid.z_edges[0], field.grid.z_edges[-1], 0.5 * field.grid.cell
    if low < outline.z_bottom - slack or high > outline.z_top + slack:
        found = f"it covers z = {low:.4g} … {high:.4g} m, the vessel z = {outline.z_bottom:.4g} … {outline.z_top:.4g} m"
    else:
        found = other_vessel(field, outline)
    if found:
        raise DataError(f"{path} is not the field of the case beside it: {found}; run the case again")


def other_vessel(field: Field, outline: Outline, low: float = -inf, high: float = inf) -> str:
    """What tells that the vessel of a field on rings is another one between two levels [m]; empty if it is the same."""
    grid = field.grid
    rows = (grid.z_centres > low) & (grid.z_centres < high)
    wide = Grid(_beyond(grid.r_edges, outline.r_max), grid.z_edges)
    here = outline.inside_fraction(wide)[rows]
    there = np.zeros_like(here)
    there[:, : grid.shape[1]] = field.inside_fraction[rows]
    apart = (np.abs(here - there) @ wide.ring_area) / (here @ wide.ring_area)
    worst = int(apart.argmax())
    if apart[worst] <= TOLERANCE:
        return ""
    return (
        f"at z = {grid.z_centres[rows][worst]:.4g} m {apart[worst]:.0%} of the section lies outside that of the outline"
    )


def _beyond(edges: Array, radius: float) -> Array:
    """Edges (n,) of equal width, continued until they reach a radius."""
    width = edges[1] - edges[0]
    count = max(len(edges) - 1, int(np.ceil(radius / width - 1e-9)))
    return np.concatenate([edges, width * np.arange(len(edges), count + 1)])
