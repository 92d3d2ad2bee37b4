"""`outline.file`: the vessel's drawing in place of typed points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from granpipe.case.messages import case_error
from granpipe.case.outline import DRAWING_KEYS, DrawingSpec
from granpipe.case.yamlfile import Places
from granpipe.drawings.read import read_drawing
from granpipe.errors import CaseError

_KEY = ("outline", "file")


def with_drawing(data: dict[str, Any], places: Places, folder: Path) -> tuple[str, ...]:
    """Put wall, obstacles and unit of the drawing in the place of `outline.file`; what was found there, in sentences.

    The path of the drawing is relative to `folder`, that of the case file. `data` is changed.

    Raises
    ------
    CaseError : the drawing cannot be read, or the case gives points as well
    """
    outline = data.get("outline")
    if not isinstance(outline, dict) or not outline.keys() & DRAWING_KEYS:
        return ()
    given = {key: value for key, value in outline.items() if key in DRAWING_KEYS | {"unit"}}
    try:
        spec = DrawingSpec.model_validate(given)
    except ValidationError as error:
        raise _in_outline(case_error(error, given, Places(places.file)), places) from None
    if outline.get("symmetry") == "plane":
        message = "a drawing gives a body of revolution; type the points of a slab under left and right"
        raise CaseError(message, _KEY, places.locate(_KEY))
    for key in ("wall", "obstacles"):
        if outline.get(key) is not None:
            message = f"stands beside file: {spec.file}; give the points or the drawing, not both"
            raise CaseError(message, ("outline", key), places.locate(("outline", key)))
    path = folder / spec.file
    try:
        drawing = read_drawing(path, spec.unit or "", spec.axis, spec.up or "", spec.tolerance)
    except CaseError as error:
        at = error.key or _KEY
        raise CaseError(error.message, at, places.locate(at)) from None
    section = drawing.section
    kept = {key: value for key, value in outline.items() if key not in DRAWING_KEYS}
    data["outline"] = kept | {
        "unit": drawing.unit,
        "wall": section.wall.tolist(),
        "obstacles": {name: polygon.tolist() for name, polygon in section.obstacles.items()},
    }
    return tuple(f"{spec.file}: {note}" for note in section.notes)


def _in_outline(error: CaseError, places: Places) -> CaseError:
    key = ("outline", *error.key)
    return CaseError(error.message, key, places.locate(key))
