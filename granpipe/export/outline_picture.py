"""A picture of a vessel's half section with dimensions, to check how a drawing was read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from granpipe.export.pictures import DPI, INK, STONE, STYLE
from granpipe.field import Array
from granpipe.system.surroundings import own_style

MOST_LABELS = 40
"""Corners with their coordinates; a flattened curve has too many."""


def outline_picture(wall: Array, obstacles: Mapping[str, Array], unit: str, path: Path) -> None:
    """Draw wall, axis and obstacles with the coordinates of their corners.

    Parameters
    ----------
    wall : (n, 2) r and z from the inlet down, in `unit`
    obstacles : name → (m, 2) corners
    path : PNG file to write
    """
    from matplotlib.figure import Figure

    height, width = float(np.ptp(wall[:, 1])), float(wall[:, 0].max())
    tall = 8.0
    with own_style(STYLE):
        figure = Figure(figsize=(min(14.0, max(5.0, tall * width / height + 3.0)), tall), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(*wall.T, color=INK, linewidth=1.5)
        axes.axvline(0.0, color=STONE, linestyle="-.", linewidth=0.8)
        for end, name in ((wall[0], "inlet"), (wall[-1], "outlet")):
            axes.plot([0, end[0]], [end[1], end[1]], color=STONE, linestyle=":", linewidth=1.0)
            axes.annotate(name, (0, end[1]), (3, 3), textcoords="offset points", color=STONE)
        for name, polygon in obstacles.items():
            axes.fill(*polygon.T, facecolor=STONE, edgecolor=INK, alpha=0.6)
            axes.annotate(name, polygon.mean(axis=0), ha="center", va="center")
        corners = np.unique(np.vstack([wall, *obstacles.values()]), axis=0)
        for r, z in corners if len(corners) <= MOST_LABELS else ():
            axes.plot(r, z, ".", color=INK)
            axes.annotate(f"{r:.5g}, {z:.5g}", (r, z), (5, 2), textcoords="offset points", fontsize=7)
        axes.set(xlabel=f"r [{unit}]", ylabel=f"z [{unit}]", xlim=(-0.05 * width, 1.6 * width), aspect="equal")
        figure.savefig(path, dpi=DPI)
