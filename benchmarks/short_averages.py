"""Whether the statistical error that a run tells holds where its bed has hardly moved: seeds against each other.

`run` simulates two vessels with four seeds each; `page` averages stretches of several lengths, compares the scatter of
the four fields with the error that they tell, and writes docs/validation/short_averages.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path

import numpy as np
from set_back import VESSELS

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.errors import DataError
from granpipe.field import Field
from granpipe.homogenize.average import Sums
from granpipe.pipeline.averages import averaged_field
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
TIMES = {"flat": "4 s", "hopper": "3 s"}
SEEDS = range(1, 5)
BEGINS, LENGTHS = (0.5, 2.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)  # diameters of the widest level

HEAD = """\
# Short averages

Made by `benchmarks/short_averages.py run` and `page` on {date}.

The statistical error of a run is made of how it scatters in time. What changes more slowly than the run is long is not
in it: how the particles lie, which only motion by some diameters changes. Here stretches of four runs of one case, with
four seeds, are averaged, and the scatter of the four fields is set against the error that they tell, both as E of one
field. *From* and *over* are travel of the widest level, in particle diameters, after the faster start. Ratios are
scatter over error: above 1 the error that is told is too small.

**What it says.** Over less than two diameters fields scatter by {short} times the error that they tell, in the worst
section by up to {worst:.1f} times; over two and more by {long} times, the worst section by up to {later:.1f}. So a run
with a `dem.statistical_error` goes on until its widest level has moved by two diameters during the average, and is
marked where `dem.max_time` ends it before; one without tells it in a note. Of what remains some is left from the
filling: it is less where the average begins later.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--vessels", nargs="+", choices=list(TIMES), default=list(TIMES))
    parser.add_argument("--results", type=Path, default=Path("results-short-averages"))
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "short_averages.md")
    options = parser.parse_args()
    if options.what == "run":
        for name in options.vessels:
            for seed in SEEDS:
                with Console() as console:
                    run_case(case_of(name, seed, options.results), options.results, console)
        return
    text = page(options.results)
    options.out.write_text(text)
    print(text)


def case_of(name: str, seed: int, results: Path) -> CaseFile:
    """The case of one run, which goes on for its whole time."""
    folder = results / "cases" / f"{name}-{seed}"
    VESSELS[name].case(folder, 1.0)
    changes = {"dem.seed": f"{seed}", "dem.start_speed": "auto", "dem.max_time": TIMES[name], "figures": "[]"}
    changes |= {"dem.statistical_error": "1.5 %", "homogenize.start": "auto", "export": "[]"}
    return read_case(folder / "case.yaml", changes)


def page(results: Path) -> str:
    tables: list[str] = []
    ratios: dict[bool, list[list[float]]] = {False: [], True: []}  # over two diameters and more? → of each stretch
    for name in TIMES:
        plan, runs = finished(name, results)
        sections = ["whole", *plan.case.outline.levels]
        heads = " | ".join(f"{one}: scatter, told, %" for one in sections)
        lines = [f"## {name.capitalize()}: {VESSELS[name].title}\n", f"| from | over | {heads} | ratios |"]
        lines.append("|---" * (3 + len(sections)) + "|")
        for begin, length, found in stretches(plan, runs):
            each = [scatter / told for scatter, told in found.values()]
            cells = " | ".join(f"{100 * scatter:.1f}, {100 * told:.1f}" for scatter, told in found.values())
            lines.append(f"| {begin:g} | {length:g} | {cells} | {', '.join(f'{one:.2f}' for one in each)} |")
            ratios[length >= 2].append(each)
        tables += [*lines, ""]
    short, long = (f"{min(one[0] for one in of):.1f} to {max(one[0] for one in of):.1f}" for of in ratios.values())
    worst, later = (max(max(one) for one in of) for of in ratios.values())
    date = f"{datetime.now(UTC):%Y-%m-%d}"
    return "\n".join([HEAD.format(date=date, short=short, long=long, worst=worst, later=later), *tables])


def finished(name: str, results: Path) -> tuple[Plan, list[list[Sums]]]:
    """The plan of a vessel and the segments of its four runs."""
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    plans = [make_plan(case_of(name, seed, results).case, 1) for seed in SEEDS]
    runs = [[sums for one in finished_productions(plan, store, versions) for sums in one.sums()] for plan in plans]
    return plans[0], runs


def stretches(plan: Plan, runs: list[list[Sums]]) -> Iterator[tuple[float, float, dict[str, tuple[float, float]]]]:
    """Where stretches begin, how long they are; section → scatter of the fields, and the error that they tell."""
    dem, outline = plan.dem, plan.outline
    travel = dem.plate_speed * dem.segment_steps * dem.time_step * outline.outlet_area / outline.widest_area()
    travel /= dem.classes.sauter_diameter
    for begin in BEGINS:
        for length in LENGTHS:
            first = dem.segments_left_out + round(begin / travel)
            fields = [field_of(plan, run[first : first + round(length / travel)]) for run in runs]
            known = [one for one in fields if one is not None]
            if len(known) == len(runs):
                yield begin, length, scatter(plan, known)


def field_of(plan: Plan, segments: list[Sums]) -> Field | None:
    """The field of some segments; None where the filling still changes too fast for one."""
    try:
        return averaged_field(plan.case, plan.outline, segments, plan.dem.classes.sauter_diameter).field
    except DataError:
        return None


def scatter(plan: Plan, fields: list[Field]) -> dict[str, tuple[float, float]]:
    """Of one field: root mean square over all pairs, each of two fields."""
    seen: dict[str, list[tuple[float, float]]] = {}
    for one, other in combinations(fields, 2):
        for found in compare(one, other, plan.case.outline.levels, plan.dem.classes.sauter_diameter):
            seen.setdefault(found.name, []).append((found.observed**2 / 2, found.noise**2 / 2))
    means = {name: np.sqrt(np.mean(values, axis=0)) for name, values in seen.items()}
    return {name: (float(observed), float(noise)) for name, (observed, noise) in means.items()}


if __name__ == "__main__":
    main()
