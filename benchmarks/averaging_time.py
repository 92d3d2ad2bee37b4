"""Simulated time that each method needs for the same error, on a run of the test reactor against another run of it.

The run kept its snapshots (`--set dem.keep_snapshots=all`); of the other, the segments are read. Writes
docs/validation/averaging_time.md and its chart.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from sampling import segments

from granpipe.case.reader import load_case
from granpipe.errors import DataError
from granpipe.field import Array, Grid, Mask
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import gaussian_field, raw_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, measure_plug, scale_rows
from granpipe.homogenize.psi_field import psi_field

HERE = Path(__file__).resolve().parent
METHODS = ("raw", "rows scaled", "gaussian, 1 pass", "gaussian, 2 passes", "psi")
PASSES = (0, 1, 2)
PAIRS = (7, 14, 21, 28, 42)  # of snapshots in a window, beside the whole run
PLUG_DIAMETERS = 0.25  # height of the plug, in outlet diameters

Flux = tuple[Array, Array]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("snapshots", type=Path, help="folder of the binary snapshots")
    parser.add_argument("reference", type=Path, help="folder of the other run's segments")
    parser.add_argument("--case", type=Path, required=True)
    parser.add_argument("--time-step", type=float, required=True, help="[s]")
    parser.add_argument("--diameter", type=float, required=True, help="Sauter diameter [m]")
    parser.add_argument("--start", type=float, default=0.0, help="average the run from this time on [s]")
    parser.add_argument("--reference-start", type=float, default=0.0, help="and the other from this [s]")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation")
    options = parser.parse_args()
    outline = Outline.from_case(load_case(options.case))
    other = [Sums.load(path) for path in sorted(options.reference.glob("segment-*/sums.npz"))]
    other = [part for part in other if part.start >= options.reference_start]
    judge = Judge.of(other, outline, options.diameter)
    parts = segments(options.snapshots, options.time_step, judge.grid, "displacement", 1)
    parts = [part for part in parts if part.start >= options.start]
    rows = [judge.row(parts, pairs) for pairs in (*PAIRS, len(parts))]
    chart(rows, judge, options.out / "images" / "averaging_time.png")
    text = page(rows, judge, other, parts)
    (options.out / "averaging_time.md").write_text(text)
    print(text)


@dataclass(frozen=True)
class Row:
    """Errors of averages of one length: (methods, zones) [%], over those windows of so many that ψ accepts."""

    time: float
    windows: int
    accepted: int
    errors: Array


@dataclass(frozen=True)
class Judge:
    """Knows the other run: the flux of its first and second half, each over its own plug's flow.

    E² = Σ A (F − F₁)·(F − F₂) / Σ A F₁·F₂ over the bulk. The halves' noise is independent, so that it adds nothing to
    the mean of the product; it makes E² uncertain, though, and where the error is small even negative.
    """

    outline: Outline
    inside: Array
    grid: Grid
    diameter: float
    packing: float
    bulk: Mask
    halves: tuple[Flux, Flux]

    @classmethod
    def of(cls, parts: Sequence[Sums], outline: Outline, diameter: float) -> Judge:
        grid, middle = parts[0].grid, len(parts) // 2
        inside, whole = outline.inside_fraction(parts[0].grid), merge(parts)
        plug = measure_plug(whole, inside, plug_range(outline, grid), diameter)
        bulk = raw_field(whole, inside, plug, diameter).bulk
        halves = [merge(half) for half in (parts[:middle], parts[middle:])]
        flows = [measure_plug(half, inside, plug.z_range, diameter).solids_flow for half in halves]
        fluxes = [
            per_flow(scale_rows(*half.mean_flux, grid, flow), flow) for half, flow in zip(halves, flows, strict=True)
        ]
        return cls(outline, inside, grid, diameter, plug.packing, bulk, (fluxes[0], fluxes[1]))

    @property
    def zones(self) -> dict[str, Mask]:
        z = self.grid.z_centres
        sections = self.outline.sections.items()
        return {"whole": z > -np.inf, **{name: (z < s.z_top) & (z > s.z_bottom) for name, s in sections}}

    def row(self, parts: list[Sums], pairs: int) -> Row:
        """Errors of all windows of so many pairs that fit in without overlap."""
        windows = [parts[at : at + pairs] for at in range(0, len(parts) - pairs + 1, pairs)]
        squares = [square for window in windows if (square := self.squares(window)) is not None]
        mean = np.mean(squares, axis=0)
        return Row(merge(windows[0]).duration, len(windows), len(squares), 100 * np.sqrt(np.maximum(mean, 0)))

    def squares(self, window: list[Sums]) -> Array | None:
        """(methods, zones) E² of the average of a window; None where ψ refuses it."""
        sums = merge(window)
        plug = measure_plug(sums, self.inside, plug_range(self.outline, self.grid), self.diameter, self.packing)
        try:
            fluxes = self.fluxes(window, sums, plug)
        except DataError:
            return None
        return np.array([self.apart(per_flow(flux, plug.solids_flow)) for flux in fluxes])

    def fluxes(self, window: list[Sums], sums: Sums, plug: Plug) -> list[Flux]:
        fields = [gaussian_field(sums, self.inside, plug, self.diameter, passes) for passes in PASSES]
        fields.append(psi_field(window, self.inside, plug, self.diameter).field)
        return [sums.mean_flux, *((field.flux_r, field.flux_z) for field in fields)]

    def apart(self, flux: Flux) -> list[float]:
        (one, other), weight = self.halves, np.where(self.bulk, self.grid.ring_area, 0.0)
        away = [(flux[0] - half[0], flux[1] - half[1]) for half in (one, other)]
        error, square = weight * on_cells(*away), weight * on_cells(one, other)
        return [float(error[rows].sum() / square[rows].sum()) for rows in self.zones.values()]


def plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    return outline.z_bottom, outline.z_bottom + max(2 * PLUG_DIAMETERS * outline.outlet_radius, 2 * grid.cell)


def per_flow(flux: Flux, flow: float) -> Flux:
    return flux[0] / flow, flux[1] / flow


def on_cells(one: Flux, other: Flux) -> Array:
    """(nz, nr) product of two fields, each component's the mean of its two faces'."""
    r, z = one[0] * other[0], one[1] * other[1]
    return np.asarray(0.5 * (r[:, 1:] + r[:, :-1] + z[1:] + z[:-1]))


def time_for(rows: Sequence[Row], method: int, error: float) -> str:
    """When a method's error on the whole first falls below a value [s], by interpolation in logarithms."""
    times, errors = np.log([row.time for row in rows]), np.log([row.errors[method, 0] for row in rows])
    below = errors <= np.log(error)
    if not below.any():
        return "—"
    at = int(below.argmax())
    if at == 0:
        return f"< {rows[0].time:.1f}"
    part = (np.log(error) - errors[at - 1]) / (errors[at] - errors[at - 1])
    return f"{np.exp(times[at - 1] + part * (times[at] - times[at - 1])):.1f}"


