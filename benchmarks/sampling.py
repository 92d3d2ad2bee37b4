"""Flow sampled by the velocities in snapshots against flow sampled by displacement between them: same run, same files;
and the error that segments of different lengths tell.

For a run that kept its snapshots (`granpipe run CASE --set dem.keep_snapshots=all`); prints two tables.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Literal

import numpy as np

from granpipe.case.reader import load_case
from granpipe.dem.dump import first_step, read_snapshot
from granpipe.field import Array, Field, Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.homogenize.conserve import measure_plug
from granpipe.homogenize.psi_field import psi_field

SAMPLINGS: tuple[Literal["velocity", "displacement"], ...] = ("velocity", "displacement")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("snapshots", type=Path, help="folder of the binary snapshots")
    parser.add_argument("--case", type=Path, required=True)
    parser.add_argument("--time-step", type=float, required=True, help="[s]")
    parser.add_argument("--cell", type=float, required=True, help="[m]")
    parser.add_argument("--start", type=float, default=0.0, help="average from this time on [s]")
    parser.add_argument("--segment", type=int, default=5, help="snapshots per segment")
    options = parser.parse_args()
    outline = Outline.from_case(load_case(options.case))
    grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, options.cell)
    print("| | " + " | ".join(SAMPLINGS) + " |\n|---|---|---|")
    columns = []
    for sampling in SAMPLINGS:
        parts = segments(options.snapshots, options.time_step, grid, sampling, options.segment)
        columns.append(compare([part for part in parts if part.start >= options.start], outline, grid))
    for name in columns[0]:
        print(f"| {name} | " + " | ".join(f"{100 * column[name]:.1f} %" for column in columns) + " |")
    print("\n| pairs in a segment | blocks | worth | standard error of the fitted field | as if independent |")
    print("|---|---|---|---|---|")
    single = segments(options.snapshots, options.time_step, grid, "displacement", 1)
    single = [part for part in single if part.start >= options.start]
    for length in (1, 2, 3, 5):
        first = len(single) % length
        print(error_row([merge(single[at : at + length]) for at in range(first, len(single), length)], outline, grid))


def error_row(parts: list[Sums], outline: Outline, grid: Grid) -> str:
    inside, diameter = outline.inside_fraction(grid), 4 * grid.cell
    plug = measure_plug(merge(parts), inside, plug_range(outline, grid), diameter)
    fitted = psi_field(parts, inside, plug, diameter)
    error = error_share(fitted.field.flux_z_se, fitted.field.flux_z, fitted.field)
    naive = error * np.sqrt((fitted.effective_blocks - 1) / (fitted.blocks - 1))
    pairs = round(len(merge(parts).time) / len(parts))
    return f"| {pairs} | {fitted.blocks} | {fitted.effective_blocks:.0f} | {100 * error:.1f} % | {100 * naive:.1f} % |"


def plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    return outline.z_bottom, outline.z_bottom + max(0.5 * outline.outlet_radius, 2 * grid.cell)


def segments(
    folder: Path, time_step: float, grid: Grid, sampling: Literal["velocity", "displacement"], length: int
) -> list[Sums]:
    """Sums over every so many snapshots of a folder."""
    collector, parts = Collector(grid, sampling), []
    for number, path in enumerate(sorted(folder.glob("*.bin"), key=first_step)):
        collector.add(first_step(path) * time_step, read_snapshot(path))
        if number and number % length == 0:
            parts.append(collector.take())
    return parts


def compare(parts: list[Sums], outline: Outline, grid: Grid) -> dict[str, float]:
    inside = outline.inside_fraction(grid)
    diameter = 4 * grid.cell
    sums = merge(parts)
    plug = measure_plug(sums, inside, plug_range(outline, grid), diameter)
    flow = level_flow(sums.mean_flux[1], grid) / plug.solids_flow
    gathered = np.concatenate([[0.0], np.cumsum(sums.storage.sum(axis=1))]) / plug.solids_flow
    field = psi_field(parts, inside, plug, diameter).field
    return {
        "worst level, plain average, against the plug": float(np.abs(flow - 1).max()),
        "the same, less what the filling gained": float(np.abs(flow - 1 - gathered).max()),
        "standard error of the plain average": error_share(field.raw_flux_z_se, field.raw_flux_z, field),
        "standard error of the fitted field": error_share(field.flux_z_se, field.flux_z, field),
    }


def error_share(error: Array | None, flux: Array | None, field: Field) -> float:
    """√(Σ A δ² / Σ A F²)."""
    assert error is not None
    assert flux is not None
    area = field.grid.ring_area
    return float(np.sqrt((area * error**2).sum() / (area * flux**2).sum()))


if __name__ == "__main__":
    main()
