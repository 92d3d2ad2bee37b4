"""From the lines of a drawing to wall and obstacles of the half section, found by their layers or by their shape.

The lines bound areas. The one that reaches from the inlet at the top to the outlet at the bottom is where solids flow.
The wall is its outer envelope r_out(z), the largest radius at each height, so that it never overhangs; what lies within
the envelope and outside the flow is an obstacle: an overhanging ledge, a cone on the axis, a free ring.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.drawings.lines import LARGEST, Line, Lines, Points
from granpipe.errors import CaseError

if TYPE_CHECKING:
    from shapely import Polygon

NEAR = 0.01
"""Of the drawing's size: a line that ends this near to another one without touching it was meant to touch it."""

TINY = 1e-3
"""Of the drawing's size: shorter edges are told, for they are rarely meant and make small triangles."""

MOST_POINTS = 50_000
"""Of all lines: more take minutes, and no mesh resolves them."""

_TURNS: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "y": ((1, 0), (0, 1)),
    "-y": ((1, 0), (0, -1)),
    "x": ((0, 1), (1, 0)),
    "-x": ((0, 1), (-1, 0)),
}
"""Direction that points up in the drawing → rows that make (across, up) of (x, y)."""


@dataclass(frozen=True, eq=False)
class HalfSection:
    """Wall and obstacles of a vessel in the drawing's unit.

    Parameters
    ----------
    wall : (n, 2) r and z from the inlet down to the outlet; z never rises
    obstacles : name → (m, 2) corners of a closed polygon, the first not repeated
    notes : what was found and assumed, a sentence each
    """

    wall: Points
    obstacles: dict[str, Points]
    notes: tuple[str, ...]


def half_section(drawing: Lines, axis: float | None = None, up: str = "y") -> HalfSection:
    """Wall and obstacles of the vessel that lines show.

    Parameters
    ----------
    axis : where the axis lies across the direction that points up; found from the drawing unless given
    up : direction of the drawing that points up: y, -y, x or -x

    Raises
    ------
    CaseError : the lines do not bound one vessel from inlet to outlet; the message names the coordinates
    """
    if not all((np.abs(line.points) <= LARGEST).all() for line in drawing.lines):
        raise CaseError(f"a coordinate is no number, or beyond {LARGEST:g}")
    lines = [Line(_turned(line.points, up), line.layer) for line in drawing.lines if len(line.points) > 1]
    if not lines:
        raise CaseError("holds no lines")
    if (count := sum(len(line.points) for line in lines)) > MOST_POINTS:
        raise CaseError(f"holds {count} points, {MOST_POINTS} at the most: export curves with fewer points")
    layers = _by_layer(lines)
    if "wall" not in layers and not layers.get(""):
        raise CaseError(f"holds no wall, only layers {', '.join(sorted({line.layer for line in lines}))}")
    used = [*layers["wall"], *layers.get("obstacle", [])] if "wall" in layers else lines
    tolerance = drawing.precision * _size(used)
    notes = []
    if "wall" in layers and (other := sorted({line.layer for line in layers.get("", [])})):
        notes.append(f"left out: layers {', '.join(other)}; layers wall, obstacle… and axis are used")
    if drawing.half:
        _check_radii(used, tolerance)
    _check_crossings(used, tolerance)
    place, how = (0.0, "") if drawing.half else _axis(used, layers.get("axis", []), axis, tolerance)
    if how:
        notes.append(f"axis at {place:.9g}: {how}")
    halves = [Line(points, line.layer) for line in used for points in _right_half(line.points, place, tolerance)]
    if not any(np.ptp(line.points, axis=0).max() > tolerance for line in halves):
        raise CaseError(f"nothing is drawn right of the axis at {place:.9g}")
    flow, given = _areas(halves, tolerance)
    wall, obstacles = _envelope(flow, [area for _, area in given], tolerance)
    _check_shell(wall, obstacles)
    notes += _tiny_edges([wall, *(np.vstack([polygon, polygon[:1]]) for polygon in obstacles)])
    names = _names(obstacles, given)
    return HalfSection(wall, dict(zip(names, obstacles, strict=True)), tuple(notes))


def _check_crossings(lines: Sequence[Line], tolerance: float) -> None:
    """CaseError where a line crosses itself: which of the areas that it bounds are meant is anybody's guess."""
    from shapely import LineString, STRtree, linestrings, points

    for line in lines:
        if LineString(line.points).is_simple:
            continue
        edges = linestrings(np.stack([line.points[:-1], line.points[1:]], axis=1))
        for first, second in STRtree(edges).query(edges, predicate="crosses").T:
            place = edges[first].intersection(edges[second])
            ends = points(np.concatenate([line.points[[first, first + 1]], line.points[[second, second + 1]]]))
            if min(place.distance(end) for end in ends) > tolerance:
                raise CaseError(f"a line crosses itself at ({place.x:.9g}, {place.y:.9g}): draw it without the loop")


