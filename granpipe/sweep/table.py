"""The table of a sweep: one row per point, as CSV, as NetCDF, and drawn."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granpipe.errors import DataError, RunError
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, str | float]
"""Column → value; what a row does not have is left empty."""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")


def columns_of(rows: Sequence[Row]) -> list[str]:
    """Every column that some row has, in the order in which they first stand."""
    return list(dict.fromkeys(column for row in rows for column in row))


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """One line per row, the first one names the columns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns_of(rows), restval="")
        writer.writeheader()
        writer.writerows(rows)


def write_netcdf(rows: Sequence[Row], path: Path) -> None:
    """One dimension, `point`; columns of numbers are variables of numbers (NaN where there is none), others text.

    Raises
    ------
    RunError : xarray is not installed
    """
    try:
        import xarray
    except ImportError:
        raise RunError("xarray is not installed; run: pip install 'granpipe[netcdf]', or leave netcdf out") from None
    names = [column for column in columns_of(rows) if column != "point"]
    variables = {name.replace("/", "_"): ("point", _column(rows, name)) for name in names}
    points = [str(row["point"]) for row in rows]
    xarray.Dataset(variables, coords={"point": points}).to_netcdf(path, engine="h5netcdf")


def _column(rows: Sequence[Row], name: str) -> list[Any]:
    values = [row.get(name, "") for row in rows]
    if any(isinstance(value, str) and value for value in values):
        return [str(value) for value in values]
    return [float("nan") if value == "" else float(value) for value in values]


def longest_axis(rows: Sequence[Row], axes: Sequence[str]) -> str | None:
    """The axis with most numbers, two at least; None where there is none to draw over."""
    numbers = {axis: len({_number(row.get(axis, "")) for row in rows} - {None}) for axis in axes}
    longest = max(axes, key=numbers.__getitem__, default=None)
    return longest if longest is not None and numbers[longest] > 1 else None


def draw(rows: Sequence[Row], over: str, others: Sequence[str], figures: Sequence[str], path: Path) -> None:
    """One panel per column in `figures` over an axis, a line for each combination of the other axes.

    DataError where a column is not in the table, or holds no number.
    """
    with own_style({}):
        _chart([row for row in rows if _number(row.get(over, "")) is not None], over, others, figures).savefig(
            path, dpi=150
        )


def _chart(rows: Sequence[Row], over: str, others: Sequence[str], figures: Sequence[str]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.2 * len(figures)), layout="constrained")
    for panel, column in zip(figure.subplots(len(figures), squeeze=False)[:, 0], figures, strict=True):
        lines = _lines(rows, over, others, column)
        for label, points in lines.items():
            xs, ys = zip(*sorted(points), strict=True)
            panel.plot(xs, ys, "o-", markersize=3, linewidth=1, label=label)
        panel.set_xlabel(over)
        panel.set_ylabel(column)
        panel.grid(alpha=0.3)
        if 1 < len(lines) <= 12:
            panel.legend(fontsize=7)
    return figure


def _lines(rows: Sequence[Row], over: str, others: Sequence[str], column: str) -> dict[str, list[tuple[float, float]]]:
    """Label → points; rows without a number in the column are left out."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        x, y = _number(row.get(over, "")), _number(row.get(column, ""))
        if x is not None and y is not None:
            label = ", ".join(f"{axis.split('.')[-1]} {row[axis]}" for axis in others if axis in row)
            lines.setdefault(label, []).append((x, y))
    if not lines:
        have = ", ".join(
            name for name in columns_of(rows) if any(_number(row.get(name, "")) is not None for row in rows)
        )
        raise DataError(f"chart: no numbers in column {column}, so nothing is drawn; columns with numbers: {have}")
    return lines


def _number(value: str | float) -> float | None:
    """The number at the beginning of a value such as ``10 mm``."""
    if not isinstance(value, str):
        return float(value)
    match = _NUMBER.match(value)
    return float(match[0]) if match else None
