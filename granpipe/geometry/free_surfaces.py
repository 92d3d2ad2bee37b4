"""Voids that solids leave below overhangs: bounded by surfaces at the angle of repose.

A void lies below every underside of wall or obstacle that is flatter than the angle of repose: the surface starts at
the edge from which the solids come, falls away from it, and ends where it meets another wall, the axis or the surface
from the underside's other edge. In r–z such surfaces are cones, in a slab they are flat.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, tan
from typing import Any

import numpy as np

from granpipe.errors import CaseError
from granpipe.field import Array
from granpipe.geometry.outline import Outline


@dataclass(frozen=True)
class _Underside:
    """Edges that face downwards, by rising r or x; whether solids pass by its inner and its outer end."""

    points: Array
    open_inside: bool
    open_outside: bool


def voids(outline: Outline, angle: float) -> list[Array]:
    """Voids in the vessel as closed polygons (n, 2) [m], for surfaces at an angle from the horizontal [rad].

    Raises
    ------
    CaseError : a surface would reach the outlet, so that the solids there do not fill the vessel; or there is a pocket
        that is open below only, which no solids reach and no surface closes
    """
    found, low = _voids(outline, angle), outline.z_bottom
    for part in found:
        if part[:, 1].min() <= low + outline.tolerance:
            raise CaseError(
                f"the free surface that starts at z = {part[:, 1].max():.4g} m, {np.degrees(angle):.0f}° from the "
                f"horizontal, reaches the outlet at z = {low:.4g} m: the solids do not fill the vessel; lengthen it "
                "below the widening, or use particles (model: dem)",
                ("outline", "wall"),
            )
    if (pocket := next(_pockets(outline, found), None)) is not None:
        r, z = pocket
        raise CaseError(
            f"at r = {r:.4g}, z = {z:.4g} m there is a pocket that is open below only: solids do not rise into it, and "
            "no free surface is cut across one; close it, make its roof flatter than the angle of repose "
            f"({np.degrees(angle):.0f}°), or use particles (model: dem)",
            ("outline", "obstacles" if outline.obstacles else "wall"),
        )
    return found


def free_surfaces(outline: Outline, angle: float) -> list[Array]:
    """The surfaces that bound the voids, as lines (n, 2) [m]: what of their edges lies within the vessel."""
    import shapely

    border = outline.border
    solids = [np.vstack([border, border[:1]]), *(np.vstack([p, p[:1]]) for p in outline.obstacles.values())]
    near = shapely.union_all([shapely.LineString(one) for one in solids]).buffer(outline.tolerance)
    found: list[Array] = []
    for polygon in _voids(outline, angle):
        rest = shapely.LinearRing(polygon).difference(near)
        merged = shapely.line_merge(rest) if rest.geom_type == "MultiLineString" else rest
        found += [np.array(part.coords) for part in shapely.get_parts(merged)]
    return found


def _pockets(outline: Outline, empty: list[Array]) -> Iterator[tuple[float, float]]:
    """Highest points (r, z) of the filled space, but for the inlet: what lies below them could only fill upwards."""
    import shapely

    filled = _free_space(outline).difference(shapely.union_all([shapely.Polygon(one) for one in empty]))
    slack = 10 * outline.tolerance
    for part in shapely.get_parts(filled.simplify(slack)):
        part = shapely.geometry.polygon.orient(part)  # the filled space lies on the left of every edge
        for ring in (part.exterior, *part.interiors):
            points = np.array(ring.coords)[:-1]
            rise = np.roll(points[:, 1], -1) - points[:, 1]
            steep = np.flatnonzero(np.abs(rise) > slack)
            for up, down in zip(steep, np.roll(steep, -1), strict=True):
                first, last = (up + 1) % len(points), down  # ends of a level top, often one point
                if rise[up] <= 0 or rise[down] >= 0 or points[first, 1] > outline.z_top - slack:
                    continue
                into = points[first] - points[up]
                out = points[(down + 1) % len(points)] - points[last]
                level = points[first, 0] - points[last, 0]
                if level > slack or (abs(level) <= slack and into[0] * out[1] - into[1] * out[0] > 0):
                    yield float(points[first, 0]), float(points[first, 1])


def _free_space(outline: Outline) -> Any:
    """The vessel without its obstacles."""
    import shapely

    free = shapely.Polygon(outline.border)
    return free.difference(shapely.union_all([shapely.Polygon(p) for p in outline.obstacles.values()]))


def _voids(outline: Outline, angle: float) -> list[Array]:
    import shapely

    chains = [*_undersides(outline, angle)]
    if not chains:
        return []
    free = _free_space(outline)
    parts: list[Any] = []
    for chain in chains:
        region = free.intersection(shapely.Polygon(_below(chain, angle, outline)))
        own = shapely.LineString(chain.points)
        parts += [p for p in shapely.get_parts(region) if p.distance(own) <= outline.tolerance and p.area > 0]
    whole = shapely.get_parts(shapely.union_all(parts))
    found = [part for part in whole if part.area > outline.tolerance * (outline.r_max - outline.r_min)]
    return [np.array(part.exterior.coords)[:-1] for part in found]


def _undersides(outline: Outline, angle: float) -> Iterator[_Underside]:
    turn = np.array([-1.0, 1.0])
    yield from _chains(outline.wall, False, angle, lambda one: (True, False))
    for left in outline.halves[1:]:
        for chain in _chains(left.wall, False, angle, lambda one: (True, False)):
            yield _Underside(chain.points[::-1] * turn, chain.open_outside, chain.open_inside)

    def ends(points: Array) -> tuple[bool, bool]:
        at_axis = points[0, 0] <= float(outline.left_end(points[0, 1])) + outline.tolerance
        at_wall = points[-1, 0] >= float(outline.wall_radius(points[-1, 1])) - outline.tolerance
        return not at_axis, not at_wall

    for polygon in outline.obstacles.values():
        yield from _chains(polygon, True, angle, ends)


def _chains(points: Array, closed: bool, angle: float, ends: Any) -> Iterator[_Underside]:
    """Runs of flat edges that face downwards: solid lies to the left of an edge, so those that go outwards."""
    line = np.vstack([points, points[:1]]) if closed else points
    step = np.diff(line, axis=0)
    flat = [dr > 0 and atan2(abs(dz), dr) < angle for dr, dz in step]
    if closed and all(flat):
        return
    count = len(step)
    for start in range(count):
        if not flat[start] or (flat[start - 1] if start or closed else False):
            continue
        end = start
        while flat[end % count] and (closed or end < count):
            end += 1
            if not closed and end == count:
                break
        chain = line[[i % count if closed else i for i in range(start, end + 1)]]
        inside, outside = ends(chain)
        if closed:  # solid that goes on downwards closes an end
            inside &= step[start - 1][1] < 0
            outside &= step[end % count][1] > 0
        if inside or outside:
            yield _Underside(chain, bool(inside), bool(outside))


def _below(chain: _Underside, angle: float, outline: Outline) -> Array:
    """The region below an underside and above the surfaces that start at its open ends (n, 2)."""
    (r0, z0), (r1, z1) = chain.points[0], chain.points[-1]
    steep, far = tan(angle), outline.r_max - outline.r_min + outline.z_top - outline.z_bottom
    if chain.open_inside and chain.open_outside:
        r = 0.5 * (r0 + r1) + 0.5 * (z0 - z1) / steep
        return np.vstack([chain.points, [[r, z0 - steep * (r - r0)]]])
    if chain.open_inside:
        return np.vstack([chain.points, [[r0 + far, z1], [r0 + far, z0 - steep * far]]])
    return np.vstack([chain.points, [[r1 - far, z1 - steep * far], [r1 - far, z0]]])
