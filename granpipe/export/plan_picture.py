"""What a plan will do, drawn on the half section: sections and models, openings, free surfaces, feed and plate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.export.pictures import BLUE, DPI, INK, RED, REST, STONE, STYLE
from granpipe.field import Array
from granpipe.system.surroundings import own_style


@dataclass(frozen=True)
class Planned:
    """What is drawn; lengths in m.

    Parameters
    ----------
    wall, left : (n, 2) from the inlet down; left is the axis, or the left wall of a slab
    axial : whether left is the axis
    obstacles : name → (m, 2) corners
    sections : name → top, bottom, and whether particles are simulated there
    openings : name → level, inner and outer radius
    feed : levels of the feed above the inlet; None without particles
    plate : levels of the plate at the start and at the end; None without one
    surfaces : lines (n, 2) of the free surfaces to be expected
    repose : their angle from the horizontal [rad]
    set_back : lines (n, 2) of the walls that particles see where these are not those as drawn
    """

    wall: Array
    left: Array
    axial: bool
    obstacles: Mapping[str, Array]
    sections: Mapping[str, tuple[float, float, bool]]
    openings: Mapping[str, tuple[float, float, float]]
    feed: tuple[float, float] | None
    plate: tuple[float, float] | None
    surfaces: Sequence[Array]
    repose: float
    set_back: Sequence[Array] = ()


def plan_picture(planned: Planned, title: str, path: Path) -> None:
    """Draw a plan into a PNG file."""
    from matplotlib.figure import Figure

    wall, left = planned.wall, planned.left
    levels = [*wall[:, 1], *(planned.feed or ()), *(planned.plate or ())]
    height, width = max(levels) - min(levels), float(wall[:, 0].max() - left[:, 0].min())
    right, begin = float(wall[:, 0].max()), float(left[:, 0].min())
    with own_style(STYLE):
        figure = Figure(figsize=(float(np.clip(7.0 * width / height + 3.2, 4.5, 12.0)), 7.5), layout="constrained")
        axes = figure.add_subplot()
        for name, (top, bottom, particles) in planned.sections.items():
            outline = _between(left, wall, top, bottom)
            axes.fill(*outline.T, color=REST if particles else BLUE, alpha=0.5 if particles else 0.25, linewidth=0)
            what = "particles" if particles else "fluid"
            axes.text(right + 0.04 * width, 0.5 * (top + bottom), f"{name}: {what}", fontsize=8, va="center")
            axes.axhline(top, color=STONE, linewidth=0.4, linestyle=":")
        for polygon in planned.obstacles.values():
            axes.fill(*polygon.T, facecolor=STONE, edgecolor=INK)
        axes.plot(*wall.T, color=INK, linewidth=1.5)
        if planned.axial:
            axes.axvline(0.0, color=STONE, linestyle="-.", linewidth=0.8)
        else:
            axes.plot(*left.T, color=INK, linewidth=1.5)
        for line in planned.set_back:
            axes.plot(*line.T, color=INK, linestyle=":", linewidth=1.0)
        for line in planned.surfaces:
            axes.plot(*line.T, color=RED, linestyle="--", linewidth=1.0)
        for number, (name, (z, inner, outer)) in enumerate(planned.openings.items()):
            axes.annotate("", (outer, z), (inner, z), arrowprops={"arrowstyle": "<->", "color": BLUE, "linewidth": 0.8})
            above = (0, 3 + 8 * (number % 2))  # two openings at one level
            place = (0.5 * (inner + outer), z)
            axes.annotate(name, place, above, textcoords="offset points", fontsize=7, ha="center")
        if planned.feed is not None:
            axes.fill_between(
                [left[0, 0], wall[0, 0]], wall[0, 1], planned.feed[1], color=REST, alpha=0.25, linewidth=0
            )
            axes.text(left[0, 0] + 0.05 * width, planned.feed[1], "reservoir and feed", fontsize=7, va="top")
        for level, name in zip(planned.plate or (), ("plate at the start", "plate at the end"), strict=False):
            axes.plot([left[-1, 0], wall[-1, 0]], [level, level], color=INK, linewidth=2.0)
            axes.annotate(name, (left[-1, 0] + 0.05 * width, level), (0, 3), textcoords="offset points", fontsize=7)
        across = "r [m]" if planned.axial else "x [m]"
        axes.set(
            xlabel=across, ylabel="z [m]", xlim=(begin - 0.03 * width, begin + 2.0 * width), title=title, aspect="equal"
        )
        told = f"red: free surfaces to be expected ({np.degrees(planned.repose):.0f}°)"
        figure.text(0.01, 0.005, told, fontsize=7, color=RED)
        if planned.set_back:
            figure.text(0.99, 0.005, "dotted: walls that particles see", fontsize=7, color=INK, ha="right")
        figure.savefig(path, dpi=DPI)


def _between(left: Array, wall: Array, top: float, bottom: float) -> Array:
    """The section between two levels (n, 2)."""
    import shapely

    outline = shapely.Polygon([*wall, *left[::-1]])
    part = outline.intersection(shapely.box(left[:, 0].min() - 1.0, bottom, wall[:, 0].max() + 1.0, top))
    parts = shapely.get_parts(part)
    return np.array(parts[int(np.argmax(shapely.area(parts)))].exterior.coords)
