"""DXF by ezdxf: lines, polylines, arcs, circles, ellipses and splines of the model space, blocks included."""

from __future__ import annotations

from collections.abc import Iterator, Set
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.drawings.lines import Line, Lines
from granpipe.errors import CaseError

if TYPE_CHECKING:
    from ezdxf.entities.dxfentity import DXFEntity

_UNITS = {1: "inch", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}
"""DXF's number of a unit ($INSUNITS) → its name."""

_DRAWN = {"LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX"}

_PASSED_OVER = {
    *("TEXT", "MTEXT", "ATTRIB", "ATTDEF", "ACAD_TABLE", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION"),
    *("LEADER", "MULTILEADER", "TOLERANCE", "HATCH", "MPOLYGON", "SOLID", "TRACE", "WIPEOUT", "POINT", "VIEWPORT"),
    *("IMAGE", "PDFUNDERLAY", "DWFUNDERLAY", "DGNUNDERLAY", "OLEFRAME", "OLE2FRAME", "ACAD_PROXY_ENTITY"),
    *("LIGHT", "SUN", "XLINE", "RAY"),
}
"""What stands beside the lines of a drawing, fills them, or helps to draw them."""

_MOST_LEVELS = 8
"""Of blocks within blocks."""


def read_dxf(path: Path, sagitta: float | None) -> Lines:
    """The lines of a DXF drawing that it shows; texts, dimensions, filled areas and construction lines are not read.

    What is on a layer that is off or frozen, or is invisible itself, is not read.

    Parameters
    ----------
    sagitta : how far a curve may lie off the line that stands for it, in the drawing's unit; 1e-4 of the size unless
        given

    Raises
    ------
    CaseError : no DXF, damaged, nothing is drawn in it, or something that is neither read nor passed over
    """
    from ezdxf import bbox
    from ezdxf import path as ezpath
    from ezdxf.filemanagement import readfile

    try:
        document = readfile(path)
        hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
        entities = list(_flat(document.modelspace(), hidden))
        extents = bbox.extents(entities)
        limit = sagitta or 1e-4 * max(extents.size.x, extents.size.y, 1e-9) if entities else 0.0
        drawn = [(one.dxf.layer, [(p.x, p.y) for p in ezpath.make_path(one).flattening(limit)]) for one in entities]
        unit = _UNITS.get(int(document.header.get("$INSUNITS", 0)), "")
    except CaseError:
        raise
    except Exception as error:  # ezdxf raises whatever a damaged file makes it stumble over
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise CaseError(f"not a DXF file that can be read ({reason}); save it as DXF R2010 or newer") from None
    lines = [Line(np.array(points), layer) for layer, points in drawn if len(points) > 1]
    if not lines:
        raise CaseError("its model space holds no lines, polylines, arcs or splines")
    return Lines(lines, unit)


def _flat(entities: Any, hidden: Set[str], depth: int = 0) -> Iterator[DXFEntity]:
    """What is drawn and seen, blocks and arrays of them taken apart.

    CaseError for what is neither read nor passed over, and for too many blocks within blocks.
    """
    for entity in entities:
        kind = entity.dxftype()
        if entity.dxf.get("invisible", 0) or entity.dxf.layer.lower() in hidden:
            continue
        if kind in _DRAWN:
            yield entity
        elif kind == "INSERT" and entity.mcount > 1:
            yield from _flat(entity.multi_insert(), hidden, depth)
        elif kind in {"INSERT", "MLINE"}:
            if depth == _MOST_LEVELS:
                raise CaseError(f"more than {_MOST_LEVELS} blocks within each other; explode the outer ones")
            yield from _flat(entity.virtual_entities(), hidden, depth + 1)
        elif kind not in _PASSED_OVER:
            raise CaseError(f"layer {entity.dxf.layer}: {kind} cannot be read; draw it as polylines, or hide its layer")
