"""Pictures in the style of Sparta & Halvorsen (2017): the field on r–z, and the vessel with its particles.

No window and no X server: figures are made with matplotlib's Agg canvas, the vessel with pyvista off-screen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.errors import DataError
from granpipe.export.nodes import Nodes, nodal_errors, nodal_values, triangles
from granpipe.export.quantities import at_process_scale
from granpipe.field import Array, Field, Mask, level_flow
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Polygon = Sequence[tuple[float, float]]
Levels = Mapping[str, tuple[float, float]]
"""Section → upper and lower level [m]."""

DPI = 200
STYLE: dict[Any, Any] = {"font.size": 9, "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6}
INK, STONE, REST, BLUE, RED = "#222222", "#9a9a9a", "#d9c7a8", "#1f4e8c", "#c0392b"
LEFT, GAP, BOTTOM, TOP, TITLE = 0.68, 0.42, 0.5, 0.75, 0.2  # margins of a figure and between its panels [inch]

FLOW_UNITS = (("m³/s", 1.0), ("m³/h", 3600.0), ("l/h", 3.6e6))
UNITS = (("m/s", 1.0), ("mm/s", 1e3), ("m/h", 3600.0), ("mm/h", 3.6e6))
AT_REST = 0.02  # of the mean speed over the widest level
ELEVATION = np.radians(18.0)  # of the eye above the horizon, for the vessel


def rz_figures(
    field: Field,
    wall: Polygon,
    obstacles: Mapping[str, Polygon],
    folder: Path,
    sections: Levels | None = None,
    name: str = "",
    left: Polygon | None = None,
) -> list[Path]:
    """Draw a field at the flow rate of the case into an existing folder; return the files.

    ``rz_field.png`` holds all panels, each of which is a file of its own besides; ``rz_flow.png`` the flow through
    every level.

    Parameters
    ----------
    wall : (r, z) of the outer wall from the top down [m]
    obstacles : closed polygons (r, z) [m] by name
    sections : to be named at the side
    name : of the case, for the title
    left : the left wall of a slab
    """
    title = field_title(name, field)
    figures = {"rz_field.png": overview(field, wall, obstacles, sections, title, left)}
    if field.bulk_flow:  # a bed at rest has no flow to compare with
        figures["rz_flow.png"] = _flow_figure(field, wall, obstacles, sections, title, left)
    names = [*_known_panels(field), *(["error"] if nodal_errors(field) is not None else [])]
    names += [name for name in _REQUESTED if name in field.extra]
    figures |= {f"rz_{one}.png": panel_figure(field, one, wall, obstacles, sections, left) for one in names}
    with own_style(STYLE):
        for file, figure in figures.items():
            figure.savefig(folder / file, dpi=DPI)
    return [folder / file for file in figures]


def field_title(name: str, field: Field) -> str:
    """Name of the case and flow rate of its process; empty without a name."""
    return f"{name}: {flow_text(field.bulk_flow * field.flow_scale)} of bulk" if name else ""


def flow_text(flow: float) -> str:
    """A flow rate [m³/s] in a unit in which it is at least 0.1, of m³/s, m³/h and l/h."""
    unit, factor = next(((unit, factor) for unit, factor in FLOW_UNITS if abs(flow) * factor >= 0.1), FLOW_UNITS[-1])
    return f"{flow * factor:.4g} {unit}"


def vessel_figure(
    stl_paths: Sequence[Path],
    position: Array,
    radius: Array,
    velocity: Array,
    path: Path,
    scale: float = 1.0,
    z_range: tuple[float, float] | None = None,
    cut: float = 0.0,
) -> None:
    """Draw the vessel cut open and the particles behind the cut, by vertical velocity and by radius.

    Parameters
    ----------
    stl_paths : surfaces, called vessel, obstacle_<name>, and plate or plate_<outlet>, which are drawn where the
        particles above them now end
    position, velocity : (n, 3) of the particles [m], [m/s]
    radius : (n,) [m]
    path : the PNG file to write
    scale : flow rate of the process over that of the simulation; velocities are multiplied by it
    z_range : outlet and inlet of the user's own vessel [m]; what is beyond belongs to the simulation alone
    cut : where it lies in y [m]
    """
    position = position - [0.0, cut, 0.0]
    behind = position[:, 1] > 0
    behind |= not behind.any()
    process = scale * velocity
    unit, factor = readable_unit(_robust(np.linalg.norm(process, axis=1), 98))
    w, size = process[behind, 2] * factor, 1e3 * radius[behind]
    colours = {f"vertical velocity [{unit}]": (w, "viridis", _downward(w, 98))}  # the feed falls much faster
    if np.ptp(size) > 0:
        colours["particle radius [mm]"] = (size, "cividis", (float(size.min()), float(size.max())))
    top = math.inf if z_range is None else z_range[1]
    images, extent = _rendered(stl_paths, cut, top, position[behind], radius[behind], list(colours.values()))
    with own_style(STYLE):
        _vessel_panels(images, extent, colours, z_range).savefig(path, dpi=DPI)


def readable_unit(speed: float) -> tuple[str, float]:
    """Unit in which a speed [m/s] is at least 1, and the factor to it: m/s, mm/s, m/h, or mm/h for all slower ones."""
    return next(((unit, factor) for unit, factor in UNITS if speed * factor >= 1), UNITS[-1])


def overview(
    field: Field,
    wall: Polygon,
    obstacles: Mapping[str, Polygon],
    sections: Levels | None = None,
    title: str = "",
    left: Polygon | None = None,
) -> Figure:
    """Panels side by side: packing where known, radial and vertical bulk velocity, streamlines.

    Parameters
    ----------
    wall : (r, z) of the outer wall from the top down [m]
    obstacles : closed polygons (r, z) [m] by name
    sections : to be named at the side of the first panel
    left : the left wall of a slab
    """
    names = _known_panels(field)
    with own_style(STYLE):
        tall, wide = _panel_size(np.asarray(wall), field)
        figure, axes = _sheet([wide] * len(names), tall, title)
        for axis, name in zip(axes, names, strict=True):
            draw_panel(axis, field, name, wall, obstacles, axis is axes[0], left)
        _name_sections(axes[0], sections or {})
    return figure


def _known_panels(field: Field) -> list[str]:
    lines = ["streamlines"] if field.bulk_flow else []
    return [*(["packing"] if field.packing_fraction is not None else []), "u", "w", *lines]


def panel_figure(
    field: Field,
    what: str,
    wall: Polygon,
    obstacles: Mapping[str, Polygon],
    sections: Levels | None,
    left: Polygon | None = None,
) -> Figure:
    """One of `PANELS` as a picture of its own, which is readable on a phone; arguments as for `overview`.

    Raises
    ------
    DataError : the field does not have it
    """
    with own_style(STYLE):
        tall, wide = _panel_size(np.asarray(wall), field)
        figure, (axis,) = _sheet([wide], tall)
        draw_panel(axis, field, what, wall, obstacles, left=left)
        _name_sections(axis, sections or {})
    return figure


def _name_sections(axis: Axes, sections: Levels) -> None:
    """Names of the sections to the right of a panel, and where one ends and the next begins."""
    low, high = axis.get_ylim()
    right = axis.get_xlim()[1]
    inch = (high - low) * axis.figure.dpi / axis.bbox.height  # in m of the vessel
    for name, (top, bottom) in sections.items():
        across = len(name) > 2  # a word stands upright
        room = (top - bottom) / inch
        if room < (0.065 * len(name) if across else 0.1):
            continue
        axis.annotate(
            name,
            (right, 0.5 * (top + bottom)),
            (6, 0),
            textcoords="offset points",
            va="center",
            rotation=90 if across else 0,
            fontsize=8,
            color=INK,
            annotation_clip=False,
        )
    for z in {level for ends in sections.values() for level in ends}:
        axis.plot([right, right + 0.2 * inch], [z, z], color=STONE, linewidth=0.7, clip_on=False)
    axis.set(xlim=(axis.get_xlim()[0], right), ylim=(low, high))


def draw_panel(
    axis: Axes,
    field: Field,
    what: str,
    wall: Polygon,
    obstacles: Mapping[str, Polygon],
    labelled: bool = True,
    left: Polygon | None = None,
) -> None:
    """Draw one quantity at the flow rate of the case, and the vessel round it, into axes of one's own.

    Parameters
    ----------
    what : one of `PANELS`
    labelled : whether the heights are to be written
    left : the left wall of a slab

    Raises
    ------
    ValueError : `what` is none of `PANELS`
    DataError : the field does not have it
    """
    if what not in tuple(PANELS):
        raise ValueError(f"{what!r} cannot be drawn; choose one of {', '.join(PANELS)}")
    nodes, corners = nodal_values(field), np.asarray(wall, dtype=float)
    PANELS[what](axis, field, nodes, corners)
    _draw_surface(axis, field, nodes)
    _clip(axis, corners, _left(corners, nodes, left))
    _draw_vessel(axis, corners, obstacles, nodes, left)
    _lengths(axis, nodes.measure.letter, "z" if labelled else "")


def _flow_figure(
    field: Field,
    outline: Polygon,
    obstacles: Mapping[str, Polygon],
    sections: Levels | None,
    title: str,
    left: Polygon | None,
) -> Figure:
    """The vessel with its solids, and beside it the flow through every level, before and after adjustment."""
    nodes, wall = nodal_values(field), np.asarray(outline, dtype=float)
    tall, wide = _panel_size(wall, field)
    with own_style(STYLE):
        figure, (vessel, flows) = _sheet([wide, 3.4], tall, title)
        vessel.pcolormesh(nodes.r, nodes.z, np.where(nodes.cells, 1.0, np.nan), cmap="Greys", vmin=0, vmax=4)
        _draw_surface(vessel, field, nodes)
        _clip(vessel, wall, _left(wall, nodes, left))
        _draw_vessel(vessel, wall, obstacles, nodes, left)
        _lengths(vessel, nodes.measure.letter, "z")
        _draw_flows(flows, field)
        flows.set_ylim(vessel.get_ylim())
        _name_sections(vessel, sections or {})
    return figure


def _panel_size(wall: Array, field: Field) -> tuple[float, float]:
    """Height and width of a panel [inch]: the vessel's own aspect, at most 7 high and 3.5 wide."""
    width, height = float(wall[:, 0].max() - field.grid.r_edges[0]), float(np.ptp(wall[:, 1]))
    tall = min(7.0, 3.5 * height / width)
    return tall, max(1.3, tall * width / height)


