"""Writes the results of `granpipe homogenize`."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from granpipe import __version__
from granpipe.case.schema import Case
from granpipe.export.run_report import write_run_report
from granpipe.field import Field
from granpipe.pipeline.dump_average import Homogenized
from granpipe.pipeline.exports import write_exports
from granpipe.pipeline.plot import DrawnVessel
from granpipe.pipeline.summary import field_summary
from granpipe.system.jsonfile import write_json
from granpipe.system.publish import publishing_new


def write_homogenized(made: Homogenized, case: Case | None, folder: Path) -> None:
    """Write ``field.npz``, ``provenance.json`` with all that was measured, and the files that the case asks for.

    Without a case that is one for ParaView and, but for rings, text files for COMSOL. Pictures, and ``report.html``.

    Raises
    ------
    RunError : the folder exists
    """
    with publishing_new(folder) as aside:
        made.field.save(aside / "field.npz")
        space = len(made.field.grid.shape) == 3
        if space:
            _write_space(made.field, aside)
        else:
            _write_plane(made.field, case, aside)
            _draw(made.field, case, aside / "figures")
        provenance = {
            "made": datetime.now().astimezone().isoformat(timespec="seconds"),
            "granpipe": __version__,
            "case": None if case is None else case.name,
            "sampling": made.sampling,
            "method": made.method,
            "field": {} if space else field_summary(made.field, case),
            "figures": made.figures,
            "quality": [gate.as_dict() for gate in made.gates],
            "notes": made.notes,
        }
        write_json(aside / "provenance.json", provenance)
        write_run_report(aside)


def _draw(field: Field, case: Case | None, folder: Path) -> None:
    """Make the pictures of a field on rings or in the plane x–z."""
    from granpipe.export.pictures import rz_figures
    from granpipe.export.profiles import profile_figures, section_profiles

    folder.mkdir()
    vessel = DrawnVessel.of(field, case)
    rz_figures(field, vessel.wall, vessel.obstacles, folder, vessel.levels, vessel.name, vessel.left)
    profile_figures(section_profiles(field, vessel.levels), folder)


def _write_plane(field: Field, case: Case | None, folder: Path) -> None:
    """Write the files of a field on rings or in the plane x–z."""
    from granpipe.export.comsol import write_interpolation
    from granpipe.export.exported import columns_of
    from granpipe.export.nodes import nodal_errors, nodal_values
    from granpipe.export.tables import write_tables
    from granpipe.export.vtk import write_vtu

    if case is not None:
        write_exports(field, case, folder)
        return
    write_vtu(field, folder / "field.vtu")
    write_tables(field, folder)
    if not field.grid.measure.axial:
        (folder / "comsol").mkdir()
        nodes = nodal_values(field)
        columns = columns_of(nodes, nodal_errors(field))
        write_interpolation(nodes, folder / "comsol", columns, name="homogenized", date=datetime.now().astimezone())


def _write_space(field: Field, folder: Path) -> None:
    """Write the files of a field in space."""
    from granpipe.export.space import write_text, write_vtr
    from granpipe.export.space_pictures import write_space_figure

    (folder / "figures").mkdir()
    write_space_figure(field, "flow in space, averaged from dumps", folder / "figures" / "space_w.png")
    write_vtr(field, folder / "field.vtr")
    (folder / "comsol").mkdir()
    write_text(field, folder / "comsol", name="homogenized", date=datetime.now().astimezone())