def chart(rows: Sequence[Row], judge: Judge, path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    zones = list(judge.zones)
    figure, axes = plt.subplots(1, len(zones), figsize=(16, 3.6), sharey=True, layout="constrained")
    times = [row.time for row in rows]
    for axis, zone, errors in zip(axes, zones, np.moveaxis([row.errors for row in rows], 2, 0), strict=True):
        for method, line in zip(METHODS, errors.T, strict=True):
            axis.loglog(times, line, marker="o", markersize=3, lw=2.2 if method == "psi" else 1, label=method)
        axis.set(title=zone if zone == "whole" else f"section {zone}", xlabel="averaged [s]", ylim=(1, 40))
        axis.set_xticks((5, 10, 20, 50), ("5", "10", "20", "50"))
        axis.minorticks_off()
    axes[0].set_ylabel("error [%]")
    axes[-1].legend(fontsize=7)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=90)


def page(rows: Sequence[Row], judge: Judge, other: Sequence[Sums], parts: Sequence[Sums]) -> str:
    lines = [
        "# Error of the reactor's field against the time averaged",
        "",
        f"Made by `benchmarks/averaging_time.py` on {datetime.now(UTC):%Y-%m-%d}. One run of `cases/reactor.yaml`,",
        f"from {parts[0].start:.1f} s to {parts[-1].stop:.1f} s, cut into windows; each method's field of each window",
        "against another run, of another filling,",
        f"{other[0].start:.1f} s to {other[-1].stop:.1f} s, both between walls as drawn. Its plain average is taken in",
        "two halves, rows scaled, F₁ and F₂, and E² = Σ A (F − F₁)·(F − F₂) / Σ A F₁·F₂,",
        "the mean over the windows: the halves' noise is independent and drops out of the mean of the product. Fluxes",
        "are per flow in the plug. RMS over windows, in %; windows in which more gathers than ψ accepts are left out",
        "for all. 0.0 stands where the noise of the reference exceeds the error. The runs: `granpipe run",
        "cases/reactor.yaml --set dem.walls=as_drawn --set 'dem.statistical_error=0.1 %' --set dem.ranks=1`, the one",
        "with `--set dem.max_time=60 --set dem.keep_snapshots=all`, the other with `--set dem.max_time=45 --set",
        "dem.seed=1001`, at the same plate speed.",
        "",
        "![chart](images/averaging_time.png)",
        "",
        "## Time for the same error",
        "",
        "Averaging time that each method needs for the error that ψ has on the whole, by interpolation between the",
        "rows below; — where it has not got there at the end.",
        "",
        "| psi: error [%] | psi [s] | " + " | ".join(f"{method} [s]" for method in METHODS[:-1]) + " |",
        "|---" * (1 + len(METHODS)) + "|",
        *(
            f"| {row.errors[-1, 0]:.1f} | {row.time:.1f} | "
            + " | ".join(time_for(rows, method, row.errors[-1, 0]) for method in range(len(METHODS) - 1))
            + " |"
            for row in rows
        ),
    ]
    for number, zone in enumerate(judge.zones):
        lines += [
            "",
            f"## {zone.capitalize() if zone == 'whole' else f'Section {zone}'}",
            "",
            "| averaged [s] | windows | " + " | ".join(METHODS) + " |",
            "|---" * (2 + len(METHODS)) + "|",
        ]
        lines += [
            f"| {row.time:.1f} | {row.accepted} of {row.windows} | "
            + " | ".join(f"{error:.1f}" for error in row.errors[:, number])
            + " |"
            for row in rows
        ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
