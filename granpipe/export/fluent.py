"""Profiles for Ansys Fluent: ``flow.prof`` and ``flow.csv``.

Fluent's axisymmetric solver takes the x axis as the axis: x = z and y = r, so axial-velocity is w and radial-velocity
u. The points are those of the vessel; Fluent gives every face or cell the value of the nearest one (or interpolates),
so in voids it finds a velocity of 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from granpipe.export.exported import Exported, number, numbers, write_lines
from granpipe.field import Array


def write_fluent(exported: Exported, folder: Path) -> None:
    """Write both files into an existing folder."""
    fields = _fields(exported)
    write_lines(folder / "flow.prof", _profile(exported, fields))
    write_lines(folder / "flow.csv", _table(exported, fields))


_NAMES = {
    "w_bulk": "axial-velocity",
    "u_bulk": "radial-velocity",
    "w_bulk_se": "axial-velocity-error",
    "u_bulk_se": "radial-velocity-error",
    "packing": "packing",
    "solids": "solids",
}
"""Column → its name in Fluent."""


def _fields(exported: Exported) -> dict[str, Array]:
    """Name → (n,) values at the points of the vessel, in Fluent's axes."""
    nodes, used = exported.nodes, exported.vessel
    rows, columns = used.nonzero()
    known = {column.name: column.values[used] for column in exported.columns}
    places = {"x": nodes.z[rows], "y": nodes.r[columns]}
    return places | {title: known[name] for name, title in _NAMES.items() if name in known}


def _profile(exported: Exported, fields: dict[str, Array]) -> Iterator[str]:
    """Lines of a point profile. The format has no comments: its name holds the flow rate."""
    yield f"((solids-{number(exported.flow_rate)}-m3-per-s point {len(fields['x'])})"
    for name, values in fields.items():
        yield f"({name}"
        yield from map(number, values.tolist())
        yield ")"
    yield ")"


def _table(exported: Exported, fields: dict[str, Array]) -> Iterator[str]:
    yield from (f"# {line}" for line in [*exported.head, "x is the axis and points up, y is the radius [m]; m/s"])
    yield "[Name]"
    yield "solids"
    yield ""
    yield "[Data]"
    yield ",".join(fields)
    yield from (numbers(row, ",") for row in zip(*(values.tolist() for values in fields.values()), strict=True))
