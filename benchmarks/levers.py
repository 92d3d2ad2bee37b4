"""A faster start of the plate, and the start of the average: what they save, and what they do to the field.

`run` simulates the test reactor with it and without it, one seed after the other, so that a machine that grows slower
favours neither; `page` writes docs/validation/levers.md from what there is.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from unittest import mock

import numpy as np
from onset import former_start

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.errors import DataError
from granpipe.field import Array, Field
from granpipe.homogenize.average import Sums
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline import averages
from granpipe.pipeline.averages import _steady_start, averaged_field, steady_segments
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.production import Production
from granpipe.pipeline.records import SettleRecord
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
REACTOR = HERE.parent / "cases" / "reactor.yaml"
SEEDS = (1, 2)
WAYS = {"faster": {}, "plain": {"dem.start_speed": "0.001 m/s"}}
"""With a faster start, and with one speed of the plate: the changes of the case."""

STARTS = {"MSER-5": former_start, "granpipe": _steady_start}
TARGETS = (0.10, 0.05)

MORE = 1.08
"""Segments over those of the look before, as in a run that ends by its error."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--ways", nargs="*", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--results", type=Path, default=Path("results-levers"))
    options = parser.parse_args()
    if options.what == "page":
        text = page(options.results)
        (HERE.parent / "docs" / "validation" / "levers.md").write_text(text)
        print(text)
        return
    for seed in options.seeds:
        for way in options.ways:
            with Console() as console:
                run_case(case_of(way, seed), options.results, console)


def case_of(way: str, seed: int) -> CaseFile:
    """The case of one run."""
    changes = {"name": f"levers-{way}-{seed}", "dem.seed": str(seed), "dem.ranks": "1", "export": "[]", "figures": "[]"}
    return read_case(REACTOR, changes | WAYS[way])


@dataclass(frozen=True)
class Finished:
    """A run that is done."""

    plan: Plan
    production: Production

    @property
    def settle_seconds(self) -> float:
        """Processor time of filling and settling."""
        return SettleRecord.read(self.production.settled).processor_seconds

    @cached_property
    def steady(self) -> list[Sums]:
        """What is averaged."""
        return steady_segments([*self.production.sums()], self.plan)

    @cached_property
    def work(self) -> Array:
        """Particle-steps of each segment."""
        particles = [report.particles for report in self.production.reports()]
        return np.array(particles, dtype=float) * self.plan.dem.segment_steps

    @property
    def seconds(self) -> float:
        """Processor time of production; where it falls, production was resumed."""
        told = [report.processor_seconds for report in self.production.reports()]
        ends = [one for one, following in pairwise(told) if following < one]
        return sum(ends) + told[-1]

    def ended(self, target: float) -> tuple[float, float, float]:
        """When a statistical error is first met in every section: time, time that is averaged [s], particle-steps.

        Raises
        ------
        DataError : it is not met
        """
        segments = [*self.production.sums()]
        count = self.plan.dem.segments_left_out + LEAST_BLOCKS
        while count <= len(segments):
            steady, worst = self._worst(segments[:count])
            if worst <= target:
                averaged = sum(sums.duration for sums in steady)
                return segments[count - 1].stop, averaged, float(self.work[:count].sum())
            count = max(count + 1, round(MORE * count))
        raise DataError(f"{self.plan.case.name} does not reach {target:.0%}")

    def _worst(self, segments: list[Sums]) -> tuple[list[Sums], float]:
        """What is averaged, and the largest statistical error of a section."""
        plan = self.plan
        try:
            steady = steady_segments(segments, plan)
            made = averaged_field(plan.case, plan.outline, steady, plan.dem.classes.sauter_diameter)
            return steady, max(made.figures["statistical_error"].values())
        except (DataError, KeyError):  # too few segments, or the filling still changes too fast
            return [], float("inf")


