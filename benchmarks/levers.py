"""Levers of the particle run: what each saves, and what it does to the field.

`run` simulates with the lever and without it, several seeds each, one after the other, so that a machine that grows
slower favours neither; `page` writes docs/validation/levers.md from what there is.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.errors import DataError
from granpipe.field import Array, Field
from granpipe.homogenize.average import Sums
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import averaged_field, steady_segments
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.production import Production
from granpipe.pipeline.records import SettleRecord
from granpipe.pipeline.run import run_case
from granpipe.planning.plan import Plan, make_plan
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
CASES = HERE.parent / "cases"
COMMON = {
    "dem.ranks": "1",
    "dem.statistical_error": "0.1 %",  # never reached: every run is as long as it is told to be
    "homogenize.start": "auto",
    "export": "[]",
    "figures": "[]",
}


@dataclass(frozen=True)
class Scene:
    """A vessel with the changes of its case, and the time of production [s] with a faster start and without it."""

    case: str
    changes: dict[str, str]
    faster: float
    plain: float
    seeds: tuple[int, ...]


SCENES = {
    "smoke": Scene("smoke", {}, 6.0, 8.0, (1, 2, 3, 4)),
    "reactor": Scene("reactor", {"dem.coarse_grain_factor": "3"}, 20.0, 35.0, (1, 2)),
}
TARGET = 0.05
"""Statistical error that runs are compared at."""

MORE = 1.08
"""Segments over those of the look before, as in a run that ends by its error."""

WAYS = ("faster", "plain")
"""A run with a faster start, and one whose plate has one speed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--scene", choices=list(SCENES), default="smoke")
    parser.add_argument("--ways", nargs="*", choices=WAYS, default=WAYS)
    parser.add_argument("--seeds", nargs="*", type=int)
    parser.add_argument("--results", type=Path, default=Path("results-levers"))
    options = parser.parse_args()
    if options.what == "page":
        text = page(options.results)
        (HERE.parent / "docs" / "validation" / "levers.md").write_text(text)
        print(text)
        return
    for seed in options.seeds or SCENES[options.scene].seeds:
        for way in options.ways:
            with Console() as console:
                run_case(case_of(options.scene, way, seed), options.results, console)


def case_of(scene: str, way: str, seed: int) -> CaseFile:
    """The case of one run."""
    chosen = SCENES[scene]
    changes = COMMON | chosen.changes | {"name": f"levers-{scene}-{way}-{seed}", "dem.seed": str(seed)}
    changes["dem.max_time"] = repr(getattr(chosen, way))
    if way == "plain":
        changes["dem.start_speed"] = "0.001 m/s"
    return read_case(CASES / f"{chosen.case}.yaml", changes)


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

    @property
    def work_before(self) -> float:
        """Particle-steps up to the average."""
        return float(self.work[: len(self.work) - len(self.steady)].sum())

    def work_to(self, error: float) -> float:
        """Particle-steps of production until the statistical error of the whole is first as small as this.

        Raises
        ------
        DataError : the run does not reach it
        """
        segments = [*self.production.sums()]
        count = self.plan.dem.segments_left_out + LEAST_BLOCKS
        while count <= len(segments):
            if self._error(segments[:count]) <= error:
                return float(self.work[:count].sum())
            count = max(count + 1, round(MORE * count))
        raise DataError(f"{self.plan.case.name} does not reach {error:.0%}")

    def _error(self, segments: list[Sums]) -> float:
        plan = self.plan
        try:
            steady = steady_segments(segments, plan)
            made = averaged_field(plan.case, plan.outline, steady, plan.dem.classes.sauter_diameter)
            return float(made.figures.get("statistical_error", {}).get("whole", np.inf))
        except DataError:  # too few segments, or no flow at some level yet
            return float("inf")

    @property
    def averaged(self) -> float:
        """Time that is averaged [s]."""
        return sum(sums.duration for sums in self.steady)


def finished(scene: str, way: str, results: Path) -> list[Finished]:
    """The runs that there are, as long as they should be."""
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    found = []
    for seed in SCENES[scene].seeds:
        plan = make_plan(case_of(scene, way, seed).case, 1)
        try:
            (production,) = finished_productions(plan, store, versions)
        except DataError:
            continue
        if len(production.segments) == plan.dem.segments:
            found.append(Finished(plan, production))
    return found


