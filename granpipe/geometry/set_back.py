"""Walls set back: the vessel between whose walls enlarged particles fill what the material's own fill as drawn."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.errors import CaseError, KeyPath
from granpipe.field import Array
from granpipe.geometry.outline import Outline
from granpipe.geometry.validate import WALL_KEY, obstacle_key

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

WALLS_KEY: KeyPath = ("dem", "walls")

MOST = 3.0
"""Farthest that a point of the drawn walls may move, in distances: corners of the solid down to 39°."""

_FINEST = 1e-4  # of the vessel's size: places along the walls at which their way is measured
_ROUNDING = 1e-9  # of the vessel's size: coordinates are the same whatever the machine


def set_back(outline: Outline, distance: float) -> Outline:
    """The vessel with every wall and every face of its obstacles moved into the solid.

    Corners stay corners, and the axis, the levels of inlet and outlet and the sections stay where they are. The free
    section, mirrored at the axis and made longer at both ends, grows by the distance (its Minkowski sum with a disc,
    with mitred corners); what is left of the solid are the new obstacles. Obstacles that touch become one, with the
    name of the first.

    Parameters
    ----------
    outline : of a body of revolution
    distance : by which walls move [m]; less than ten times what two points must be apart moves nothing

    Raises
    ------
    CaseError : an obstacle vanishes or falls apart, or a part of a wall moves by more than `MOST` distances: a ledge
        too near to the inlet or the outlet, a fin, an edge of the solid that is too sharp
    """
    import shapely

    top, bottom, tolerance = outline.z_top, outline.z_bottom, outline.tolerance
    if distance < 10 * tolerance:
        return outline
    vessel, solids = _mirrored(outline, MOST * distance)
    free = vessel.difference(shapely.union_all(list(solids.values()))) if solids else vessel
    wider, freer = (shape.buffer(distance, join_style="mitre", mitre_limit=20) for shape in (vessel, free))
    half = shapely.box(0.0, bottom, 2 * outline.r_max + 20 * distance, top)
    wall = _right_side(wider.intersection(half), outline)
    left = wider.difference(freer).buffer(-tolerance, join_style="mitre").buffer(tolerance, join_style="mitre")
    obstacles = _remaining(left.intersection(half), solids, outline, distance)
    faces = [shapely.LineString(wall), *(shapely.LinearRing(one) for one in obstacles.values())]
    _check_moved(outline, freer, shapely.union_all(faces), distance)
    try:
        made = Outline.of(wall, obstacles, outline.sections)
    except CaseError as error:
        raise CaseError(f"set back by {distance:.3g} m they make no vessel: {error.message}", WALLS_KEY) from None
    return replace(made, wall=_ends_level(made.wall, top, bottom))


def _mirrored(outline: Outline, beyond: float) -> tuple[BaseGeometry, dict[str, BaseGeometry]]:
    """Both halves of the vessel, longer at either end by a length [m], and of each obstacle."""
    import shapely

    wall, ends = outline.wall, np.array([0.0, 10 * beyond])
    longer = np.vstack([wall[0] + ends, wall, wall[-1] - ends])
    mirror = np.array([-1.0, 1.0])
    vessel = shapely.Polygon(np.vstack([longer, longer[::-1] * mirror]))
    solids = {
        name: shapely.union_all([shapely.Polygon(one), shapely.Polygon(one * mirror)])
        for name, one in outline.obstacles.items()
    }
    return vessel, solids


def _right_side(vessel: BaseGeometry, outline: Outline) -> Array:
    """(n, 2) the wall from the top down, of the half of a vessel that lies right of the axis."""
    import shapely

    vessel = shapely.simplify(vessel, outline.tolerance)
    ring = np.array(shapely.geometry.polygon.orient(vessel, sign=-1.0).exterior.coords)[:-1]
    start = int(np.abs(ring - [0.0, outline.z_top]).sum(axis=1).argmin())
    return _rounded(np.roll(ring, -start, axis=0)[1:-1], outline)


def _remaining(
    left: BaseGeometry, solids: dict[str, BaseGeometry], outline: Outline, distance: float
) -> dict[str, Array]:
    """What is left of the obstacles, right of the axis."""
    import shapely

    tolerance = outline.tolerance
    pieces = [piece for piece in shapely.get_parts(left) if piece.geom_type == "Polygon" and piece.area > tolerance**2]
    found: dict[str, Array] = {}
    owned: dict[str, list[int]] = {
        name: [i for i, piece in enumerate(pieces) if piece.intersection(solid).area > tolerance**2]
        for name, solid in solids.items()
    }
    taken: set[int] = set()
    for name, parts in owned.items():
        if not parts:
            raise _refused(f"nothing is left of it: it is thinner than {2 * distance:.3g} m", distance, name)
        if len(parts) > 1:
            raise _refused(f"it falls into {len(parts)} parts", distance, name)
        if parts[0] in taken:
            continue
        taken.add(parts[0])
        piece: Any = pieces[parts[0]]
        if len(piece.interiors):
            raise _refused("it would surround a part of the vessel", distance, name)
        found[name] = _rounded(np.array(shapely.simplify(piece, tolerance).exterior.coords)[:-1], outline)
    return found


def _check_moved(outline: Outline, free: BaseGeometry, faces: BaseGeometry, distance: float) -> None:
    """CaseError where a place of a wall or an obstacle is too far from where the walls are now.

    Parameters
    ----------
    free, faces : what particles may fill, and the lines that bound it, right of the axis
    """
    import shapely

    step = max(distance, _FINEST * (outline.z_top - outline.z_bottom + outline.r_max))
    most = MOST * distance * (1 + 1e-6) + outline.tolerance
    solids = {name: shapely.Polygon(one) for name, one in outline.obstacles.items()}
    drawn: list[tuple[KeyPath, BaseGeometry]] = [(WALL_KEY, shapely.LineString(outline.wall))]
    drawn += [(obstacle_key(name), solid.boundary) for name, solid in solids.items()]
    for key, line in drawn:
        places = shapely.get_coordinates(shapely.segmentize(line, step))
        points = shapely.points(places)
        seen = shapely.distance(points, free) <= outline.tolerance  # where solids touch each other nothing is free
        moved = np.where(seen, shapely.distance(points, faces), 0.0)
        worst = int(moved.argmax())
        if moved[worst] > most:
            r, z = places[worst]
            raise CaseError(
                f"[{r:.6g}, {z:.6g}] would move by {moved[worst]:.3g} m where walls are set back by {distance:.3g} m "
                f"(dem.walls), more than {MOST:g} times as far: a ledge too near to the inlet or the outlet, a fin, or "
                "an edge sharper than 39°; draw it longer, thicker or blunter, take a smaller "
                "dem.coarse_grain_factor, or set dem.walls: as_drawn",
                key,
            )


def _refused(what: str, distance: float, name: str) -> CaseError:
    return CaseError(
        f"set back by {distance:.3g} m from every side (dem.walls): {what}; take a smaller dem.coarse_grain_factor, or "
        "set dem.walls: as_drawn",
        obstacle_key(name),
    )


def _rounded(points: Array, outline: Outline) -> Array:
    step = _ROUNDING * (outline.z_top - outline.z_bottom + outline.r_max)
    return np.asarray(step * np.round(points / step))


def _ends_level(wall: Array, top: float, bottom: float) -> Array:
    """The wall with its ends exactly at the levels of inlet and outlet."""
    level = wall.copy()
    level[0, 1], level[-1, 1] = top, bottom
    level.setflags(write=False)
    return level