def finished(way: str, results: Path) -> list[Finished]:
    """The runs that there are."""
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    found = []
    for seed in SEEDS:
        plan = make_plan(case_of(way, seed).case, 1)
        try:
            found.append(Finished(plan, *finished_productions(plan, store, versions)))
        except DataError:
            continue
    return found


def field_of(runs: list[Finished]) -> Field:
    """The field of all runs together."""
    plan = runs[0].plan
    segments = [replace(sums, run=number) for number, run in enumerate(runs) for sums in run.steady]
    return averaged_field(plan.case, plan.outline, segments, plan.dem.classes.sauter_diameter).field


def page(results: Path) -> str:
    ways = {way: finished(way, results) for way in WAYS}
    return "\n".join(
        [
            "# Levers of the particle run",
            "",
            f"Made by `benchmarks/levers.py run` and `page` on {datetime.now(UTC):%Y-%m-%d}.",
            "",
            "**Faster start.** How far the flow has developed is a matter of plate travel, not of time. The plate",
            "sinks at half of free discharge until a twelfth of the content is gone (`dem.start_speed`), then at its",
            "final speed; the average begins where the data of the final speed are found steady.",
            "",
            "**Start of the average.** With [its correlation counted](onset.md), in place of MSER-5.",
            "",
            "The test reactor, as shipped, until every section has a statistical error of 5 or 10 %: simulated time,",
            "the part of it that is averaged, and particle-steps of production, which no other program on the machine",
            "changes, of the runs that get there. Core-seconds are those at the rate of all these runs, filling and",
            "settling included. A run whose error happens to be told small ends early, with either start.",
            "",
            "| plate | average begins | error | runs that reach it | time | averaged | particle-steps | core-seconds |",
            "|---" * 8 + "|",
            *_cost_lines(ways),
            "",
            "The field with the faster start against that without, all runs of each together in all their length, by",
            "`granpipe compare`:",
            "",
            "| section | difference | its noise | without noise | 95 % below |",
            "|---" * 5 + "|",
            *_difference_lines(ways),
            "",
            "Where there is one run each way, the difference holds that of two fillings, and that of the plate's",
            "level: without a faster start it stands an outlet radius below the outlet from the beginning.",
            "",
        ]
    )


def _cost_lines(ways: dict[str, list[Finished]]) -> list[str]:
    every = [run for runs in ways.values() for run in runs]
    rate = sum(run.work.sum() for run in every) / sum(run.seconds for run in every)
    settle = np.mean([run.settle_seconds for run in every])  # the beds are the same
    lines = []
    for way, runs in ways.items():
        for name, rule in STARTS.items():
            for target in TARGETS:
                with mock.patch.object(averages, "_steady_start", rule):
                    ended = [one for run in runs if (one := _ended(run, target)) is not None]
                cells = [way, name, f"{target:.0%}", f"{len(ended)} of {len(runs)}", *[""] * 4]
                if ended:
                    time, averaged, work = np.array(ended).T
                    cells[4:] = [f"{_text(time)} s", f"{_text(averaged)} s", f"{_text(work / 1e9)}·10⁹"]
                    cells.append(_text(settle + work / rate))
                lines.append(f"| {' | '.join(cells)} |")
    return lines


def _ended(run: Finished, target: float) -> tuple[float, float, float] | None:
    try:
        return run.ended(target)
    except DataError:
        return None


def _difference_lines(ways: dict[str, list[Finished]]) -> list[str]:
    plan = ways["plain"][0].plan
    plain, faster = field_of(ways["plain"]), field_of(ways["faster"])
    return [
        f"| {one.name} | {one.observed:.1%} | {one.noise:.1%} | {one.noise_free:.1%} | {one.upper:.1%} |"
        for one in compare(plain, faster, plan.case.outline.levels, plan.dem.classes.sauter_diameter)
    ]


def _se(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _text(values: Array) -> str:
    mean, error = values.mean(), _se(values)
    return f"{mean:.3g} ± {error:.1g}" if len(values) > 1 else f"{mean:.3g}"


if __name__ == "__main__":
    main()