def _sheet(widths: Sequence[float], tall: float, title: str = "") -> tuple[Figure, list[Axes]]:
    """A row of panels of the given sizes [inch] under a margin for their heads, and for a title."""
    from matplotlib.figure import Figure

    size = (LEFT + sum(widths) + GAP * len(widths), BOTTOM + tall + TOP + (TITLE if title else 0.0))
    figure = Figure(figsize=size)
    if title:
        figure.text(LEFT / size[0], 1 - 0.12 / size[1], title, fontsize=10, va="top")
    lefts = [LEFT + sum(widths[:k]) + GAP * k for k in range(len(widths))]
    places = [(x / size[0], BOTTOM / size[1], w / size[0], tall / size[1]) for x, w in zip(lefts, widths, strict=True)]
    return figure, [figure.add_axes(place) for place in places]


def _left(wall: Array, nodes: Nodes, left: Polygon | None) -> Array:
    """(n, 2) left wall, or the left edge of the grid beside the wall."""
    if left is not None:
        return np.asarray(left, dtype=float)
    return np.stack([np.full(2, nodes.r[0]), wall[[0, -1], 1]], axis=1)


def _draw_vessel(
    axis: Axes, wall: Array, obstacles: Mapping[str, Polygon], nodes: Nodes, left_wall: Polygon | None
) -> None:
    """The walls, the obstacles, the axis where there is one; equal scales and little else."""
    left, r_max = float(nodes.r[0]), float(wall[:, 0].max())
    low, high = float(wall[:, 1].min()), float(wall[:, 1].max())
    for corners in obstacles.values():
        axis.fill(*np.transpose(corners), facecolor=STONE, edgecolor=INK, linewidth=0.8, zorder=3)
    axis.plot(*wall.T, color=INK, linewidth=1.4, solid_capstyle="round", clip_on=False, zorder=4)
    if left_wall is not None:
        axis.plot(*np.transpose(left_wall), color=INK, linewidth=1.4, solid_capstyle="round", clip_on=False, zorder=4)
    if nodes.measure.axial:
        axis.plot([0, 0], [low, high], color=INK, linewidth=0.6, linestyle=(0, (8, 3, 1, 3)), clip_on=False, zorder=4)
    axis.set(aspect="equal", xlim=(left, r_max), ylim=(low, high))


