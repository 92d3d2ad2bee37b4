"""Tables for a spreadsheet: wall slip and pressure, and residence times."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.field import Field

_WALL = {
    "wall_contact": ("contact", 0),
    "wall_slip": ("slip_m_per_s", 1),
    "wall_pressure": ("pressure_pa", 0),
}
"""Array in the field → column, and the power of the flow rate with which it goes."""


def write_tables(field: Field, folder: Path) -> None:
    """Write ``wall.csv`` and ``residence_time.csv``, as far as the field holds them, at the flow rate of the case."""
    if "wall_ends" in field.extra:
        _write(folder / "wall.csv", *_wall(field))
    if "residence_time" in field.extra:
        _write(folder / "residence_time.csv", *_residence(field))


def _wall(field: Field) -> tuple[list[str], Iterable[Sequence[Any]]]:
    """A row for each piece of a surface: its middle, its length, means and standard errors."""
    ends = field.extra["wall_ends"]
    columns: dict[str, Any] = {
        "surface": field.extra["wall_surface"].tolist(),
        f"{field.grid.measure.letter}_m": ends[:, :, 0].mean(axis=1),
        "z_m": ends[:, :, 1].mean(axis=1),
        "length_m": np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1),
    }
    for name, (title, power) in _WALL.items():
        for suffix, what in (("", title), ("_se", f"{title}_standard_error")):
            if name + suffix in field.extra:
                columns[what] = field.extra[name + suffix] * field.flow_scale**power
    return list(columns), zip(*(map(_text, values) for values in columns.values()), strict=True)


def _residence(field: Field) -> tuple[list[str], Iterable[Sequence[Any]]]:
    """The curve over streamlines from the axis (or left wall) on, and over the flow from the shortest stay on."""
    within, time = field.extra["residence_within"], field.extra["residence_time"] / field.flow_scale
    first = "axis" if field.grid.measure.axial else "left_wall"
    titles = [f"flow_between_{first}_and_streamline", "time_s", "flow_that_is_faster", "its_time_s"]
    return titles, zip(*(map(_text, values) for values in (within, time, within, np.sort(time))), strict=True)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:.8g}"


def _write(path: Path, titles: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([titles, *rows])
