"""Writes the files of every format that a case asks for."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from granpipe.case.schema import Case
from granpipe.export.exported import Exported
from granpipe.field import Field


def write_exports(field: Field, case: Case, folder: Path) -> None:
    """Write the files of every format that the case asks for, and the tables of what it asks for beside the field."""
    from granpipe.export.tables import write_tables

    exported = Exported(field, case.name, case.material.density, datetime.now().astimezone())
    for name in case.export:
        _WRITERS[name](exported, folder)
    write_tables(field, folder)


def write_space_exports(field: Field, case: Case, folder: Path) -> None:
    """Write the files of a field in space: for COMSOL and ParaView."""
    from granpipe.export.space import write_grid, write_text, write_vtr

    if "comsol" in case.export:
        comsol = _made(folder / "comsol")
        write_text(field, comsol, name=case.name, date=datetime.now().astimezone())
        write_grid(field, comsol)
    if "vtk" in case.export:
        write_vtr(field, folder / "field.vtr")


def _comsol(exported: Exported, folder: Path) -> None:
    from granpipe.export.comsol import write_comsol

    write_comsol(exported, _made(folder / "comsol"))


def _vtk(exported: Exported, folder: Path) -> None:
    from granpipe.export.vtk import write_vtu

    write_vtu(exported.field, folder / "field.vtu")


def _openfoam(exported: Exported, folder: Path) -> None:
    from granpipe.export.openfoam import write_openfoam

    write_openfoam(exported, _made(folder / "openfoam"))


def _fluent(exported: Exported, folder: Path) -> None:
    from granpipe.export.fluent import write_fluent

    write_fluent(exported, _made(folder / "fluent"))


def _starccm(exported: Exported, folder: Path) -> None:
    from granpipe.export.starccm import write_starccm

    write_starccm(exported, _made(folder / "starccm") / "flow.csv")


def _moose(exported: Exported, folder: Path) -> None:
    from granpipe.export.moose import write_moose

    write_moose(exported, _made(folder / "moose"))


def _xdmf(exported: Exported, folder: Path) -> None:
    from granpipe.export.xdmf import write_xdmf

    write_xdmf(exported, folder / "flow.xdmf")


def _ngsolve(exported: Exported, folder: Path) -> None:
    from granpipe.export.ngsolve import write_ngsolve

    write_ngsolve(exported, _made(folder / "ngsolve"))


def _netcdf(exported: Exported, folder: Path) -> None:
    from granpipe.export.netcdf import write_netcdf

    write_netcdf(exported, folder / "flow.nc")


def _streamlines(exported: Exported, folder: Path) -> None:
    from granpipe.analysis.streamlines import streamlines
    from granpipe.export.streamlines import write_streamlines

    write_streamlines(exported, streamlines(exported.field), folder / "streamlines.csv")


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


_WRITERS: dict[str, Callable[[Exported, Path], None]] = {
    "comsol": _comsol,
    "vtk": _vtk,
    "openfoam": _openfoam,
    "fluent": _fluent,
    "starccm": _starccm,
    "moose": _moose,
    "xdmf": _xdmf,
    "ngsolve": _ngsolve,
    "netcdf": _netcdf,
    "streamlines": _streamlines,
}
"""Name in `export` → what writes it below the folder of the results."""
