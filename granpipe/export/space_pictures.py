"""Pictures of a field in space: vertical velocity on upright and level cuts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granpipe.export.pictures import DPI, STYLE, readable_unit
from granpipe.export.space import box_of, cell_fluxes
from granpipe.field import Array, Field
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

LEVELS = (0.85, 0.5, 0.15)
"""Of the height: where the level cuts lie."""

_COLOURED = 99.5  # percent of the cells within the colour range


def space_figure(field: Field, title: str, path: Path) -> None:
    """Write a picture of the vertical bulk velocity on the two upright cuts through the middle and three level ones."""
    from matplotlib.figure import Figure

    grid, w = box_of(field), cell_fluxes(field)[2] * field.velocity_scale
    unit, factor = readable_unit(float(np.abs(w[field.bulk]).max(initial=0.0)))
    values = np.where(field.bulk, w * factor, np.nan)
    limits = float(-np.nanpercentile(-values, _COLOURED)), max(0.0, float(np.nanpercentile(values, _COLOURED)))
    x, y, z = grid.r_edges, grid.y_edges, grid.z_edges
    nz, ny, nx = grid.shape
    upright = [(values[:, ny // 2], x, z, "x", f"y = {_middle(y, ny // 2):.3g} m")]
    upright += [(values[:, :, nx // 2], y, z, "y", f"x = {_middle(x, nx // 2):.3g} m")]
    rows = [min(nz - 1, int(part * nz)) for part in LEVELS]
    level = [(values[row], x, y, "x", f"z = {_middle(z, row):.3g} m") for row in rows]
    with own_style(STYLE):
        figure = Figure(figsize=(11, 5.5), layout="constrained")
        figure.suptitle(title, fontsize=10)
        places = figure.add_gridspec(len(LEVELS), 3)
        panels = [figure.add_subplot(places[:, k]) for k in range(2)]
        panels += [figure.add_subplot(places[k, 2]) for k in range(len(LEVELS))]
        for axis, (cut, across, up, name, where) in zip(panels, [*upright, *level], strict=True):
            image = _draw(axis, cut, across, up, limits)
            axis.set_title(where, fontsize=8.5)
            axis.set_xlabel(f"{name} [m]", fontsize=8)
            axis.set_ylabel("z [m]" if up is z else "y [m]", fontsize=8)
            axis.tick_params(labelsize=7.5)
            axis.locator_params(axis="x", nbins=4 if up is z else 3)
        figure.colorbar(image, ax=panels, orientation="horizontal", shrink=0.5, extend="both").set_label(
            f"vertical velocity [{unit}]", fontsize=8.5
        )
        figure.savefig(path, dpi=DPI)


def _draw(axis: Axes, values: Array, across: Array, up: Array, limits: tuple[float, float]) -> QuadMesh:
    axis.set_aspect("equal")
    axis.set_facecolor("0.93")
    return axis.pcolormesh(across, up, values, vmin=limits[0], vmax=limits[1], cmap="viridis", rasterized=True)


def _middle(edges: Array, cell: int) -> float:
    """Middle of a cell, to a thousandth of its width: in the middle of the vessel 0 and no rounding error."""
    step = 1e-3 * float(edges[cell + 1] - edges[cell])
    return step * round(0.5 * float(edges[cell] + edges[cell + 1]) / step)
