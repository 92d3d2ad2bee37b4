"""An animation of the particles in the cut through the axis: layers of the bed as they flow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granpipe.export.pictures import BLUE, INK, RED, STONE, Polygon
from granpipe.field import Array, Particles
from granpipe.progress import duration_text
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LAYERS = 14
FED = "#e3e3e3"
COLOURS = (BLUE, "#e8a33d")  # told apart also by colour-blind readers, and on paper
FRAMES_PER_SECOND = 10
FONT = {"font.size": 9}


@dataclass(frozen=True)
class Frame:
    """All particles at one time of the simulation [s]."""

    time: float
    particles: Particles


def animation(
    frames: Sequence[Frame],
    wall: Polygon,
    obstacles: Mapping[str, Polygon],
    flow_scale: float,
    path: Path,
) -> None:
    """Draw the particles that the plane y = 0 cuts, coloured by the layer in which they began, as an animated GIF.

    Parameters
    ----------
    frames : in the order of time
    wall : (r, z) of the outer wall from the top down [m]
    obstacles : closed polygons (r, z) [m] by name
    flow_scale : flow rate of the process over that of the simulation: the time of the process is that much longer
    path : the GIF file to write
    """
    from matplotlib.animation import PillowWriter
    from matplotlib.figure import Figure

    layers, wide = layers_of(frames[0].particles), float(np.max(np.asarray(wall)[:, 0]))
    low = min(float((one.particles.position[:, 2] - one.particles.radius).min()) for one in frames)
    high = max(float(np.asarray(wall)[0, 1]), float(frames[0].particles.position[:, 2].max()))
    with own_style(FONT):
        tall = min(7.0, 3.0 * (high - low) / wide)
        figure = Figure(figsize=(max(2.6, tall * 2 * wide / (high - low) + 0.9), tall + 0.9), layout="constrained")
        axes = figure.add_subplot()
        writer = PillowWriter(fps=FRAMES_PER_SECOND)
        with writer.saving(figure, str(path), dpi=80):
            for frame in frames:
                axes.clear()
                _draw(axes, frame.particles, layers, wide)
                _vessel(axes, np.asarray(wall), obstacles, (low, high))
                axes.set_title(clock(frame.time - frames[0].time, flow_scale), fontsize=9, loc="left")
                writer.grab_frame()


def clock(seconds: float, flow_scale: float) -> str:
    """The time as it is told over a frame, of the process and of the simulation."""
    return f"process {duration_text(seconds / flow_scale)}\nsimulation {seconds:.1f} s"


def layers_of(particles: Particles) -> dict[int, int]:
    """Number of a particle → the layer of equal height in which it is, counted from below."""
    z = particles.position[:, 2]
    height = max(float(np.ptp(z)), 1e-12) * (1 + 1e-9)
    layers = np.floor(LAYERS * (z - z.min()) / height).astype(int)
    return dict(zip(particles.id.tolist(), layers.tolist(), strict=True))


def cut_circles(particles: Particles) -> tuple[Array, Array, NDArray[np.int64]]:
    """Circles in which y = 0 cuts particles: centres (n, 2) in x, z and radii (n,) [m]; numbers of particles (n,)."""
    y, radius = particles.position[:, 1], particles.radius
    cut = np.abs(y) < radius
    return particles.position[cut][:, [0, 2]], np.sqrt(radius[cut] ** 2 - y[cut] ** 2), particles.id[cut]


def _draw(axes: Axes, particles: Particles, layers: Mapping[int, int], wide: float) -> None:
    from matplotlib.collections import EllipseCollection

    centres, radii, numbers = cut_circles(particles)
    colours: list[Any] = [
        FED if (layer := layers.get(number)) is None else COLOURS[layer % 2] for number in numbers.tolist()
    ]
    axes.add_collection(
        EllipseCollection(
            2 * radii,
            2 * radii,
            np.zeros(len(radii)),
            offsets=centres,
            units="xy",
            facecolors=colours,
            edgecolors="white",
            linewidths=0.2,
            transOffset=axes.transData,
        )
    )
    axes.set_xlim(-1.03 * wide, 1.03 * wide)


def _vessel(axes: Axes, wall: Array, obstacles: Mapping[str, Polygon], ends: tuple[float, float]) -> None:
    r, z = wall.T
    line = np.column_stack([[r[0], *r, r[-1]], [max(ends[1], z[0]), *z, min(ends[0], z[-1])]])
    for side in (-1, 1):
        axes.plot(side * line[:, 0], line[:, 1], color=INK, linewidth=1.2)
        for corners in obstacles.values():
            points = np.asarray(corners)
            axes.fill(side * points[:, 0], points[:, 1], facecolor=STONE, edgecolor=INK, linewidth=0.8)
    for level in (z[0], z[-1]):
        axes.plot([-r.max(), r.max()], [level, level], color=RED, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.set(aspect="equal", ylim=ends, xlabel="x [m]", ylabel="z [m]")
    axes.spines[:].set_visible(False)
