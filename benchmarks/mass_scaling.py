"""Heavier small particles (`dem.mass_scaling`): what they save, and what they do to the field.

Compares results that are given with the test reactor's limit (benchmarks/reactor_limit.py), and with each other, and
writes docs/validation/mass_scaling.md, which says how they were made.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from math import hypot
from pathlib import Path

from reactor_limit import LIMIT, larger, on_cells, unit

from granpipe.analysis.compare import Difference, compare
from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.dem.sizes import simulated_classes
from granpipe.field import Field
from granpipe.pipeline.averages import statistical_errors
from granpipe.progress import duration_text
from granpipe.study.reference import read_run

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "validation" / "mass_scaling.md"

HEAD = """\
# Mass scaling

Made by `benchmarks/mass_scaling.py PAIRS …` on {date}.

The time step of a DEM run goes with the Rayleigh time of its smallest particle, π r √(ρ/G) over a constant, and so with
r √ρ. In a slow bed inertia hardly matters: what counts is the inertial number I = γ̇ d √(ρ/P) of the particles on
average (GDR MiDi, 2004). `dem.mass_scaling: auto` gives every particle below the Sauter diameter d₃₂ the density at
which its d √ρ is that of d₃₂, and lowers gravity until the bed weighs what it did: pressures stay, no particle has a
larger inertial number than the mean one, and the time step is that of d₃₂. The whole is heavier by a factor, 1.2 in the
test reactor, which the plate's speed allows for: it is chosen √1.2 times slower. Where masses show (free discharge,
forces, fluctuations, sizes that separate) they are not scaled.

{says}

*Beyond noise* are differences E = √(Σ A |δU|² / Σ A |U|²) of the bulk velocity with the noise of both fields taken off,
as on [The reactor with its own particles](reactor_limit.md), and their 95 % bound. *In all* has the noise of the run
itself in it, as it tells it: what a user gets. *Processor time* is that of the whole run on one core, filling included.

| run | against | beyond noise, whole | by section | 95 % bound | in all | 95 % bound | processor time |
|---|---|---|---|---|---|---|---|
{rows}

{made}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", nargs="+", help="RESULTS~RESULTS, or `limit`: what is compared ~ with what")
    parser.add_argument("--text", type=Path, help="what follows from the figures, a line ---, how the runs were made")
    options = parser.parse_args()
    says, made = options.text.read_text().split("\n---\n") if options.text else _kept()
    rows = "\n".join(_row(*pair.split("~")) for pair in options.pairs)
    PAGE.write_text(HEAD.format(date=datetime.now(UTC).date(), says=says.strip(), rows=rows, made=made.strip()))
    print(PAGE.read_text())


def _kept() -> tuple[str, str]:
    """Both texts of the page as it is."""
    parts = PAGE.read_text().split("\n\n")
    return parts[3], parts[-1]


def _row(other: str, one: str) -> str:
    fields = [_read(LIMIT if name == "limit" else Path(name)) for name in (one, other)]
    grid = larger(fields[0][1].grid, fields[1][1].grid)
    diameter = max(simulated_classes(case).sauter_diameter for case, _ in fields)
    levels = fields[0][0].outline.levels
    found = compare(on_cells(fields[0][1], grid), on_cells(fields[1][1], grid), levels, diameter)
    run = read_run(Path(other))
    own = statistical_errors(fields[1][1], {})["whole"]
    seconds = "" if run.seconds is None else duration_text(run.seconds)
    names = [Path(other).name, "the limit" if one == "limit" else Path(one).name]
    values = (found[0].noise_free, found[0].upper, hypot(found[0].noise_free, own), hypot(found[0].upper, own))
    beyond, bound, total, most = (f"{100 * value:.1f}" for value in values)
    sections = ", ".join(_told(found[1:]))
    return f"| {names[0]} | {names[1]} | {beyond} | {sections} | {bound} | {total} | {most} | {seconds} |"


def _told(found: list[Difference]) -> Iterator[str]:
    for one in found:
        yield f"{one.name} {100 * one.noise_free:.1f}" if one.noise_free else f"{one.name} < {100 * one.upper:.1f}"


def _read(folder: Path) -> tuple[Case, Field]:
    case = load_case(folder / "case.yaml")
    return case, unit(Field.load(folder / "field.npz"), case)


if __name__ == "__main__":
    main()
