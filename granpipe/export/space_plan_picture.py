"""What a plan in space will do, seen from the front and from the side: walls, outlets, what lies beyond, plates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.export.pictures import BLUE, DPI, INK, RED, REST, STONE, STYLE
from granpipe.field import Array
from granpipe.system.surroundings import own_style

_FACES = 0.15  # opacity of one triangle


@dataclass(frozen=True)
class PlannedOutlet:
    """One outlet; lengths in m.

    Parameters
    ----------
    name, share : of the flow
    opening : (n, 3) corners
    tube : (m, 3) corners of the upper edge of the tube below it
    plate : levels of its plate at the start and at the end
    """

    name: str
    share: float
    opening: Array
    tube: Array
    plate: tuple[float, float]


@dataclass(frozen=True)
class PlannedInSpace:
    """What is drawn.

    Parameters
    ----------
    walls : (n, 3, 3) triangles as the file has them [m]
    simulated : (m, 3, 3) with reservoir, hoods and tubes [m]
    inlet : (k, 3) corners [m]
    outlets : in the order of the case
    """

    walls: Array
    simulated: Array
    inlet: Array
    outlets: Sequence[PlannedOutlet]


def space_plan_picture(planned: PlannedInSpace, title: str, path: Path) -> None:
    """Draw a plan into a PNG file: along x and along y, as if the walls were of tinted glass."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    with own_style(STYLE):
        figure = Figure(figsize=(11.0, 7.5), layout="constrained")
        figure.suptitle(title, fontsize=10)
        for number, across in enumerate("xy"):
            axes, seen = figure.add_subplot(1, 2, number + 1), [number, 2]
            axes.add_collection(
                PolyCollection(list(planned.simulated[..., seen]), facecolor=REST, alpha=_FACES, linewidth=0)
            )
            axes.add_collection(
                PolyCollection(list(planned.walls[..., seen]), facecolor="none", edgecolor=STONE, linewidth=0.2)
            )
            for corners, colour in ((planned.inlet, INK), *((one.opening, RED) for one in planned.outlets)):
                axes.plot(*np.vstack([corners, corners[:1]])[:, seen].T, color=colour, linewidth=2.0)
            for one in planned.outlets:
                ends = one.tube[:, number].min(), one.tube[:, number].max()
                for level, style in zip(one.plate, ("-", ":"), strict=True):
                    axes.plot(ends, [level, level], color=BLUE, linewidth=1.5, linestyle=style)
                x, _, z = one.opening.mean(axis=0)[[number, number, 2]]
                axes.annotate(
                    f"{one.name} {one.share:.0%}", (x, z), (4, 6), textcoords="offset points", fontsize=8, color=RED
                )
            axes.set(xlabel=f"{across} [m]", ylabel="z [m]", aspect="equal")
            axes.autoscale_view()
        told = (
            "red: outlets; black: inlet; tinted: what particles fill in the simulation; blue: plates, dotted at the end"
        )
        figure.supxlabel(told, fontsize=7, color=INK)
        figure.savefig(path, dpi=DPI)
