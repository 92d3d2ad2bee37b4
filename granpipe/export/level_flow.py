"""Flow through every level of a run that gave no field: a picture and a table."""

from __future__ import annotations

import csv
from pathlib import Path

from granpipe.export.pictures import BLUE, DPI, INK, RED, STYLE
from granpipe.field import Array
from granpipe.system.surroundings import own_style


def level_flow_figure(z: Array, whole: Array, late: Array, title: str, path: Path) -> None:
    """Draw the flow through every level (n,) over that of the plate, for the whole run and for its last third."""
    from matplotlib.figure import Figure

    with own_style(STYLE):
        figure = Figure(figsize=(4.2, 4.2), layout="constrained")
        axes = figure.add_subplot()
        axes.axvline(1.0, color=INK, linewidth=0.6, linestyle=":", label="the plate")
        axes.plot(whole, z, color=BLUE, label="whole run")
        axes.plot(late, z, color=RED, linestyle="--", label="last third")
        axes.set(xlabel="flow through the level / flow of the plate", ylabel="z [m]", title=title)
        axes.legend(frameon=False)
        figure.savefig(path, dpi=DPI)


def level_flow_table(z: Array, whole: Array, late: Array, path: Path) -> None:
    """The same as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("z_m", "flow_over_plate_whole_run", "flow_over_plate_last_third"))
        rows.writerows([[f"{value:.6g}" for value in row] for row in zip(z, whole, late, strict=True)])
