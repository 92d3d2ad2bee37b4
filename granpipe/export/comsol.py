"""Text files that COMSOL Multiphysics reads as interpolation functions, and the programs that set them up.

Three formats: Spreadsheet (a row per node), Grid (axes, then rows of values) and Sectionwise (triangles of the solid
cells alone, so that nothing is interpolated across a wall or a cavity). ASCII, LF, numbers that read back exactly,
never NaN. Quantities that a model does not give have no column and no file.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from granpipe import __version__
from granpipe.export.balance import Balance, balance_of
from granpipe.export.exported import Column, Exported, number, numbers, write_lines
from granpipe.export.nodes import Nodes, triangles
from granpipe.field import Array
from granpipe.system.templates import templates

MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_comsol(exported: Exported, folder: Path) -> Balance:
    """Write the COMSOL files into an existing folder; return how well what they hold balances.

    Raises
    ------
    DataError : a value of the field is not a number
    """
    balance = balance_of(exported.field, exported.nodes)
    sections = write_interpolation(exported.nodes, folder, exported.columns, name=exported.name, date=exported.date)
    write_lines(folder / "flow_levels.txt", _levels(balance, exported.nodes.measure.axial))
    write_lines(folder / "import_comsol.java", [_program("import_comsol.java.j2", exported, sections)])
    write_lines(folder / "import_comsol.py", [_program("import_comsol.py.j2", exported, sections)])
    return balance


def write_interpolation(
    nodes: Nodes, folder: Path, columns: list[Column], *, name: str, date: datetime
) -> list[Column]:
    """Write the interpolation files alone; return the columns that are interpolated linearly."""
    write_lines(folder / "flow_spreadsheet.txt", _spreadsheet(nodes, columns, name, date))
    for column in columns:
        if column.grid_file:
            write_lines(folder / column.grid_file, _grid(nodes.r, nodes.z, column.values))
    if nodes.psi is not None:
        write_lines(folder / "psi_grid.txt", _grid(nodes.r**2 if nodes.measure.axial else nodes.r, nodes.z, nodes.psi))
    sections = [column for column in columns if column.name != "psi"]
    write_lines(folder / "flow_sectionwise.txt", _sectionwise(nodes, sections))
    return sections


def _spreadsheet(nodes: Nodes, columns: list[Column], name: str, date: datetime) -> Iterator[str]:
    """Lines of the Spreadsheet format, its header and widths as COMSOL's own exports have them; r varies fastest."""
    r, z = np.meshgrid(nodes.r, nodes.z)
    yield from spreadsheet({nodes.measure.letter: r, "z": z}, columns, name, date)


def spreadsheet(places: dict[str, Array], columns: list[Column], name: str, date: datetime) -> Iterator[str]:
    """Lines of the Spreadsheet format: coordinates by name, then the columns, all of one shape."""
    entries = {
        "Model": name,
        "Version": f"granpipe {__version__}",
        "Date": f"{MONTHS[date.month - 1]} {date.day} {date.year}, {date:%H:%M}",
        "Dimension": str(len(places)),
        "Nodes": str(next(iter(places.values())).size),
        "Expressions": str(len(columns)),
        "Description": ", ".join(column.description for column in columns),
        "Length unit": "m",
    }
    yield from (f"% {key + ':':<19} {value}" for key, value in entries.items())
    first, *others = places
    yield _row(f"% {first}", *others, *(f"{column.name} ({column.unit})" for column in columns))
    table = np.column_stack([array.ravel() for array in (*places.values(), *(column.values for column in columns))])
    yield from (_row(*map(number, row)) for row in table.tolist())


def _row(first: str, *others: str) -> str:
    """One line of a table: the first column 26 characters wide, the later ones at least 25."""
    return (f"{first:<26}" + "".join(f"{text:<24} " for text in others)).rstrip()


def _grid(first: Array, second: Array, values: Array) -> Iterator[str]:
    """Lines of the Grid format: both axes, then all values at one value of the second axis per row."""
    yield "% Grid"
    yield numbers(first.tolist())
    yield numbers(second.tolist())
    yield "% Data"
    yield from map(numbers, values.tolist())


def _sectionwise(nodes: Nodes, columns: list[Column]) -> Iterator[str]:
    """Lines of the Sectionwise format: nodes and triangles of the solid cells, then a block of values per function."""
    points = np.flatnonzero(nodes.solids)
    r, z = np.meshgrid(nodes.r, nodes.z)
    yield "% Coordinates"
    yield from map(numbers, zip(r.ravel()[points].tolist(), z.ravel()[points].tolist(), strict=True))
    yield "% Elements (triangles)"
    place = np.cumsum(nodes.solids).reshape(nodes.solids.shape)  # 1-based
    yield from (f"{a} {b} {c}" for a, b, c in place.ravel()[triangles(nodes)].tolist())
    for column in columns:
        yield f"% Data ({column.name} ({column.unit}))"
        yield from map(number, column.values.ravel()[points].tolist())


def _levels(balance: Balance, axial: bool) -> Iterator[str]:
    """Table of the flow through every level, under a summary of what linear interpolation does to the balance."""
    divergence = "(1/r) d(r u)/dr + dw/dz" if axial else "du/dx + dw/dz"
    yield from (
        "% Flow of bulk through every level, positive downwards, and how well the exported velocity balances",
        "% field: the field itself; grid: interpolated linearly in every cell, as the grid files and the spreadsheet",
        f"% give it; sectionwise: interpolated in the solid cells alone. Divergence: {divergence} of the",
        "% interpolated bulk velocity at the centres of the solid cells that no wall cuts; false source: the integral",
        "% of its absolute value, divided by the flow rate.",
    )
    summary = {
        "flow rate (m^3/s)": balance.flow_rate,
        "divergence, maximum (1/s)": balance.divergence_max,
        "divergence, RMS (1/s)": balance.divergence_rms,
        "false source (1)": balance.false_source,
    }
    yield from (f"% {key + ':':<29}{number(value)}" for key, value in summary.items())
    yield _row("% z (m)", "field (m^3/s)", "grid (m^3/s)", "sectionwise (m^3/s)")
    table = np.column_stack([balance.z, balance.field, balance.grid, balance.sectionwise])
    yield from (_row(*map(number, row)) for row in table.tolist())


def _program(template: str, exported: Exported, sections: list[Column]) -> str:
    """The Java class or the Python script that adds functions, parameters and variables to a COMSOL model."""
    return (
        templates()
        .get_template(template)
        .render(
            name=exported.name,
            version=__version__,
            functions=sections,
            conserving=exported.field.psi is not None,
            axial=exported.nodes.measure.axial,
            depth=number(exported.field.grid.measure.turn),
            flow_rate=number(exported.flow_rate),
            reference_density=number(exported.reference_density),
            solids_density=number(exported.solids_density),
            reference_packing=number(exported.field.bulk_packing),
        )
    )
