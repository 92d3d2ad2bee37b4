"""Grids for MOOSE's `PiecewiseMultilinear`, a file for each quantity, and ``functions.i`` that declares them.

With ``coord_type = RZ`` MOOSE takes x as the radius and y as the axis. A grid has a value at every node, so that away
from the solids, also in the walls, velocities are 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from granpipe.export.exported import Column, Exported, numbers, write_lines


def write_moose(exported: Exported, folder: Path) -> None:
    """Write the files into an existing folder."""
    columns = exported.columns
    for column in columns:
        write_lines(folder / f"{column.name}.txt", _grid(exported, column))
    write_lines(folder / "functions.i", _functions(exported, columns))


def _grid(exported: Exported, column: Column) -> Iterator[str]:
    nodes = exported.nodes
    yield from (f"# {line}" for line in [*exported.head, f"{column.description} ({column.unit}) on x = r, y = z (m)"])
    yield from ("AXIS X", numbers(nodes.r.tolist()), "AXIS Y", numbers(nodes.z.tolist()), "DATA")
    yield from map(numbers, column.values.tolist())  # the first axis varies fastest


def _functions(exported: Exported, columns: list[Column]) -> Iterator[str]:
    yield from (f"# {line}" for line in exported.head)
    yield "[Functions]"
    for column in columns:
        yield f"  [solids_{column.name}]"
        yield "    type = PiecewiseMultilinear"
        yield f"    data_file = {column.name}.txt"
        yield "  []"
    yield "[]"
