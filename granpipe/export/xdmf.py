"""``flow.xdmf``: triangles of the solids in the plane x = r, y = z, for FEniCSx and ParaView.

One file: the numbers stand in it as text, so that it needs no HDF5. There are no nodes away from the solids.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from granpipe.export.exported import Exported
from granpipe.export.nodes import triangles

_VECTORS = {"bulk_velocity": "bulk", "bulk_velocity_se": "bulk_se", "particle_velocity": "particle"}


def write_xdmf(exported: Exported, path: Path) -> None:
    """Write mesh and values."""
    import meshio

    nodes = exported.nodes
    used = np.flatnonzero(nodes.solids)
    place = np.cumsum(nodes.solids).reshape(nodes.solids.shape) - 1
    r, z = np.meshgrid(nodes.r, nodes.z)
    known = {column.name: column.values.ravel()[used] for column in exported.columns}
    data = {}
    for name, suffix in _VECTORS.items():
        if f"u_{suffix}" in known:
            data[name] = np.column_stack([known.pop(f"u_{suffix}"), known.pop(f"w_{suffix}"), np.zeros(len(used))])
    known.pop("solids")
    points = np.column_stack([r.ravel(), z.ravel()])[used]
    cells = [("triangle", place.ravel()[triangles(nodes)])]
    meshio.write(path, meshio.Mesh(points, cells, data | known), file_format="xdmf", data_format="XML")
    head = "".join(f"<!-- {line} -->\n" for line in exported.head)
    path.write_text(head + path.read_text())