def _check_radii(lines: Sequence[Line], tolerance: float) -> None:
    every = np.concatenate([line.points for line in lines])
    r, z = every[int(every[:, 0].argmin())]
    if r < -tolerance:
        raise CaseError(f"a negative radius at ({r:.9g}, {z:.9g}): give the half section, r from the axis")


def _check_shell(wall: Points, obstacles: Sequence[Points]) -> None:
    """Refuse a wall that was drawn with its thickness: its material would be taken for an obstacle."""
    for polygon in obstacles:
        if polygon[:, 1].min() <= wall[-1, 1] and polygon[:, 1].max() >= wall[0, 1]:
            r, z = polygon[0]
            raise CaseError(
                f"a closed line at ({r:.9g}, {z:.9g}) runs along the vessel from top to bottom: if it is the wall with "
                "its thickness, draw the inner face alone, as one line or on a layer wall"
            )


def _tiny_edges(lines: Sequence[Points]) -> list[str]:
    """A note for each edge that is too short to be meant."""
    size = float(np.ptp(lines[0], axis=0).max())
    return [
        f"an edge of {np.hypot(*(b - a)):.3g} between ({a[0]:.9g}, {a[1]:.9g}) and ({b[0]:.9g}, {b[1]:.9g})"
        for line in lines
        for a, b in pairwise(line)
        if np.hypot(*(b - a)) < TINY * size
    ]


def _turned(points: Points, up: str) -> Points:
    if up not in _TURNS:
        raise CaseError(f"{up} is no direction of a plane drawing; give y, -y, x or -x", ("outline", "up"))
    return np.asarray(points @ np.array(_TURNS[up], dtype=float).T)


def _size(lines: Sequence[Line]) -> float:
    every = np.concatenate([line.points for line in lines])
    size = float(np.ptp(every, axis=0).max())
    if size == 0:
        raise CaseError("all points are the same")
    return size


