"""A vessel's drawing → wall and obstacles of its half section, whatever the format of the file."""

from __future__ import annotations

import stat
from dataclasses import dataclass, replace
from pathlib import Path

from granpipe.drawings.half_section import HalfSection, half_section
from granpipe.drawings.lines import LARGEST, Lines
from granpipe.errors import CaseError

INSTEAD = {
    ".mph": "COMSOL's model: export its 2-D mesh as text (.mphtxt) or its geometry as DXF or STEP",
    ".mphbin": "COMSOL's binary geometry or mesh: export the mesh as text (.mphtxt), or the geometry as STEP",
    ".dwg": "AutoCAD's own format: save it as DXF",
    ".iges": "IGES: export STEP",
    ".igs": "IGES: export STEP",
    ".sldprt": "SolidWorks' own format: export STEP, or the sketch as DXF",
    ".ipt": "Inventor's own format: export STEP, or the sketch as DXF",
    ".pdf": "a picture: export DXF",
}
"""Formats that are not read → what to export instead."""

_FORMATS = ".dxf, .csv, .txt, .mphtxt, .step, .stp, .brep, .stl, .obj"


@dataclass(frozen=True)
class Drawing:
    """A vessel as it was drawn.

    Parameters
    ----------
    section : wall and obstacles in `unit`
    unit : of the coordinates
    """

    section: HalfSection
    unit: str


def read_drawing(
    path: Path, unit: str = "", axis: float | None = None, up: str = "", tolerance: float | None = None
) -> Drawing:
    """Read a drawing by the ending of its name: DXF, CSV, COMSOL's .mphtxt, STEP, BREP, STL or OBJ.

    Parameters
    ----------
    unit : of the coordinates; needed where the file does not tell, and stronger than what it tells
    axis : where the axis lies across the direction that points up, in the drawing's unit; found unless given
    up : direction that points up; y in a plane drawing, found in three dimensions unless given
    tolerance : how far a curve may lie off the lines that stand for it, in the drawing's unit; 1e-4 of the size unless
        given

    Raises
    ------
    CaseError : the file cannot be read, or does not show one vessel; the message names the coordinates
    """
    try:
        kind = path.stat().st_mode
    except OSError as error:
        raise CaseError(f"{path}: {error.strerror}; give the path of a drawing ({_FORMATS})") from None
    if not stat.S_ISREG(kind):
        raise CaseError(f"{path}: not a file")
    try:
        if tolerance is not None and not 0 < tolerance <= LARGEST:
            raise CaseError(f"a tolerance of {tolerance:g}: it must be above 0", ("outline", "tolerance"))
        if axis is not None and not abs(axis) <= LARGEST:
            raise CaseError(f"an axis at {axis:g}: it must be a coordinate of the drawing", ("outline", "axis"))
        lines = _lines(path, tolerance, up)
        if lines.half and axis is not None:
            raise CaseError("its lines are a half section with the axis at r = 0: leave axis out", ("outline", "axis"))
        found = unit or lines.unit
        if not found:
            raise CaseError("does not tell its unit; say outline.unit, such as mm")
        plane = up if up and not lines.half else "y"
        section = half_section(lines, axis, plane)
    except CaseError as error:
        raise CaseError(f"{path}: {error.message}", error.key) from None
    if unit and lines.unit and unit != lines.unit:
        section = replace(section, notes=(*section.notes, f"the file says {lines.unit}, the case {unit}, which counts"))
    return Drawing(section, found)


def _lines(path: Path, tolerance: float | None, up: str) -> Lines:
    ending = path.suffix.lower()
    if ending in INSTEAD:
        raise CaseError(f"{INSTEAD[ending]}")
    if ending == ".dxf":
        from granpipe.drawings.dxf import read_dxf

        return read_dxf(path, tolerance)
    if ending in (".csv", ".txt", ".tsv"):
        from granpipe.drawings.table import read_csv

        if up:
            raise CaseError("holds radii and heights, z points up: leave up out", ("outline", "up"))
        return read_csv(path)
    if ending == ".mphtxt":
        from granpipe.drawings.mphtxt import read_mphtxt

        return read_mphtxt(path)
    if ending in (".step", ".stp", ".brep"):
        from granpipe.drawings.cad import read_cad

        return read_cad(path, tolerance, up)
    if ending in (".stl", ".obj"):
        from granpipe.drawings.surface import read_surface

        return read_surface(path, up=up)
    raise CaseError(f"not a format that is read; give one of {_FORMATS}")