def _lengths(axis: Axes, across: str, up: str) -> None:
    """Bare axes with few ticks, in m, or in mm where the panel shows less than a metre; no `up`, no labels there."""
    low, high = axis.get_ylim()
    unit = "m" if high - low >= 1 else "mm"
    for ticks in (axis.xaxis, axis.yaxis):  # with a true minus sign
        ticks.set_major_formatter(
            lambda value, _: f"{value if unit == 'm' else 1e3 * value:.4g}".replace("-", "\u2212")
        )
    axis.spines[:].set_visible(False)
    axis.tick_params(length=3, color=INK, labelleft=bool(up))
    inches = axis.bbox.height / axis.figure.dpi
    axis.locator_params(axis="x", nbins=4)
    axis.locator_params(axis="y", nbins=max(3, round(2 * inches)))
    axis.set_xlabel(f"{across} [{unit}]")
    axis.set_ylabel(f"{up} [{unit}]" if up else "")


def _draw_surface(axis: Axes, field: Field, nodes: Nodes) -> None:
    """A thin line between solids and voids: the free surface, and round cavities."""
    filled = nodes.cells | (field.inside_fraction == 0)
    if not filled.all():
        axis.contour(
            field.grid.r_centres,
            field.grid.z_centres,
            filled.astype(float),
            levels=[0.5],
            colors=[STONE],
            linewidths=0.6,
        )


