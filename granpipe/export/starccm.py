"""``flow.csv``: an XYZ table for Simcenter STAR-CCM+.

Its axisymmetric model takes y = 0 as the axis: X = z and Y = r. The points are those of the vessel, with velocity 0 in
voids. A CSV table has no comments: flow rate and reference density are columns, which field functions can use.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from granpipe.export.exported import Exported, numbers, write_lines

_NAMES = {
    "w_bulk": "Axial Velocity (m/s)",
    "u_bulk": "Radial Velocity (m/s)",
    "w_bulk_se": "Axial Velocity Error (m/s)",
    "u_bulk_se": "Radial Velocity Error (m/s)",
    "packing": "Packing",
    "solids": "Solids",
}
"""Column → its title in the table."""


def write_starccm(exported: Exported, path: Path) -> None:
    """Write the table."""
    write_lines(path, _lines(exported))


def _lines(exported: Exported) -> Iterator[str]:
    nodes, used = exported.nodes, exported.vessel
    rows, columns = used.nonzero()
    known = {column.name: column.values[used] for column in exported.columns}
    table = {"X": nodes.z[rows], "Y": nodes.r[columns]}
    table |= {title: known[name] for name, title in _NAMES.items() if name in known}
    table["Bulk Flow Rate (m^3/s)"] = np.full(len(rows), exported.flow_rate)
    table["Reference Density (kg/m^3)"] = np.full(len(rows), exported.reference_density)
    yield ",".join(table)
    yield from (numbers(row, ",") for row in zip(*(values.tolist() for values in table.values()), strict=True))
