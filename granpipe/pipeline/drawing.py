"""`granpipe outline`: what a drawing is understood to be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granpipe.case.units import UnitError, length_unit
from granpipe.drawings.read import read_drawing
from granpipe.errors import CaseError
from granpipe.export.outline_picture import outline_picture
from granpipe.geometry.outline import Outline
from granpipe.planning.vessel_text import outline_yaml, vessel_text
from granpipe.system.files import check_picture


@dataclass(frozen=True)
class DrawnVessel:
    """A vessel found in a drawing: its size and what was doubtful, as text, and `outline` of a case that has it."""

    text: str
    notes: tuple[str, ...]
    yaml: str


def drawn_vessel(
    file: Path, picture: Path, unit: str, axis: float | None, up: str, tolerance: float | None
) -> DrawnVessel:
    """Read a drawing, check the vessel in it and draw what was found.

    Parameters
    ----------
    picture : PNG file to write
    unit : of the drawing; empty: as the file says
    axis, up : where the axis lies, in that unit, and which direction points up; None and empty: found
    tolerance : how far a curve may lie off the straight lines that stand for it, in that unit

    Raises
    ------
    CaseError : the unit is none, or the vessel is impossible
    RunError : something else stands where the picture is to go
    DataError : the drawing cannot be read, or there is no vessel in it
    """
    check_picture(picture)
    drawing = read_drawing(file, unit, axis, up, tolerance)
    section = drawing.section
    try:
        metres = length_unit(drawing.unit)
    except UnitError as error:
        raise CaseError(f"{drawing.unit}: {error}", place="--unit") from None
    outline = Outline.of(section.wall * metres, {name: one * metres for name, one in section.obstacles.items()})
    outline_picture(section.wall, section.obstacles, drawing.unit, picture)
    yaml = outline_yaml(drawing.unit, section.wall, section.obstacles)
    return DrawnVessel(vessel_text(outline), tuple(section.notes), yaml)
