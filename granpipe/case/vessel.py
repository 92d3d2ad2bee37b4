"""Keys of `vessel`: walls in space from triangles, in place of an outline."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from granpipe.case.outline import OutlineSpec
from granpipe.case.units import UnitError, length_unit
from granpipe.case.values import File, Group, Identifier, Name, Place, Quantity, refuse
from granpipe.case.yamlfile import Places
from granpipe.drawings.cad import STEP, read_cad_triangles
from granpipe.drawings.lines import Points
from granpipe.drawings.surface import read_triangles
from granpipe.errors import CaseError
from granpipe.system.files import digest

SHARES = 1e-6
"""Shares of the outlets add up to one, to this."""

TRIANGLES = (".stl", ".obj")
CAD = (*STEP, ".brep")
"""Endings of the files that are read."""

_KEY = ("vessel", "file")
_NO_OUTLINE = {"symmetry": "space"}  # in place of an outline
_WRITTEN_KEYS = {"unit", "symmetry", "obstacles", "sections"}  # that every written case has in it


class OutletSpec(Group):
    """An opening of the walls through which solids leave, and its part of the flow."""

    at: Annotated[tuple[float, float, float], Place()] = Field(
        description="A point [x, y, z] in the opening, in `vessel.unit`: it is the opening nearest to it."
    )
    share: Annotated[float, Quantity(above=0, at_most=1)] = Field(
        description="Its part of the flow rate. All shares make 100 %."
    )


class VesselSpec(Group):
    """The vessel's walls in space, in place of `outline`: any shape, with an inlet at the top; by particles only."""

    file: Annotated[str, File()] = Field(
        description="The walls, z up, relative to the folder of the case file: triangles (STL, OBJ) that are open only "
        "at the inlet (level, at the top) and at the outlets (flat, level or in a side wall), with obstacles as closed "
        "surfaces inside; or the inside as a body (STEP, BREP), which is opened at its flat face at the top and at "
        "those that outlets lie in, or at the bottom where none is given."
    )
    unit: Annotated[str, Identifier()] = Field(
        default="m", description="Unit of the file and of `at`: m, cm, mm, ft, …; a STEP file knows its own."
    )
    outlets: dict[Annotated[str, Identifier()], OutletSpec] = Field(
        default_factory=dict,
        description="Every opening but the inlet, by name. Not needed where there is one.",
    )
    sha256: Annotated[str | None, Name()] = Field(
        default=None, description="SHA-256 of the file. Written by granpipe, which refuses a file that was changed."
    )

    @property
    def metres(self) -> float:
        """Length of the unit [m]."""
        return length_unit(self.unit)

    @model_validator(mode="after")
    def _whole(self) -> VesselSpec:
        try:
            length_unit(self.unit)
        except UnitError as error:
            refuse(str(error), ("unit",))
        total = sum(outlet.share for outlet in self.outlets.values())
        if self.outlets and abs(total - 1) > SHARES:
            refuse(f"the shares add up to {100 * total:.6g} %; they must make 100 %", ("outlets",), show_value=False)
        return self


def with_vessel(data: dict[str, Any], places: Places, folder: Path) -> None:
    """Note the hash of `vessel.file`, make its path absolute, and put the mark of a vessel in space for the outline.

    The path is relative to `folder`, that of the case file. `data` is changed; what is no vessel is left alone.

    Raises
    ------
    CaseError : the file cannot be read, or the case has an outline as well
    """
    vessel = data.get("vessel")
    if vessel is None:
        return
    outline = data.get("outline")
    if outline is not None and not _is_no_outline(outline):
        message = "stands beside `vessel`, which gives the walls: leave one of the two out"
        raise CaseError(message, ("outline",), places.locate(("outline",)))
    data["outline"] = dict(_NO_OUTLINE)
    if not isinstance(vessel, Mapping) or not isinstance(vessel.get("file"), str) or "\0" in vessel["file"]:
        return  # the schema says what is wrong
    path = (folder / vessel["file"]).absolute()
    found = _digest(path, places)
    if vessel.get("sha256") not in (None, found):
        message = f"{vessel['file']} is not the file any more that the case was made with: leave vessel.sha256 out"
        raise CaseError(message, _KEY, places.locate(_KEY))
    data["vessel"] = {**vessel, "file": str(path), "sha256": found}


def _is_no_outline(outline: Any) -> bool:
    """Whether it is what a case that granpipe wrote has in place of an outline; keys that came later may be missing."""
    if outline == _NO_OUTLINE:
        return True
    if not isinstance(outline, Mapping) or not outline.keys() >= _WRITTEN_KEYS:
        return False
    written = OutlineSpec.model_validate(_NO_OUTLINE).model_dump(mode="json", exclude_none=True)
    return written | dict(outline) == written


def vessel_triangles(spec: VesselSpec) -> tuple[Points, Any]:
    """(n, 3) corners [m] and (m, 3) which of them each triangle has.

    Raises
    ------
    CaseError : the file cannot be read, or is not what it was when the case was read
    """
    path = Path(spec.file)
    if _digest(path, Places("")) != spec.sha256:
        raise CaseError(f"{path} was changed after the case was read: run again", _KEY)
    kind = path.suffix.lower()
    try:
        if kind in CAD:
            scale = spec.metres if kind in STEP else 1.0
            outlets = [[scale * one for one in outlet.at] for outlet in spec.outlets.values()]
            points, triangles = read_cad_triangles(path, outlets)
        elif kind in TRIANGLES:
            points, triangles = read_triangles(path)
        else:
            raise CaseError(f"{kind or 'no ending'} is not read: give a file of {', '.join((*TRIANGLES, *CAD))}")
    except CaseError as error:
        raise CaseError(f"{path.name}: {error.message}", _KEY) from None
    return points * (1.0 if kind in STEP else spec.metres), triangles


def _digest(path: Path, places: Places) -> str:
    try:
        return digest(path)
    except OSError as error:
        message = f"{path} cannot be read ({error.strerror}); give a file of {', '.join((*TRIANGLES, *CAD))}"
        raise CaseError(message, _KEY, places.locate(_KEY)) from None
