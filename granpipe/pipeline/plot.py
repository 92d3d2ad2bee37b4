"""`granpipe plot`: one picture of a result, drawn anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granpipe.case.reader import read_case
from granpipe.case.schema import Case
from granpipe.errors import DataError, RunError
from granpipe.field import Field
from granpipe.geometry.outline import Outline
from granpipe.pipeline.field_vessel import check_case, kind_of
from granpipe.system.manifest import MANIFEST, read_manifest, verify


@dataclass(frozen=True)
class DrawnVessel:
    """What is drawn round a field: walls and obstacles [m], levels of the sections [m], the name of the case."""

    wall: Any
    obstacles: Mapping[str, Any]
    levels: Mapping[str, tuple[float, float]]
    name: str
    left: Any = None

    @classmethod
    def of(cls, field: Field, case: Case | None) -> DrawnVessel:
        """The vessel of a case; without one, the edge of the grid."""
        if case is None:
            right, z = float(field.grid.r_edges[-1]), field.grid.z_edges
            return cls([(right, float(z[-1])), (right, float(z[0]))], {}, {}, "")
        outline = Outline.from_case(case)
        obstacles = {name: polygon.tolist() for name, polygon in outline.obstacles.items()}
        return cls(outline.wall.tolist(), obstacles, case.outline.levels, case.name, outline.left_wall)


def plot_result(
    folder: Path, what: str, z: float | None, out: Path | None, cut: tuple[str, float] | None = None
) -> Path:
    """Draw one picture of a results folder into a new PNG file; return the file.

    Parameters
    ----------
    what : ``overview``, or one of `granpipe.export.pictures.PANELS`
    z : draw the profile across this level [m] instead
    out : the file; unless given, ``<folder>-<what>.png`` in the current folder
    cut : draw the cut of a field in space across this axis at this place [m] instead

    Raises
    ------
    DataError : the folder holds no field or a damaged one, or the field does not have what is to be drawn
    RunError : the file exists
    """
    field, case = _opened(folder)
    named = what if z is None else f"profile-z{z:g}"
    if cut is not None:
        named = f"cut-{cut[0]}{cut[1]:g}"
    path = out or Path(f"{folder.resolve().name}-{named}.png")
    if path.exists():
        raise RunError(f"{path} exists; move it away or choose another --out")
    if len(field.grid.shape) == 3:
        figure = _space_figure(field, case.name if case else folder.resolve().name, what, z, cut)
    elif cut is not None:
        raise DataError(f"{folder}: cuts are drawn through fields in space; this one lies in {kind_of(field.grid)}")
    else:
        figure = _figure(field, DrawnVessel.of(field, case), what, z)
    figure.savefig(path, dpi=200)
    return path


def _space_figure(field: Field, name: str, what: str, z: float | None, cut: tuple[str, float] | None) -> Any:
    from granpipe.export.space_pictures import cut_figure, space_figure

    if z is not None or what != "overview":
        raise DataError("of a field in space the overview is drawn, or a cut: --cut z=0.1 (or x=, y=)")
    return space_figure(field, name) if cut is None else cut_figure(field, *cut, name)


def _opened(folder: Path) -> tuple[Field, Case | None]:
    known = ("field.npz", "case.yaml")
    if (folder / MANIFEST).exists():
        verify(folder, *(name for name in known if name in read_manifest(folder)))
    field = Field.load(folder / "field.npz")
    case = read_case(folder / "case.yaml").case if (folder / "case.yaml").exists() else None
    if case is not None:
        check_case(field, case, folder / "field.npz")
    return field, case


def _figure(field: Field, vessel: DrawnVessel, what: str, z: float | None) -> Any:
    from granpipe.export.pictures import field_title, overview, panel_figure
    from granpipe.export.profiles import level_profile, profile_figure

    if z is not None:
        section = next((name for name, (top, low) in vessel.levels.items() if low <= z <= top), "")
        return profile_figure(level_profile(field, z, section))
    if what == "overview":
        return overview(
            field, vessel.wall, vessel.obstacles, vessel.levels, field_title(vessel.name, field), vessel.left
        )
    return panel_figure(field, what, vessel.wall, vessel.obstacles, vessel.levels, vessel.left)
