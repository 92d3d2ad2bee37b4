"""``flow.npz`` and ``flow.py`` for NGSolve: voxel coefficients on x = r, y = z.

A voxel coefficient has a value at every node of a box, so that away from the solids velocities are 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from granpipe.export.exported import Exported, write_lines
from granpipe.system.templates import templates


def write_ngsolve(exported: Exported, folder: Path) -> None:
    """Write both files into an existing folder."""
    nodes = exported.nodes
    columns = {column.name: column.values for column in exported.columns}
    constants = {"flow_rate": exported.flow_rate, "reference_density": exported.reference_density}
    np.savez_compressed(
        folder / "flow.npz", allow_pickle=False, r=nodes.r, z=nodes.z, **columns, **constants, head=exported.head
    )
    names = {column.name: f"{column.description} ({column.unit})" for column in exported.columns}
    script = templates().get_template("ngsolve.py.j2").render(head=exported.head, names=names)
    write_lines(folder / "flow.py", [script])