def _draw_packing(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    if field.packing_fraction is None:
        raise DataError("this field has no packing: a fluid knows reference_packing alone")
    values = np.where(nodes.cells, field.packing_fraction, np.nan)
    image = axis.pcolormesh(nodes.r, nodes.z, values, cmap="cividis", vmin=0, vmax=packing_range(field, nodes.cells))
    _bar(axis, image, "packing fraction", "max")


def packing_range(field: Field, cells: Mask) -> float:
    """Upper end of the colours of the packing: all but 2 % of the volume is below it.

    By volume, for the cells on the axis hold few particles and their packing scatters up to 1.
    """
    assert field.packing_fraction is not None
    volume = np.broadcast_to(field.grid.cell_volume, cells.shape)[cells]
    packing = field.packing_fraction[cells]
    order = np.argsort(packing)
    below = np.cumsum(volume[order])
    return max(0.65, float(packing[order][np.searchsorted(below, 0.98 * below[-1])])) if packing.size else 0.65


def _draw_radial(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    unit, factor = _unit(nodes)
    top = _robust(np.abs(nodes.bulk_u[nodes.solids])) * factor or 1.0
    image = _smooth(axis, nodes, nodes.bulk_u * factor, cmap="RdBu_r", vmin=-top, vmax=top)
    _bar(axis, image, f"{'radial' if nodes.measure.axial else 'horizontal'} velocity [{unit}]", "both")


def _draw_vertical(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    unit, factor = _unit(nodes)
    low, high = _downward(nodes.bulk_w[nodes.solids] * factor)
    image = _smooth(axis, nodes, nodes.bulk_w * factor, cmap="viridis", vmin=low, vmax=high)
    _bar(axis, image, f"vertical velocity [{unit}]", "min")


def _draw_speed(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    unit, factor = _unit(nodes)
    speed = np.hypot(nodes.bulk_u, nodes.bulk_w) * factor
    image = _smooth(axis, nodes, speed, cmap="viridis_r", vmin=0, vmax=_robust(speed[nodes.solids]) or 1.0)
    _bar(axis, image, f"speed [{unit}]", "max")


def _draw_error(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    """Standard error of the bulk velocity, √(σ_u² + σ_w²)."""
    spread = nodal_errors(field)
    if spread is None:
        raise DataError(
            "this field does not have standard errors throughout: "
            "it is a fluid's or a hybrid's, or too few segments were averaged"
        )
    error = np.hypot(spread.bulk_u, spread.bulk_w)
    unit, factor = readable_unit(_robust(error[nodes.solids]))
    top = _robust(error[nodes.solids]) * factor or 1.0
    image = _smooth(axis, nodes, error * factor, cmap="magma_r", vmin=0, vmax=top)
    _bar(axis, image, f"standard error [{unit}]", "max")


def _draw_streamlines(axis: Axes, field: Field, nodes: Nodes, wall: Array) -> None:
    """Contours of the flow between axis and node, which is −2πψ where the field balances; none crosses a void."""
    from matplotlib.tri import Triangulation

    within = np.zeros(nodes.solids.shape)
    within[:, 1:] = -np.cumsum(field.flux_z * field.grid.ring_area, axis=1) / (field.bulk_flow * field.bulk_packing)
    plug = field.bulk_flow * field.flow_scale / (field.inside_fraction @ field.grid.ring_area).max()
    speed = np.hypot(nodes.bulk_u, nodes.bulk_w) / plug
    r, z = np.meshgrid(nodes.r, nodes.z)
    mesh = Triangulation(r.ravel(), z.ravel(), triangles(nodes))
    axis.tricontourf(mesh, speed.ravel(), levels=[0, AT_REST], colors=[REST])
    axis.tricontour(mesh, within.ravel(), levels=np.arange(0.05, 1, 0.1), colors=[BLUE], linewidths=0.8)
    _key(axis)


def _draw_quantity(
    name: str,
    colours: str,
    scaled: Callable[[Array], tuple[Array, str]],
    axis: Axes,
    field: Field,
    nodes: Nodes,
    wall: Array,
) -> None:
    """What stands in the cells on request; white where it is not known."""
    if name not in field.extra:
        remedy = (
            "a frictional fluid has one" if name == "sensitivity" else "ask for it in homogenize.fields, and run again"
        )
        raise DataError(f"this field has no {name}; {remedy}")
    values = np.where(nodes.cells, at_process_scale(field, name), np.nan)
    values, title = scaled(values)
    known = values[np.isfinite(values)]
    low = float(np.percentile(known, 0.5)) if known.size and name in ("coordination", "age") else 0.0
    top = 1.0 if name == "mixing_index" else max(_robust(known), low) or 1.0
    image = axis.pcolormesh(nodes.r, nodes.z, values, cmap=colours, vmin=low, vmax=top)
    _bar(axis, image, title, "both" if low else "max")


def _in_unit(
    title: str, units: Sequence[tuple[str, float]], root: bool = False
) -> Callable[[Array], tuple[Array, str]]:
    """Values in the first of units (with factors from SI) in which nearly the largest one is at least 1."""

    def scaled(values: Array) -> tuple[Array, str]:
        values = np.sqrt(values) if root else values
        top = _robust(np.abs(values[np.isfinite(values)]))
        unit, factor = next(((unit, factor) for unit, factor in units if top * factor >= 1), units[-1])
        return values * factor, f"{title} [{unit}]" if unit else title

    return scaled


_REQUESTED: dict[str, tuple[str, Callable[[Array], tuple[Array, str]]]] = {
    "pressure": ("cividis", _in_unit("pressure", (("MPa", 1e-6), ("kPa", 1e-3), ("Pa", 1.0)))),
    "shear_rate": ("magma_r", _in_unit("shear rate", (("1/s", 1.0), ("1/min", 60.0), ("1/h", 3600.0)))),
    "granular_temperature": ("inferno", _in_unit("√ granular temperature", UNITS, root=True)),
    "coordination": ("viridis", _in_unit("contacts per particle", (("", 1.0),))),
    "mixing_index": ("cividis", _in_unit("mixing index", (("", 1.0),))),
    "age": ("viridis_r", _in_unit("age", (("d", 1 / 86400), ("h", 1 / 3600), ("min", 1 / 60), ("s", 1.0)))),
    "sensitivity": ("magma_r", _in_unit("sensitivity", UNITS)),
}
"""What of `Field.extra` is drawn: colours, and how values are told."""


PANELS: Mapping[str, Callable[[Axes, Field, Nodes, Array], None]] = {
    "packing": _draw_packing,
    "u": _draw_radial,
    "w": _draw_vertical,
    "speed": _draw_speed,
    "streamlines": _draw_streamlines,
    "error": _draw_error,
} | {name: partial(_draw_quantity, name, *how) for name, how in _REQUESTED.items()}
"""What can be drawn on r–z."""


def _draw_flows(axis: Axes, field: Field) -> None:
    """Flow of solids through every level as a part of the flow that the plug above the plate carries."""
    reference, flow_rate = field.bulk_flow * field.bulk_packing, field.bulk_flow * field.flow_scale
    z, grid = field.grid.z_edges, field.grid
    shares = [100 * level_flow(field.flux_z, grid) / reference]
    if field.raw_flux_z is not None:
        shares.append(100 * level_flow(field.raw_flux_z, grid) / reference)
        axis.plot(shares[1], z, color=RED, lw=1, linestyle="--", label="plain average")
    axis.plot(shares[0], z, color=BLUE, lw=1.6, label="final field")
    axis.axvline(100, color=INK, linewidth=0.8, linestyle=":", label=f"reference, {flow_text(flow_rate)} of bulk")
    limits = flow_range(np.concatenate(shares))
    if limits[0] < 95 or limits[1] > 105:
        axis.axvspan(95, 105, color="#eeeeee", zorder=0, label="± 5 %")
    axis.set_xlim(limits)
    axis.set_xlabel("flow of solids through level [% of reference]")
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(labelleft=False)
    axis.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, frameon=False, fontsize=8)


def flow_range(shares: Array) -> tuple[float, float]:
    """Ends of the scale for flows through levels [%]: those of the data and 100, with a margin, at least ± 0.5."""
    low, high = min(99.5, float(np.min(shares))), max(100.5, float(np.max(shares)))
    margin = 0.08 * (high - low)
    return low - margin, high + margin


def _unit(nodes: Nodes) -> tuple[str, float]:
    return readable_unit(_robust(np.hypot(nodes.bulk_u, nodes.bulk_w)[nodes.solids]))


def _robust(values: Array, percent: float = 99.5) -> float:
    """Nearly the largest value, so that a few outliers do not take the colours."""
    return float(np.percentile(values, percent)) if values.size else 0.0


def _downward(w: Array, percent: float = 99.5) -> tuple[float, float]:
    """Range of colours for vertical velocities: from nearly the fastest to rest, or to nearly the fastest rise."""
    return -_robust(-w, percent) or -1.0, max(0.0, _robust(w, percent))


def _smooth(axis: Axes, nodes: Nodes, values: Array, **colours: Any) -> Any:
    """Colours interpolated over the triangles of the solids; voids stay white."""
    r, z = np.meshgrid(nodes.r, nodes.z)
    return axis.tripcolor(
        r.ravel(), z.ravel(), values.ravel(), triangles=triangles(nodes), shading="gouraud", **colours
    )


def _clip(axis: Axes, wall: Array, left: Array) -> None:
    """Cut everything drawn so far to the inside of the walls."""
    from matplotlib.patches import Polygon as Patch

    closed = np.vstack([left[:1], wall, left[:0:-1]])
    for artist in axis.collections:
        artist.set_clip_path(Patch(closed, transform=axis.transData))


def _bar(axis: Axes, image: Any, title: str, extend: str) -> None:
    """A horizontal colour bar over its panel."""
    inch = axis.figure.dpi / axis.bbox.height
    bar = axis.inset_axes((0.04, 1 + 0.18 * inch, 0.92, 0.09 * inch))
    axis.figure.colorbar(image, cax=bar, orientation="horizontal", extend=extend)
    bar.set_title(title, fontsize=8.5, pad=4)
    bar.tick_params(labelsize=7.5, length=2, pad=1.5)
    bar.locator_params(axis="x", nbins=4)


def _key(axis: Axes) -> None:
    """What lines and shade of the streamlines mean, over their panel."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks = [
        Line2D([], [], color=BLUE, linewidth=0.8, label="each 10 % of the flow"),
        Patch(facecolor=REST, label="at rest"),
    ]
    axis.legend(handles=marks, loc="lower left", bbox_to_anchor=(-0.05, 1.0), frameon=False, fontsize=7.5)


def _rendered(
    stl_paths: Sequence[Path],
    cut: float,
    top: float,
    position: Array,
    radius: Array,
    colours: Sequence[tuple[Array, str, tuple[float, float]]],
) -> tuple[list[Any], tuple[float, float, float, float]]:
    """One image of the open vessel per colouring, by parallel projection; and its extent in the plane of the cut.

    What is above the vessel's top [m] and the particles, empty room that a packed bed has left, is cut away.

    The extent is (x, x, z, z) [m] of points with y = 0: the elevated eye sees their z shortened by its cosine.
    """
    import pyvista

    ball = pyvista.Sphere(radius=1.0, theta_resolution=12, phi_resolution=8)
    cloud = pyvista.PolyData(position)
    cloud["radius"] = radius
    cloud["number"] = np.arange(len(radius))
    balls = cloud.glyph(scale="radius", orient=False, geom=ball)
    floor = float((position[:, 2] - radius).min())
    surfaces = {path.stem: _surface(path, cut, position, radius) for path in stl_paths}
    highest = max(top, float((position[:, 2] + 2 * radius).max()))
    if math.isfinite(top):
        surfaces = {name: one.clip(normal=(0, 0, 1), origin=(0, 0, highest)) for name, one in surfaces.items()}
    extent = _extent([surface.bounds for surface in surfaces.values()], floor)
    with _quiet_vtk():
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=_pixels(extent))
        plotter.render_window.SetMultiSamples(0)  # they cost seconds without a graphics card; the image is scaled down
        plotter.set_background("white")
        for name, surface in surfaces.items():
            _add_open(plotter, name, surface)
        _look(plotter, extent)
        images = []
        for values, colormap, limits in colours:
            balls["colour"] = values[balls["number"]]
            plotter.add_mesh(
                balls,
                scalars="colour",
                cmap=colormap,
                clim=limits,
                smooth_shading=True,
                show_scalar_bar=False,
                name="balls",
            )
            plotter.render()
            images.append(plotter.screenshot(return_img=True))
        plotter.close()
    return images, extent


def _extent(surfaces: Sequence[Sequence[float]], floor: float) -> tuple[float, float, float, float]:
    """(x, x, z, z) that the half behind y = 0 of surfaces with these bounds fills in the view, with a margin [m].

    What is more than half a radius below the floor, the empty pipe under the plate, is left out.
    """
    bounds = np.array(surfaces)
    left, low = bounds[:, [0, 4]].min(axis=0)
    right, back, high = bounds[:, [1, 3, 5]].max(axis=0)
    half = 0.5 * float(right - left)
    margin = 0.03 * half
    low = max(low, floor - 0.5 * half)
    return left - margin, right + margin, low - margin, high + back * np.tan(ELEVATION) + margin


def _pixels(extent: tuple[float, float, float, float], long_side: int = 2200) -> list[int]:
    """Width and height of the image; even numbers."""
    wide, tall = extent[1] - extent[0], (extent[3] - extent[2]) * np.cos(ELEVATION)
    scale = long_side / max(wide, tall)
    return [2 * round(wide * scale / 2), 2 * round(tall * scale / 2)]


def _surface(path: Path, cut: float, position: Array, radius: Array) -> Any:
    """The surface in an STL file, its cut moved to y = 0; a plate, which has sunk since, below its particles."""
    import pyvista

    surface: Any = pyvista.PolyData(str(path)).clean(tolerance=1e-6)  # STL repeats its vertices
    surface = surface.translate((0, -cut, 0))
    if not path.stem.startswith("plate"):
        return surface
    x0, x1, y0, y1, z, _ = surface.bounds
    x, y, _ = position.T
    above = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    floor = float((position[:, 2] - radius)[above if above.any() else slice(None)].min())
    return surface.translate((0, 0, floor - z))


def _add_open(plotter: Any, name: str, surface: Any) -> None:
    """The part of a surface behind y = 0, the line where it is cut, and the cut face of an obstacle."""
    import pyvista

    steel = {"color": "#cfd4da", "ambient": 0.35, "specular": 0.2, "smooth_shading": True, "split_sharp_edges": True}
    plotter.add_mesh(surface.clip(normal=(0, -1, 0), origin=(0, 0, 0)), name=name, **steel)
    cut = surface.slice(normal=(0, 1, 0), origin=(0, 1e-6 * surface.length, 0))  # not exactly through vertices
    cut = cut.clean(tolerance=1e-3, lines_to_points=False)
    if not cut.n_points:
        return
    plotter.add_mesh(
        cut.translate((0, -1e-3 * surface.length, 0)), name=f"{name} cut", color=INK, line_width=5, lighting=False
    )
    if name.startswith("obstacle"):
        for number, line in enumerate(cut.strip(max_length=cut.n_points + 1).cell):
            # where an obstacle lies on the wall or the axis its surface is open: the chord closes the face
            face = pyvista.PolyData(line.points, faces=[line.n_points, *range(line.n_points)])
            plotter.add_mesh(face.triangulate(), name=f"{name} face {number}", color=STONE, lighting=False)


def _look(plotter: Any, extent: tuple[float, float, float, float]) -> None:
    """Parallel projection from the front and above, filling the image with the extent."""
    across, middle = 0.5 * (extent[0] + extent[1]), 0.5 * (extent[2] + extent[3])
    away = 10 * (extent[3] - extent[2] + 0.5 * (extent[1] - extent[0]))
    eye = (across, -away * np.cos(ELEVATION), middle + away * np.sin(ELEVATION))
    plotter.camera_position = [eye, (across, 0.0, middle), (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * (extent[3] - extent[2]) * np.cos(ELEVATION)
    plotter.reset_camera_clipping_range()


@contextmanager
def _quiet_vtk() -> Iterator[None]:
    """Without an X server VTK warns on stderr before it takes EGL; that is no news to the user."""
    from vtkmodules.vtkCommonCore import vtkLogger

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _vessel_panels(
    images: Sequence[Any],
    extent: tuple[float, float, float, float],
    colours: Mapping[str, tuple[Any, str, Any]],
    z_range: tuple[float, float] | None,
) -> Figure:
    """The images side by side, with the scale of the cut and a colour bar over each."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    shape = (extent[3] - extent[2]) * np.cos(ELEVATION) / (extent[1] - extent[0])
    tall = min(7.0, 3.5 * shape)
    figure, axes = _sheet([max(1.6, tall / shape)] * len(images), tall)
    for axis, image, (title, (values, colormap, limits)) in zip(axes, images, colours.items(), strict=True):
        axis.imshow(image, extent=extent, aspect=np.cos(ELEVATION), interpolation="hanning")
        beyond = "both" if values.min() < limits[0] or values.max() > limits[1] else "neither"
        _bar(axis, ScalarMappable(Normalize(*limits), colormap), title, beyond)
        _lengths(axis, "x", "z in the plane of the cut" if axis is axes[0] else "")
        if z_range is not None:
            _mark_range(axis, z_range, named=axis is axes[-1])
    return figure


def _mark_range(axis: Axes, z_range: tuple[float, float], named: bool) -> None:
    """Levels of outlet and inlet; at the side what is the user's vessel and what belongs to the simulation alone."""
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    for z in z_range:
        axis.plot([left, right], [z, z], color=RED, linewidth=0.9, linestyle=(0, (5, 3)))
    parts = {"vessel": z_range, "feeder": (z_range[1], high), "plate": (low, z_range[0])} if named else {}
    for name, (bottom, top) in parts.items():
        if top - bottom > 0.08 * (high - low):
            axis.annotate(
                name,
                (right, 0.5 * (bottom + top)),
                (4, 0),
                textcoords="offset points",
                rotation=90,
                va="center",
                fontsize=8,
                color=INK if name == "vessel" else RED,
                annotation_clip=False,
            )
    axis.set(xlim=(left, right), ylim=(low, high))
