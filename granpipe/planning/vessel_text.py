"""A vessel as text, for people who want to see whether their drawing was understood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import yaml

from granpipe.dem.filling import PACKING
from granpipe.dem.gaps import LEAST_GAP
from granpipe.dem.sizes import size_classes
from granpipe.field import Array
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.wall_mesh import WallOpening
from granpipe.planning.plan import Plan


def planned_vessel_text(plan: Plan) -> str:
    """The vessel of a plan, and what is in it."""
    vessel = vessel_text(plan.outline) if plan.space is None else space_text(plan.space)
    return f"{vessel}\n{contents_text(plan)}"


def vessel_text(outline: Outline) -> str:
    """Height, diameters, volume, openings and obstacles of a vessel."""
    openings = find_openings(outline)
    lines = [
        f"height    {outline.z_top - outline.z_bottom:.6g} m, from z = {outline.z_bottom:.6g} to {outline.z_top:.6g} m",
        f"inlet     {_ends(outline, 0)}",
        f"widest    {'⌀ ' if outline.measure.axial else ''}{outline.width:.6g} m",
        f"outlet    {_ends(outline, -1)}",
        f"volume    {outline.volume():.6g} m³"
        + ("" if outline.measure.axial else f", {outline.measure.turn:g} m deep"),
        *(f"opening   {one.name} at z = {one.z:.6g} m: a sphere of {one.gap:.6g} m passes" for one in openings),
    ]
    for name, polygon in outline.obstacles.items():
        (r0, z0), (r1, z1) = polygon.min(axis=0), polygon.max(axis=0)
        across = "r" if outline.measure.axial else "x"
        lines.append(f"obstacle  {name}: {across} = {r0:.6g} … {r1:.6g} m, z = {z0:.6g} … {z1:.6g} m")
    return "\n".join(lines)


def space_text(vessel: SpaceVessel) -> str:
    """Height, size, volume and openings of a vessel in space."""
    (x0, x1), (y0, y1), (z0, z1) = vessel.walls.ends.tolist()
    lines = [
        f"height    {z1 - z0:.6g} m, from z = {z0:.6g} to {z1:.6g} m",
        f"width     {x1 - x0:.6g} m, x = {x0:.6g} … {x1:.6g} m",
        f"depth     {y1 - y0:.6g} m, y = {y0:.6g} … {y1:.6g} m",
        f"volume    {vessel.outline.volume():.4g} m³",
        f"walls     {vessel.walls.walls} triangles, {int(vessel.walls.parts.max())} obstacles",
        f"inlet     {_placed(vessel.inlet)}",
    ]
    for one in vessel.outlets:
        side = ", in a side wall" if one.spout.fall else ""
        lines.append(f"outlet    {one.name}: {_placed(one.opening)}{side}, {one.share:.4g} of the flow")
        lines.append(f"opening   to {one.name}: a sphere of {one.gap:.4g} m passes")
    return "\n".join(lines)


def contents_text(plan: Plan) -> str:
    """What is in the vessel of a plan: mass, particles, and how many of them the openings pass side by side."""
    material, classes = plan.case.material, size_classes(plan.case.material.size)
    density, source = material.bulk_density, "of the case"
    if density is None:
        density, source = PACKING * material.density, f"for a packing of {PACKING:g}"
    factor = plan.case.dem.coarse_grain_factor
    simulated = classes.enlarged(factor)
    number = density / material.density * plan.simulated.volume() / simulated.mean_volume
    lines = [
        f"material  {density * plan.outline.volume() / 1000:.3g} t in the vessel, {density:.4g} kg/m³ {source}",
        f"particles {number:.0f} in the vessel, ⌀ {2 * classes.smallest:.4g} … {2 * classes.largest:.4g} m, "
        f"d90 {classes.d90:.4g} m" + ("" if factor == 1 else f", simulated with ⌀ × {factor:g}"),
    ]
    for one in plan.openings if plan.set_back is None else find_openings(plan.set_back):
        lines.append(f"opening   {one.name}: {one.gap / simulated.d90:.3g} × d90 (at least {LEAST_GAP:g}, better 10)")
    return "\n".join(lines)


def outline_yaml(unit: str, wall: Array, obstacles: Mapping[str, Array]) -> str:
    """`outline` of a case with typed points, to be pasted into a case file."""
    data = {"unit": unit, "wall": _rows(wall), "obstacles": {name: _rows(one) for name, one in obstacles.items()}}
    if not obstacles:
        del data["obstacles"]
    return yaml.safe_dump({"outline": data}, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)


def _ends(outline: Outline, end: int) -> str:
    """Diameter of the inlet (0) or outlet (−1), or where a slab begins and ends there."""
    left, right = outline.left[end, 0], outline.wall[end, 0]
    return f"⌀ {2 * right:.6g} m" if outline.measure.axial else f"{right - left:.6g} m, x = {left:.6g} … {right:.6g} m"


def _placed(opening: WallOpening) -> str:
    x, y = opening.centre
    return f"{opening.area:.4g} m² at x = {x:.4g} m, y = {y:.4g} m, z = {opening.z:.4g} m"


def _rows(points: Array) -> Sequence[Sequence[float]]:
    return [[float(f"{value:.10g}") for value in point] for point in points]