def _by_layer(lines: Sequence[Line]) -> dict[str, list[Line]]:
    """Lines by what their layer's name begins with: wall, obstacle, axis, or "" for all others."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        kind = next((k for k in ("wall", "obstacle", "axis") if line.layer.lower().startswith(k)), "")
        found.setdefault(kind, []).append(line)
    return found


def _axis(lines: Sequence[Line], drawn: Sequence[Line], given: float | None, tolerance: float) -> tuple[float, str]:
    """Where the axis is, and how it was found."""
    every = np.concatenate([line.points for line in lines])
    left, right = float(every[:, 0].min()), float(every[:, 0].max())
    if given is not None:
        return given, ""
    if drawn:
        across = np.concatenate([line.points[:, 0] for line in drawn])
        if np.ptp(across) > tolerance:
            raise CaseError(
                f"layer {drawn[0].layer} must hold one upright line; its points lie at {across.min():.9g} … "
                f"{across.max():.9g}"
            )
        return float(across.mean()), f"on layer {drawn[0].layer}"
    middle = 0.5 * (left + right)
    if abs(left) > tolerance and right - left > tolerance and _mirrored(lines, middle, tolerance):
        return middle, "the drawing is symmetrical about it"
    if left >= -tolerance:
        return 0.0, "nothing lies left of x = 0"
    raise CaseError(
        f"the axis is not clear: points lie from {left:.9g} to {right:.9g}, not symmetrically; draw it on a layer "
        "axis, or give outline.axis"
    )


def _mirrored(lines: Sequence[Line], middle: float, tolerance: float) -> bool:
    from shapely import MultiLineString, hausdorff_distance
    from shapely.affinity import scale

    drawing = MultiLineString([line.points for line in lines])
    return bool(hausdorff_distance(drawing, scale(drawing, -1, 1, origin=(middle, 0, 0))) <= 10 * tolerance)


def _right_half(points: Points, axis: float, tolerance: float) -> Iterator[Points]:
    """The stretches of a line that lie right of the axis, as radius and height; those along the axis are left out."""
    moved = points - [axis, 0.0]
    moved[np.abs(moved[:, 0]) <= tolerance, 0] = 0.0
    stretch: list[Any] = []
    for a, b in pairwise(moved):
        inside = a[0] > 0 or b[0] > 0
        if inside and a[0] * b[0] < 0:
            cut = np.array([0.0, a[1] - a[0] * (b[1] - a[1]) / (b[0] - a[0])])
            a, b = (cut, b) if a[0] < 0 else (a, cut)
        if inside and not stretch:
            stretch = [a, b]
        elif inside and np.array_equal(stretch[-1], a):
            stretch.append(b)
        elif stretch:
            yield np.array(stretch)
            stretch = [a, b] if inside else []
    if stretch:
        yield np.array(stretch)


def _areas(lines: Sequence[Line], tolerance: float) -> tuple[Polygon, list[tuple[str, Polygon]]]:
    """The area where solids flow, and what closed lines beside it bound, each with its layer."""
    from shapely import LineString, Polygon, polygonize, union_all

    snapped = zip(lines, _snapped([line.points for line in lines], tolerance), strict=True)
    lines, joined = zip(*((line, points) for line, points in snapped if len(points) > 1), strict=True)
    paths = [LineString(points) for points in joined]
    _check_gaps(paths, tolerance)
    every = np.concatenate(joined)
    low, high = float(every[:, 1].min()), float(every[:, 1].max())
    top, bottom = (float(every[np.abs(every[:, 1] - z) <= tolerance, 0].max()) for z in (high, low))
    for z, radius, end in ((high, top, "inlet"), (low, bottom, "outlet")):
        if radius <= tolerance:
            raise CaseError(f"the vessel has no {end}: at z = {z:.9g} it ends in a point on the axis")
    frame = [LineString([(0, low), (0, high)]), LineString([(0, high), (top, high)]),
             LineString([(0, low), (bottom, low)])]  # fmt: skip
    faces = [face for face in polygonize([union_all([*paths, *frame])]).geoms if face.area > tolerance**2]
    through = [face for face in faces if _on(face, (top, high)) and _on(face, (bottom, low))]
    if len(through) != 1:
        raise CaseError(_unbounded(faces, (top, high), (bottom, low)))
    flow = Polygon(through[0])
    border = flow.boundary.buffer(tolerance)
    for path in paths:  # polygons do not hold loose lines: a thin plate would be lost
        loose = path.intersection(flow).difference(border)
        if loose.length > 10 * tolerance:
            r, z = loose.centroid.coords[0]
            raise CaseError(f"a loose line inside the vessel near ({r:.9g}, {z:.9g}): close it, or take it out")
    drawn: list[tuple[str, Polygon]] = []
    for line, path in zip(lines, paths, strict=True):
        closed = _closed(path, tolerance)
        drawn += [(line.layer, area) for area in closed if not any(area.equals(other) for _, other in drawn)]
    return flow, [(layer, area) for layer, area in drawn if not area.covers(flow.representative_point())]


def _snapped(paths: Sequence[Points], tolerance: float) -> list[Points]:
    """The same polylines, points nearer than the tolerance made one; a short one may be left with a single point."""
    from scipy.spatial import cKDTree

    every = np.concatenate(paths)
    first = np.array([min(near) for near in cKDTree(every).query_ball_point(every, tolerance)])
    same = every[first[first]]
    same[:, 1] = _levelled(same[:, 1], tolerance)
    ends = np.cumsum([len(path) for path in paths])[:-1]
    return [path[np.r_[True, (np.diff(path, axis=0) != 0).any(axis=1)]] for path in np.split(same, ends)]


def _levelled(heights: Points, tolerance: float) -> Points:
    """Heights that differ by rounding only made equal."""
    order = np.argsort(heights)
    level = heights[order]
    for i in range(1, len(level)):
        if level[i] - level[i - 1] <= tolerance:
            level[i] = level[i - 1]
    result = np.empty_like(heights)
    result[order] = level
    return result


def _check_gaps(paths: Sequence[Any], tolerance: float) -> None:
    """Refuse a line that ends near another one without touching it."""
    from shapely import Point, line_merge, union_all
    from shapely.ops import nearest_points

    merged = line_merge(union_all(paths))
    chains = list(getattr(merged, "geoms", [merged]))
    size = max(np.ptp(np.array(union_all(paths).bounds).reshape(2, 2), axis=0))
    ends = [(Point(end), number) for number, chain in enumerate(chains) if not chain.is_ring
            for end in (chain.coords[0], chain.coords[-1])]  # fmt: skip
    for end, number in ends:
        for other, chain in enumerate(chains):
            distance = end.distance(chain)
            if other != number and tolerance < distance < NEAR * size:
                near = nearest_points(end, chain)[1]
                raise CaseError(
                    f"a gap of {distance:.3g}: a line ends at ({end.x:.9g}, {end.y:.9g}), the next one passes "
                    f"({near.x:.9g}, {near.y:.9g}); join them in the drawing"
                )
        if tolerance < end.x < NEAR * size and len(chains) > 1:
            raise CaseError(
                f"a gap of {end.x:.3g} to the axis: a line ends at ({end.x:.9g}, {end.y:.9g}); join it to the axis"
            )
    for (one, a), (two, b) in combinations(ends, 2):
        if a == b and tolerance < one.distance(two) < NEAR * size:
            raise CaseError(
                f"a gap of {one.distance(two):.3g} between ({one.x:.9g}, {one.y:.9g}) and ({two.x:.9g}, {two.y:.9g}); "
                "close the line in the drawing"
            )


def _closed(chain: Any, tolerance: float) -> list[Polygon]:
    """The polygon that a closed line bounds, or a line from axis to axis."""
    from shapely import Polygon

    points = np.array(chain.coords)
    ends = points[[0, -1]]
    if len(points) > 2 and (chain.is_ring or (ends[:, 0] <= tolerance).all()):
        return [Polygon(points)]
    return []


def _on(face: Polygon, point: tuple[float, float]) -> bool:
    from shapely import Point

    return bool(face.exterior.distance(Point(point)) == 0)


def _unbounded(faces: Sequence[Polygon], top: tuple[float, float], bottom: tuple[float, float]) -> str:
    """Why there is not one area from inlet to outlet."""
    above = [face for face in faces if _on(face, top)]
    if not faces or not above:
        return (
            f"no closed way from the inlet at ({top[0]:.9g}, {top[1]:.9g}) to the outlet at ({bottom[0]:.9g}, "
            f"{bottom[1]:.9g}): draw the wall as one line from top to bottom, or put it on a layer wall"
        )
    r0, z0, r1, _ = above[0].bounds
    return (
        f"a line crosses the vessel: the area below the inlet ends at z = {z0:.9g} (r = {r0:.9g} … {r1:.9g}), above "
        f"the outlet at z = {bottom[1]:.9g}; take the line out, or put the wall on a layer wall"
    )


def _envelope(flow: Polygon, given: Sequence[Polygon], tolerance: float) -> tuple[Points, list[Points]]:
    """The outer envelope of flow and obstacles from the top down, and the areas within it where nothing flows."""
    from shapely import Polygon, union_all

    low, high = flow.bounds[1], flow.bounds[3]
    beside = [area for area in given if low <= area.bounds[1] and area.bounds[3] <= high]
    filled = union_all([flow, *beside])
    filled = max(getattr(filled, "geoms", [filled]), key=lambda area: area.area)
    ring = np.array(filled.exterior.coords)
    strips = [
        Polygon([(0, a[1]), a, b, (0, b[1])]) for a, b in pairwise(ring) if abs(a[1] - b[1]) > 0 and max(a[0], b[0]) > 0
    ]
    whole = union_all(strips)
    outer = np.array(whole.exterior.coords)[:-1]
    top, bottom = outer[:, 1].max(), outer[:, 1].min()
    start = int(np.lexsort((-outer[:, 0], outer[:, 1] != top))[0])
    outer = np.roll(outer, -start, axis=0)
    stop = int(np.lexsort((-outer[:, 0], outer[:, 1] != bottom))[0])
    wall = outer[: stop + 1] if _downwards(outer[: stop + 1]) else np.vstack([outer[0], outer[: stop - 1 : -1]])
    solids = whole.difference(union_all([flow, *beside]))
    pieces = [*beside, *getattr(solids, "geoms", [solids])]
    pieces = [piece for piece in pieces if piece.area > tolerance * piece.length]
    obstacles = [_straightened(np.array(piece.exterior.coords)[:-1], tolerance, closed=True) for piece in pieces]
    return _straightened(wall, tolerance), sorted(obstacles, key=lambda points: -float(points[:, 1].max()))


def _downwards(points: Points) -> bool:
    return bool((np.diff(points[:, 1]) <= 0).all())


def _straightened(points: Points, tolerance: float, closed: bool = False) -> Points:
    """The same line without the points that lie on straight stretches of it."""
    from shapely import LineString

    def simplified(line: Points) -> Points:
        return np.array(LineString(line).simplify(tolerance).coords)

    if not closed:
        return simplified(points)
    # A ring is two lines between true corners: its lowest innermost point and the one farthest from that. Shapely would
    # keep the first points of a ring even where they are on a straight stretch.
    ring = np.roll(points, -int(np.lexsort((points[:, 1], points[:, 0]))[0]), axis=0)
    far = int(np.argmax(np.hypot(*(ring - ring[0]).T)))
    return np.vstack([simplified(ring[: far + 1])[:-1], simplified(np.vstack([ring[far:], ring[:1]]))[:-1]])


def _names(obstacles: Sequence[Points], given: Sequence[tuple[str, Polygon]]) -> list[str]:
    """A name for each obstacle: what follows obstacle_ in its layer's name, or obstacle1, obstacle2, … from the top."""
    from shapely import Polygon

    names: list[str] = []
    for number, points in enumerate(obstacles, start=1):
        inside = Polygon(points).representative_point()
        layer = next((layer for layer, area in given if area.covers(inside)), "")
        name = layer[len("obstacle") :].lstrip("_- ") or f"obstacle{number}"
        names.append(name if name not in names else f"{name}{number}")
    return names
