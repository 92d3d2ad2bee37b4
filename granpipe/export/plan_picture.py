"""What a plan will do, drawn on the half section: sections and models, openings, free surfaces, feed and plate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.export.pictures import BLUE, DPI, INK, RED, REST, STONE, STYLE
from granpipe.field import Array
from granpipe.system.surroundings import own_style

REPOSE = np.radians(34.0)
"""Angle of the free surfaces that are drawn: 33 to 34° was measured with the default friction."""


@dataclass(frozen=True)
class Planned:
    """What is drawn; lengths in m.

    Parameters
    ----------
    wall : (n, 2) from the inlet down
    obstacles : name → (m, 2) corners
    sections : name → top, bottom, and whether particles are simulated there
    openings : name → level, inner and outer radius
    feed : levels of the feed above the inlet; None without particles
    plate : levels of the plate at the start and at the end; None without one
    """

    wall: Array
    obstacles: Mapping[str, Array]
    sections: Mapping[str, tuple[float, float, bool]]
    openings: Mapping[str, tuple[float, float, float]]
    feed: tuple[float, float] | None
    plate: tuple[float, float] | None


def plan_picture(planned: Planned, title: str, path: Path) -> None:
    """Draw a plan into a PNG file."""
    from matplotlib.figure import Figure

    wall = planned.wall
    levels = [*wall[:, 1], *(planned.feed or ()), *(planned.plate or ())]
    height, width = max(levels) - min(levels), float(wall[:, 0].max())
    with own_style(STYLE):
        figure = Figure(figsize=(float(np.clip(7.0 * width / height + 3.2, 4.5, 12.0)), 7.5), layout="constrained")
        axes = figure.add_subplot()
        for name, (top, bottom, particles) in planned.sections.items():
            outline = _between(wall, top, bottom)
            axes.fill(*outline.T, color=REST if particles else BLUE, alpha=0.5 if particles else 0.25, linewidth=0)
            what = "particles" if particles else "fluid"
            axes.text(1.04 * width, 0.5 * (top + bottom), f"{name}: {what}", fontsize=8, va="center")
            axes.axhline(top, color=STONE, linewidth=0.4, linestyle=":")
        for polygon in planned.obstacles.values():
            axes.fill(*polygon.T, facecolor=STONE, edgecolor=INK)
        axes.plot(*wall.T, color=INK, linewidth=1.5)
        axes.axvline(0.0, color=STONE, linestyle="-.", linewidth=0.8)
        for line in free_surfaces(wall, planned.obstacles):
            axes.plot(*line.T, color=RED, linestyle="--", linewidth=1.0)
        for number, (name, (z, inner, outer)) in enumerate(planned.openings.items()):
            axes.annotate("", (outer, z), (inner, z), arrowprops={"arrowstyle": "<->", "color": BLUE, "linewidth": 0.8})
            above = (0, 3 + 8 * (number % 2))  # two openings at one level
            place = (0.5 * (inner + outer), z)
            axes.annotate(name, place, above, textcoords="offset points", fontsize=7, ha="center")
        if planned.feed is not None:
            axes.fill_between([0, wall[0, 0]], wall[0, 1], planned.feed[1], color=REST, alpha=0.25, linewidth=0)
            axes.text(0.05 * width, planned.feed[1], "reservoir and feed", fontsize=7, va="top")
        for level, name in zip(planned.plate or (), ("plate at the start", "plate at the end"), strict=False):
            axes.plot([0, wall[-1, 0]], [level, level], color=INK, linewidth=2.0)
            axes.annotate(name, (0.05 * width, level), (0, 3), textcoords="offset points", fontsize=7)
        axes.set(xlabel="r [m]", ylabel="z [m]", xlim=(-0.03 * width, 2.0 * width), title=title, aspect="equal")
        figure.text(0.01, 0.005, "red: free surfaces to be expected (34°)", fontsize=7, color=RED)
        figure.savefig(path, dpi=DPI)


def free_surfaces(wall: Array, obstacles: Mapping[str, Array]) -> list[Array]:
    """Lines (2, 2) [m] from the edges under which solids leave a void, at the angle of repose, to the next solid.

    Those edges are where the wall widens downwards, and the lowest of the outermost and innermost points of obstacles.
    """
    import shapely

    free = shapely.Polygon([(0.0, wall[0, 1]), *wall, (0.0, wall[-1, 1])])
    for polygon in obstacles.values():
        free = free.difference(shapely.Polygon(polygon))
    edges = [(wall[i], 1.0) for i in range(1, len(wall) - 1) if _overhangs(wall[i + 1] - wall[i])]
    edges = [edge for i, edge in enumerate(edges) if i == 0 or not np.array_equal(edge[0], edges[i - 1][0])]
    for polygon in obstacles.values():
        for radius, side in ((polygon[:, 0].max(), -1.0), (polygon[:, 0].min(), 1.0)):
            lowest = polygon[np.isclose(polygon[:, 0], radius)][:, 1].min()
            beside = shapely.Point(radius - side * 1e-6 * wall[:, 0].max(), lowest)
            if free.contains(beside):
                edges.append((np.array([radius, lowest]), side))
    return [line for corner, side in edges if (line := _surface(free, corner, side)) is not None]


def _overhangs(step: Array) -> bool:
    """Whether a piece of wall, from the top down, is flatter than the surface that solids below it form."""
    return bool(step[0] > 0 and -step[1] < step[0] * np.tan(REPOSE) + 1e-12)


def _surface(free: object, corner: Array, side: float) -> Array | None:
    import shapely

    far = 1e3 * (1.0 + float(np.abs(corner).max()))
    begin = corner + 1e-6 * np.array([side * np.cos(REPOSE), -np.sin(REPOSE)])
    line = shapely.LineString([begin, corner + far * np.array([side * np.cos(REPOSE), -np.sin(REPOSE)])])
    parts = shapely.get_parts(shapely.intersection(line, free))
    for part in parts:
        points = np.array(part.coords)
        if len(points) > 1 and np.abs(points[0] - begin).max() < 1e-9:
            return points
    return None


def _between(wall: Array, top: float, bottom: float) -> Array:
    """The half section between two levels (n, 2), from the axis round."""
    import shapely

    outline = shapely.Polygon([(0.0, wall[0, 1]), *wall, (0.0, wall[-1, 1])])
    part = outline.intersection(shapely.box(-1.0, bottom, 2 * wall[:, 0].max() + 1.0, top))
    parts = shapely.get_parts(part)
    return np.array(parts[int(np.argmax(shapely.area(parts)))].exterior.coords)
