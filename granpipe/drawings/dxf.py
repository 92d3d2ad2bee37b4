"""DXF by ezdxf: lines, polylines, arcs, circles, ellipses and splines of the model space, blocks included."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.drawings.lines import Line, Lines
from granpipe.errors import CaseError

if TYPE_CHECKING:
    from ezdxf.entities.dxfentity import DXFEntity

_UNITS = {1: "inch", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}
"""DXF's number of a unit ($INSUNITS) → its name."""

_DRAWN = {"LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"}


def read_dxf(path: Path, sagitta: float | None) -> Lines:
    """The lines of a DXF drawing; texts, dimensions and hatches are passed over.

    Parameters
    ----------
    sagitta : how far a curve may lie off the line that stands for it, in the drawing's unit; 1e-4 of the size unless
        given

    Raises
    ------
    CaseError : no DXF, damaged, or nothing is drawn in it
    """
    from ezdxf import bbox
    from ezdxf import path as ezpath
    from ezdxf.filemanagement import readfile

    try:
        document = readfile(path)
        entities = list(_flat(document.modelspace()))
        extents = bbox.extents(entities)
        limit = sagitta or 1e-4 * max(extents.size.x, extents.size.y, 1e-9) if entities else 0.0
        drawn = [(one.dxf.layer, [(p.x, p.y) for p in ezpath.make_path(one).flattening(limit)]) for one in entities]
        unit = _UNITS.get(int(document.header.get("$INSUNITS", 0)), "")
    except Exception as error:  # ezdxf raises whatever a damaged file makes it stumble over
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise CaseError(f"not a DXF file that can be read ({reason}); save it as DXF R2010 or newer") from None
    lines = [Line(np.array(points), layer) for layer, points in drawn if len(points) > 1]
    if not lines:
        raise CaseError("its model space holds no lines, polylines, arcs or splines")
    return Lines(lines, unit)


def _flat(entities: Any, depth: int = 0) -> Iterator[DXFEntity]:
    """What is drawn, blocks taken apart; a block within a block within … ends at eight."""
    for entity in entities:
        if entity.dxftype() in _DRAWN:
            yield entity
        elif entity.dxftype() == "INSERT" and depth < 8:
            yield from _flat(entity.virtual_entities(), depth + 1)
