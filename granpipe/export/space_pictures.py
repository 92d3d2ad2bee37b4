"""Pictures of a field in space: vertical velocity on upright and level cuts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.errors import DataError
from granpipe.export.pictures import DPI, STYLE, readable_unit
from granpipe.export.space import box_of, cell_fluxes
from granpipe.field import Array, Field
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

LEVELS = (0.85, 0.5, 0.15)
"""Of the height: where the level cuts lie."""

_COLOURED = 99.5  # percent of the cells within the colour range
_ARROWS = 24  # along the longer side of a cut
_STILL = 1e-3  # of the highest speed in a cut: no arrow below it


def space_figure(field: Field, title: str) -> Figure:
    """Vertical bulk velocity on the two upright cuts through the middle and three level ones."""
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
            axis.locator_params(axis="x", nbins=4 if up is z else 2)
        figure.colorbar(image, ax=panels, orientation="horizontal", shrink=0.5, extend="both").set_label(
            f"vertical velocity [{unit}]", fontsize=8.5
        )
    return figure


def write_space_figure(field: Field, title: str, path: Path) -> None:
    """Write that picture."""
    space_figure(field, title).savefig(path, dpi=DPI)


def cut_figure(field: Field, axis: str, at: float, title: str) -> Figure:
    """Speed on a cut across x, y or z, with the direction of the flow in it.

    Parameters
    ----------
    axis : ``x``, ``y`` or ``z``
    at : where the cut lies on it [m]: the cells there are drawn

    Raises
    ------
    DataError : the cut lies outside the grid, or meets no solids
    """
    from matplotlib.figure import Figure

    grid, flux = box_of(field), cell_fluxes(field)
    lines = {"x": grid.r_edges, "y": grid.y_edges, "z": grid.z_edges}
    edges = lines[axis]
    if not edges[0] <= at <= edges[-1]:
        raise DataError(f"{axis} = {at:g} m lies outside the field, {edges[0]:.4g} … {edges[-1]:.4g} m")
    cell = int(np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(edges) - 2))
    place: list[Any] = [slice(None)] * 3
    place["zyx".index(axis)] = cell
    bulk = field.bulk[tuple(place)]
    if not bulk.any():
        raise DataError(f"no solids flow or rest on the cut {axis} = {at:g} m")
    velocity = {name: one[tuple(place)] * field.velocity_scale for name, one in zip("xyz", flux, strict=True)}
    speed = np.sqrt(sum(one**2 for one in velocity.values()))
    unit, factor = readable_unit(float(speed[bulk].max()))
    across, up = (name for name in "xyz" if name != axis)
    values = np.where(bulk, factor * speed, np.nan)
    with own_style(STYLE):
        figure = Figure(figsize=(6.5, 6.0), layout="constrained")
        panel = figure.add_subplot()
        image = _draw(panel, values, lines[across], lines[up], (0.0, float(np.nanpercentile(values, _COLOURED))))
        size = np.hypot(velocity[across], velocity[up])
        drawn = bulk & (size > _STILL * float(size[bulk].max()))
        step = max(1, max(bulk.shape) // _ARROWS)
        kept = np.zeros_like(drawn)
        kept[step // 2 :: step, step // 2 :: step] = True
        rows, columns = np.nonzero(drawn & kept)
        middles = [0.5 * (lines[name][1:] + lines[name][:-1]) for name in (across, up)]
        ends = [np.divide(velocity[n], size, out=np.zeros_like(size), where=size > 0) for n in (across, up)]
        panel.quiver(
            middles[0][columns], middles[1][rows], *(one[rows, columns] for one in ends),
            color="white", scale=1.5 * _ARROWS, width=0.004, pivot="middle",
        )  # fmt: skip
        panel.set_title(f"{title}, {axis} = {_middle(edges, cell):.3g} m", fontsize=10)
        panel.set_xlabel(f"{across} [m]")
        panel.set_ylabel(f"{up} [m]")
        figure.colorbar(image, ax=panel, extend="max").set_label(f"speed of the bulk [{unit}]")
    return figure


def _draw(axis: Axes, values: Array, across: Array, up: Array, limits: tuple[float, float]) -> QuadMesh:
    axis.set_aspect("equal")
    axis.set_facecolor("0.93")
    return axis.pcolormesh(across, up, values, vmin=limits[0], vmax=limits[1], cmap="viridis", rasterized=True)


def _middle(edges: Array, cell: int) -> float:
    """Middle of a cell, to a thousandth of its width: in the middle of the vessel 0 and no rounding error."""
    step = 1e-3 * float(edges[cell + 1] - edges[cell])
    return step * round(0.5 * float(edges[cell] + edges[cell + 1]) / step)
