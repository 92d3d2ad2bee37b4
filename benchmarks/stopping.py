"""Does a run that ends by its error have that error? Fillings of one vessel, each ended by the criterion of a run.

`python benchmarks/stopping.py RESULTS/CASE …`: for several total errors, without a systematic one, when a run would
have ended, and how far its field then is from that of all the others in all their length, their noise taken off.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.field import Field
from granpipe.homogenize.average import Sums
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import averaged_field, steady_segments
from granpipe.pipeline.convergence import StatisticalErrorCriterion
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.gates import BLOCKS
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.study.budget import sure_factor
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

MORE = 1.08
"""Segments over those of the look before, as in a run."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="results of finished runs")
    parser.add_argument("--totals", nargs="*", type=float, default=[0.04, 0.05, 0.06, 0.08, 0.10])
    options = parser.parse_args()
    for row in rows(options.folders, options.totals):
        print(f"| {' | '.join(row)} |", flush=True)


def rows(folders: Sequence[Path], totals: Sequence[float]) -> Iterator[list[str]]:
    """Total error asked for, whether as a 95 % bound, `dem.statistical_error` that it gives; runs that end before their
    end, segments that they take; RMS and largest error then, and how many are within what was asked for.
    """
    runs = [_segments(folder) for folder in folders]
    others = [_others(folders, runs, at) for at in range(len(runs))]
    for total in totals:
        for proven in (False, True):
            target = total / sure_factor(BLOCKS.low) if proven else total
            ends, errors = [], []
            for folder, segments, other in zip(folders, runs, others, strict=True):
                plan = _plan(folder, {"dem.statistical_error": f"{target:.6g}"})
                if (count := end(plan, segments)) is None:
                    continue
                ends.append(count)
                errors.append(error(plan, segments[:count], other))
            found = [f"{total:.0%}", "bound" if proven else "estimate", f"{target:.1%}", f"{len(ends)} of {len(runs)}"]
            if ends:
                held = sum(one <= total for one in errors)
                root = float(np.sqrt(np.mean(np.square(errors))))
                found += [f"{np.mean(ends):.0f}", f"{root:.1%}", f"{max(errors):.1%}", f"{held} of {len(ends)}"]
            yield found


def end(plan: Plan, segments: Sequence[Sums]) -> int | None:
    """Segments after which the criterion ends the run; None where it does not."""
    criterion, count = StatisticalErrorCriterion(plan), LEAST_BLOCKS
    while count <= len(segments):
        if criterion(segments[:count]).reached:
            return count
        count = max(count + 1, round(MORE * count))
    return None


def error(plan: Plan, segments: Sequence[Sums], other: Field) -> float:
    """Difference of the whole field from the others', their noise taken off, its own left in."""
    field = _field(plan, steady_segments(segments, plan))
    diameter = plan.dem.classes.sauter_diameter
    whole = next(one for one in compare(field, other, plan.case.outline.levels, diameter) if one.name == "whole")
    exact = replace(field, flux_r_se=np.zeros_like(field.flux_r), flux_z_se=np.zeros_like(field.flux_z))
    theirs = next(one for one in compare(exact, other, plan.case.outline.levels, diameter) if one.name == "whole")
    return float(np.sqrt(max(whole.observed**2 - theirs.noise**2, 0.0)))


def _others(folders: Sequence[Path], runs: Sequence[list[Sums]], at: int) -> Field:
    """The field of all runs but one, in all their length."""
    plan = _plan(folders[at], {})
    rest = [replace(one, run=number) for number, run in enumerate(runs) if number != at for one in run]
    return _field(plan, steady_segments(rest, plan))


def _field(plan: Plan, segments: Sequence[Sums]) -> Field:
    return averaged_field(plan.case, plan.outline, segments, plan.dem.classes.sauter_diameter).field


def _plan(folder: Path, changes: dict[str, str]) -> Plan:
    return make_plan(read_case(folder / "case.yaml", {"homogenize.start": "auto"} | changes).case, 1)


def _segments(folder: Path) -> list[Sums]:
    store = Store(folder.parent / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    return [*finished_productions(_plan(folder, {}), store, versions)[0].sums()]


if __name__ == "__main__":
    main()
