"""Fines left out of a run (`dem.fines`): what it saves, and what it does to the field.

Compares results that are given with the run of the test reactor with the material's own particles
(benchmarks/reactor_limit.py), and each other, and writes docs/validation/fines.md, which says how they were made.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from reactor_limit import LIMIT, larger, on_cells, unit

from granpipe.analysis.compare import Difference, compare
from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.dem.sizes import simulated_classes
from granpipe.field import Field
from granpipe.progress import duration_text
from granpipe.study.reference import read_run

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "validation" / "fines.md"

HEAD = """\
# Fines left out

Made by `benchmarks/fines.py RESULTS …` on {date}.

With `dem.fines: left_out` the size classes that hold the finest tenth of the mass, at the most, are not simulated, and
the others take their place. The time step goes with the smallest particle, and fines are many: of the test reactor's
six classes the two smallest have 8.3 % of the mass and 28 % of the particles. Without them a step is 1.5 times as long,
0.79 times as many particles are there, and their Sauter diameter is 1.05 times that of all.

{says}

Differences are E = √(Σ A |δU|² / Σ A |U|²) of the bulk velocity with the noise of both fields taken off, as on
[The reactor with its own particles](reactor_limit.md), and below it their 95 % bound. *Processor time* is that of the
whole run on one core, filling included.

| run | against | whole | by section | 95 % bound, whole | told by the run, whole | processor time |
|---|---|---|---|---|---|---|
{rows}

The runs of the reactor are `granpipe run cases/reactor.yaml --set dem.coarse_grain_factor=1 --set dem.ranks=1 --set
dem.plate_speed=0.05 --set dem.seed=2 --set 'dem.statistical_error=1.5 %'`, a plate that is marked as too fast, with
`--set dem.max_time=…` as in their names, and `--set dem.fines=left_out`, or not; that with enlarged particles has
`--set dem.coarse_grain_factor=1.5 --set contact.youngs_modulus=5e6 --set dem.max_time=12s` and 4 %. Those of the hopper
are `granpipe run cases/hopper.yaml --set model=dem --set dem.ranks=1 --set dem.max_time=25s --set
'dem.statistical_error=3 %' --set 'material.size={{radius: {{normal: {{mean: 6 cm, std: 2 cm, min: 3 cm, max: 9 cm}}}},
by: number, classes: 6}}'`; they end by their time and are marked for that.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", nargs="+", help="RESULTS~RESULTS, or `limit`: what is compared ~ with what")
    parser.add_argument("--says", type=Path, help="text of what follows from the figures; that of the page else")
    options = parser.parse_args()
    says = options.says.read_text().strip() if options.says else PAGE.read_text().split("\n\n")[3]
    rows = "\n".join(_row(*pair.split("~")) for pair in options.pairs)
    PAGE.write_text(HEAD.format(date=datetime.now(UTC).date(), says=says, rows=rows))
    print(PAGE.read_text())


def _row(other: str, one: str) -> str:
    fields = [_read(LIMIT if name == "limit" else Path(name)) for name in (one, other)]
    grid = larger(fields[0][1].grid, fields[1][1].grid)
    diameter = max(simulated_classes(case).sauter_diameter for case, _ in fields)
    levels = fields[0][0].outline.levels
    found = compare(on_cells(fields[0][1], grid), on_cells(fields[1][1], grid), levels, diameter)
    run = read_run(Path(other))
    told = compare(fields[1][1], fields[1][1], levels, diameter)[0].noise / 2**0.5
    seconds = "" if run.seconds is None else duration_text(run.seconds)
    names = [Path(other).name, "the limit" if one == "limit" else Path(one).name]
    sections = ", ".join(_told(found[1:]))
    return (
        f"| {names[0]} | {names[1]} | {100 * found[0].noise_free:.1f} | {sections} | {100 * found[0].upper:.1f} | "
        f"{100 * told:.1f} | {seconds} |"
    )


def _told(found: list[Difference]) -> Iterator[str]:
    for one in found:
        yield f"{one.name} {100 * one.noise_free:.1f}" if one.noise_free else f"{one.name} < {100 * one.upper:.1f}"


def _read(folder: Path) -> tuple[Case, Field]:
    case = load_case(folder / "case.yaml")
    return case, unit(Field.load(folder / "field.npz"), case)


if __name__ == "__main__":
    main()