def field_of(runs: list[Finished]) -> Field:
    """The field of all runs together."""
    plan = runs[0].plan
    segments = [replace(sums, run=number) for number, run in enumerate(runs) for sums in run.steady]
    return averaged_field(plan.case, plan.outline, segments, plan.dem.classes.sauter_diameter).field


def page(results: Path) -> str:
    lines = [
        "# Levers of the particle run",
        "",
        f"Made by `benchmarks/levers.py run` and `page` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        "**Faster start.** How far the flow has developed is a matter of plate travel, not of time. The plate sinks at",
        "half of free discharge for a third of the least travel (`dem.start_speed`), then at its final speed; the",
        "average begins half a diameter later at the earliest, where the data of the final speed are found steady.",
        "",
        "Each vessel was run with the same seeds both ways, one after the other. *Settle*: processor time of filling",
        "and settling, the same both ways. *Before the average* and *a second of it* are production in particle-steps,",
        "which no other program on the machine changes; a run may leave out more than its transient, up to half of it,",
        "so that what gathers is little. *To 5 %*: core-seconds until the statistical error of the whole is first 5 %",
        "or less, as a run would stop, settling included, particle-steps at the rate of all runs. ± is the standard",
        "error from run to run.",
        "",
        "| vessel | way | runs | settle | before the average | a second of it | averaged from | to 5 % |",
        "|---" * 8 + "|",
    ]
    differences: list[str] = []
    for name in SCENES:
        ways = {way: finished(name, way, results) for way in WAYS}
        if not all(ways.values()):
            continue
        lines += _cost_lines(name, ways)
        differences += _difference_lines(name, ways)
    lines += [
        "",
        "The field with the faster start against that without, all runs of each together, by `granpipe compare`:",
        "",
        "| vessel | section | difference | its noise | without noise | 95 % below |",
        "|---" * 6 + "|",
        *differences,
        "",
    ]
    return "\n".join(lines)


def _cost_lines(name: str, ways: dict[str, list[Finished]]) -> list[str]:
    every = [run for runs in ways.values() for run in runs]
    rate = sum(run.work.sum() for run in every) / sum(run.seconds for run in every)
    lines, cost = [], {}
    for way, runs in ways.items():
        before = np.array([run.work_before for run in runs])
        a_second = np.array([run.work[-len(run.steady) :].sum() / run.averaged for run in runs])
        settle = np.array([run.settle_seconds for run in every])  # the beds are the same
        cost[way] = settle.mean() + np.array([run.work_to(TARGET) for run in runs]) / rate
        start = np.array([run.steady[0].start for run in runs])
        work = f"{_text(before / 1e6)}·10⁶ | {_text(a_second / 1e6)}·10⁶"
        lines.append(
            f"| {name} | {way} | {len(runs)} | {_text(settle)} s | {work} | {_text(start)} s | {_text(cost[way])} s |"
        )
    plain, faster = cost["plain"], cost["faster"]
    ratio = plain.mean() / faster.mean()
    error = ratio * np.hypot(_se(plain) / plain.mean(), _se(faster) / faster.mean())
    return [*lines, f"| | **{ratio:.2f} ± {error:.2f} times cheaper** | | | | | | |"]


def _difference_lines(name: str, ways: dict[str, list[Finished]]) -> list[str]:
    plan = ways["plain"][0].plan
    plain, faster = field_of(ways["plain"]), field_of(ways["faster"])
    found = compare(plain, faster, plan.case.outline.levels, plan.dem.classes.sauter_diameter)
    return [
        f"| {name} | {one.name} | {one.observed:.1%} | {one.noise:.1%} | {one.noise_free:.1%} | {one.upper:.1%} |"
        for one in found
    ]


def _se(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _text(values: Array) -> str:
    mean, error = values.mean(), _se(values)
    return f"{mean:.3g} ± {error:.1g}" if len(values) > 1 else f"{mean:.3g}"


if __name__ == "__main__":
    main()
