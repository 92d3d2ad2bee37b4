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
    from ezdxf.lldxf.const import DXFError

    try:
        document = readfile(path)
    except (DXFError, OSError, UnicodeDecodeError, ValueError, IndexError, KeyError) as error:
        raise CaseError(f"not a DXF file that can be read ({error}); save it as DXF R2010 or newer") from None
    entities = list(_flat(document.modelspace()))
    if not entities:
        raise CaseError("its model space holds no lines, polylines, arcs or splines")
    extents = bbox.extents(entities)
    limit = sagitta or 1e-4 * max(extents.size.x, extents.size.y)
    lines = []
    for entity in entities:
        points = np.array([[p.x, p.y] for p in ezpath.make_path(entity).flattening(limit)])
        if len(points) > 1 and np.isfinite(points).all():
            lines.append(Line(points, entity.dxf.layer))
    return Lines(lines, _UNITS.get(int(document.header.get("$INSUNITS", 0)), ""))


def _flat(entities: Any, depth: int = 0) -> Iterator[DXFEntity]:
    """What is drawn, blocks taken apart; a block within a block within … ends at eight."""
    for entity in entities:
        if entity.dxftype() in _DRAWN:
            yield entity
        elif entity.dxftype() == "INSERT" and depth < 8:
            yield from _flat(entity.virtual_entities(), depth + 1)
