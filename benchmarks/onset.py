"""Where an average begins: the rule in use beside MSER-5, rules of before, half of the run.

`synthetic`: correlated series with a transient, whose mean is known. `fields RESULTS/CASE …`: the final fields of runs
of one vessel in other fillings, with today's start and with former ones. `ends RESULTS/CASE …`: runs of the test
reactor, ended sooner and later, against the reference with the material's own particles. `after RESULTS/CASE …`: the
same with more or less left out after the faster start, whatever the data say.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from unittest import mock

import numpy as np
from scipy import signal, stats

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.errors import DataError
from granpipe.field import Array
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.statistics import effective_samples, onset, standard_error
from granpipe.pipeline import averages
from granpipe.pipeline.averages import (
    AveragedField,
    _gathered,
    _steady_start,
    averaged_field,
    steady_segments,
)
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.production import Production
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.study.fields import Average, FinishedRun, field_of
from granpipe.study.reference import EarlierRun, read_run
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

FREEDOM = 1 / 3  # degrees of freedom of a standard error, over the effective samples
COLUMNS = 8
REFERENCE = Path(__file__).parent / "references" / "reactor_limit"
SHARES = (1.0, 0.75, 0.6, 0.5, 0.4)  # of a run after its faster start
LEFT_OUT = (0.0, 0.1, 0.25, 0.5)  # diameters of the plate's travel after a faster start
PROCESSES = {
    "independent": (0.0, 0.0),
    "AR(1), 0.5": (0.5, 0.0),
    "AR(1), 0.9": (0.9, 0.0),
    "AR(2), bursts each 7 samples": (2 * 0.85 * np.cos(2 * np.pi / 7), -(0.85**2)),
}
"""Coefficients of the last two samples."""
TRANSIENTS = {"none": (0.0, 1.0), "2 σ, n/30": (2.0, 1 / 30), "2 σ, n/10": (2.0, 0.1), "5 σ, n/10": (5.0, 0.1),
              "1 σ, 0.3 n": (1.0, 0.3)}  # fmt: skip
"""Amplitude, decay time over the length of the series."""


def mser5(*series: Array) -> int:
    """White (1997): s²/n of what is left is least, on means of five samples taken as independent."""
    count = len(series[0]) // 5
    if count < 2:
        return 0
    left = np.arange(count, 0, -1)[: count // 2 + 1]
    spread = np.zeros(len(left))
    for one in series:
        means = one[: count * 5].reshape(count, 5, -1).mean(axis=1)
        late = means[count // 2 :].var(axis=0)
        if (late > 0).any():
            scaled = means[:, late > 0] / np.sqrt(late[late > 0])
            spread += [scaled[count - n :].var(axis=0).mean() / n for n in left]
    return int(np.argmin(spread)) * 5


def least_error(*series: Array) -> int:
    """The rule in use on series that are steady only together: each over its own scatter in the second half."""
    scaled = []
    for one in series:
        columns = one.reshape(len(one), -1)
        late = columns[len(columns) // 2 :].std(axis=0)
        scaled.append(columns[:, late > 0] / (late[late > 0] * np.sqrt(max((late > 0).sum(), 1))))
    values = np.concatenate(scaled, axis=1)
    values = values - values.mean(axis=0)
    return onset(values @ values.T)


RULES: dict[str, Callable[..., int]] = {
    "half": lambda *series: len(series[0]) // 2,
    "MSER-5": mser5,
    "granpipe": least_error,
}
SERIES = "by level flows, mass, kinetic energy"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["synthetic", "fields", "ends", "after"])
    parser.add_argument("folders", nargs="*", type=Path, help="results")
    parser.add_argument("--repeat", type=int, default=100)
    parser.add_argument("--samples", nargs="*", type=int, default=[40, 100, 250])
    options = parser.parse_args()
    told_of = {
        "synthetic": lambda: synthetic(options.samples, options.repeat),
        "fields": lambda: fields(options.folders, options.samples),
        "ends": lambda: ends(options.folders),
        "after": lambda: after(options.folders),
    }
    for row in told_of[options.what]():
        print(f"| {' | '.join(row)} |", flush=True)


def synthetic(samples: Sequence[int], repeat: int) -> Iterator[list[str]]:
    """Rows: samples, process, transient; by rule: share left out, RMS error over that of the whole series without a
    transient, scatter over claimed error, 95 % intervals that hold.
    """
    for count in samples:
        for process, coefficients in PROCESSES.items():
            for transient, (amplitude, decay) in TRANSIENTS.items():
                rng = np.random.default_rng(count)
                found: dict[str, list[Array]] = {rule: [] for rule in RULES}
                for _ in range(repeat):
                    series, variance = process_of(rng, count, coefficients)
                    shape = np.exp(-np.arange(count) / (decay * count))
                    series += amplitude * shape[:, None] * rng.uniform(-1.5, 1.5, COLUMNS)
                    for rule, begin in RULES.items():
                        at = begin(series)
                        mean, error, quantile = told(series[at:])
                        held = (np.abs(mean) <= quantile * error).mean()
                        found[rule].append(np.array([at / count, (mean**2).mean(), (error**2).mean(), held]))
                yield [str(count), process, transient, *(_cells(rows, variance / count) for rows in found.values())]


def process_of(rng: np.random.Generator, count: int, coefficients: tuple[float, float]) -> tuple[Array, float]:
    """(count, COLUMNS) samples of variance 1, mean 0; variance of a long mean times its length."""
    filtered = [1.0, -coefficients[0], -coefficients[1]]
    response = signal.lfilter([1.0], filtered, np.r_[1.0, np.zeros(999)])
    size = np.sqrt((response**2).sum())
    series = signal.lfilter([1.0], filtered, rng.normal(size=(count + 300, COLUMNS)), axis=0)[300:]
    return np.asarray(series / size), float((response.sum() / size) ** 2)


def told(series: Array) -> tuple[Array, Array, float]:
    """Mean of (n, k) samples, its standard error, half the width of a 95 % interval over it."""
    effective = min(effective_samples(series, np.zeros(len(series), dtype=int)), len(series))
    quantile = stats.t.ppf(0.975, max(FREEDOM * effective, 1))
    return series.mean(axis=0), standard_error(series, effective), float(quantile)


def _cells(rows: list[Array], variance: float) -> str:
    left_out, off, claimed, held = np.mean(rows, axis=0)
    return f"{left_out:.0%}, {np.sqrt(off / variance):.2f}, {np.sqrt(off / claimed):.2f}, {held:.0%}"


def former_start(segments: list[Sums], plan: Plan) -> float:
    """Where averaging began [s]: after the onset of MSER-5, in the first half, where the filling changes least."""
    whole = merge(segments)
    begun = float(whole.time[mser5(whole.level_flow, whole.solids, whole.kinetic)])
    return _least_gathering(segments, plan, begun, max(begun, 0.5 * (segments[0].start + segments[-1].stop)))


def start_by_series(segments: list[Sums], plan: Plan) -> float:
    """Where averaging began [s]: at the onset of these series, or up to an eighth of the rest later."""
    whole = merge(segments)
    begun = float(whole.time[least_error(whole.level_flow, whole.solids, whole.kinetic)])
    return _least_gathering(segments, plan, begun, begun + (segments[-1].stop - begun) / 8)


def _least_gathering(segments: list[Sums], plan: Plan, begun: float, latest: float) -> float:
    """Of the starts between two times [s], the one from which on the filling changes least to the end."""
    first = [i for i, one in enumerate(segments) if begun - one.duration < one.start <= latest] or [0]
    net = _gathered(segments, plan)
    return segments[min(first, key=lambda i: float(net[i]))].start


def fields(folders: Sequence[Path], samples: Sequence[int]) -> Iterator[list[str]]:
    """Rows: segments, start; share left out, claimed error, scatter of the final fields between the runs, over what the
    errors of all faces claim, and the 95 % intervals that hold the others' mean.
    """
    runs = [_finished(folder) for folder in folders]
    for count in samples:
        for name, rule in STARTS.items():
            made, left_out = [], []
            for plan, production in runs:
                steady, averaged = _averaged(plan, [*production.sums()][:count], rule)
                left_out.append(1 - len(steady) / (count - plan.dem.segments_left_out))
                made.append(averaged)
            flux = np.array([np.r_[one.field.flux_r.ravel(), one.field.flux_z.ravel()] for one in made])
            error = np.array([np.r_[one.field.flux_r_se.ravel(), one.field.flux_z_se.ravel()] for one in made])
            flowing = np.abs(flux.mean(axis=0)) > 0.05 * np.sqrt(np.mean(flux**2))
            scatter, size = flux.var(axis=0, ddof=1), (flux.mean(axis=0) ** 2).sum()
            share, held = np.sqrt(1 + 1 / (len(flux) - 1)), []
            for at, one in enumerate(made):
                width = share * stats.t.ppf(0.975, FREEDOM * one.figures["effective_blocks"]) * error[at]
                off = np.abs(flux[at] - np.delete(flux, at, axis=0).mean(axis=0))
                held.append((off <= width)[flowing].mean())
            claimed = np.sqrt(np.mean([one.figures["statistical_error"]["whole"] ** 2 for one in made]))
            ratio = np.sqrt(scatter[flowing].sum() / (error**2).mean(axis=0)[flowing].sum())
            yield [str(count), name, f"{np.mean(left_out):.0%}", f"{claimed:.1%}",
                   f"{np.sqrt(scatter.sum() / size):.1%}", f"{ratio:.2f}", f"{np.mean(held):.0%}"]  # fmt: skip


STARTS = {"MSER-5, in half of the run": former_start, SERIES: start_by_series, "granpipe": _steady_start}


def ends(folders: Sequence[Path]) -> Iterator[list[str]]:
    """Rows: run, its end [s]; by start: share of the time after a faster start that is averaged, independent blocks,
    statistical error as told, difference from the reference. At last the RMS of both of the ends at which every start
    gives a field, and how many these are; and how many fields each start gives.
    """
    reference = read_run(REFERENCE)
    found: list[dict[str, Array]] = []
    for folder in folders:
        plan, production = _finished(folder)
        finished = FinishedRun(plan, (production,))
        judge = _judge(reference, plan)
        begun, stop = plan.dem.average_from, finished.segments[-1].stop
        for end in (begun + share * (stop - begun) for share in SHARES):
            told: dict[str, Array] = {}
            for name, rule in STARTS.items():
                try:
                    with mock.patch.object(averages, "_steady_start", rule):
                        steady = finished.until(end)
                    made = field_of(plan, steady)
                except DataError:  # too few segments, or the filling still changes too fast
                    continue
                averaged = sum(one.duration for one in steady) / (end - begun)
                told[name] = np.r_[averaged, judge(made)]
            found.append(told)
            yield [folder.name, f"{end:.1f}", *(_ended(told[name]) if name in told else "no field" for name in STARTS)]
    common = [told for told in found if len(told) == len(STARTS)]
    figures = {name: np.array([told[name] for told in common]) for name in STARTS}
    means = [np.r_[one[:, :2].mean(axis=0), np.sqrt((one[:, 2:] ** 2).mean(axis=0))] for one in figures.values()]
    yield ["all", f"{len(common)} ends", *map(_ended, means)]
    yield ["fields", f"of {len(found)}", *(str(sum(name in told for told in found)) for name in STARTS)]


def after(folders: Sequence[Path]) -> Iterator[list[str]]:
    """Rows: diameters of travel that are left out after the faster start at least; ends of runs that give a field;
    independent blocks, statistical error as told and difference from the reference, as root mean squares over the ends
    at which all of them give one, and of the sooner half of these.
    """
    reference = read_run(REFERENCE)
    found: dict[tuple[Path, float], dict[float, Array]] = {}
    for folder in folders:
        plan, production = _finished(folder)
        judge, dem = _judge(reference, plan), plan.dem
        started = dem.start_segments * dem.segment_steps * dem.time_step
        travel = dem.plate_speed * dem.segment_steps * dem.time_step / dem.classes.sauter_diameter
        stop = FinishedRun(plan, (production,)).segments[-1].stop
        for share, left_out in product(SHARES, LEFT_OUT):
            begins = dem.start_segments + math.ceil(left_out / travel - 1e-9)
            changed = replace(plan, settings=replace(dem, segments_left_out=begins))
            finished = FinishedRun(changed, (production,))
            try:
                made = field_of(changed, finished.until(started + share * (stop - started)))
            except DataError:  # too few segments, or the filling still changes too fast
                continue
            found.setdefault((folder, share), {})[left_out] = judge(made)
    common = {at: told for at, told in found.items() if len(told) == len(LEFT_OUT)}
    sooner = [told for (_, share), told in common.items() if share < SHARES[2]]
    for left_out in LEFT_OUT:
        given = sum(left_out in told for told in found.values())
        rows = (_root_mean([told[left_out] for told in some]) for some in (list(common.values()), sooner))
        yield [f"{left_out:g} d", f"{given} of {len(folders) * len(SHARES)}", *rows]


def _judge(reference: EarlierRun, plan: Plan) -> Callable[[Average], Array]:
    """What tells of an average its independent blocks, its statistical error and its difference from the reference."""
    truth = reference.at(plan.case, plan.grid, plan.outline.inside_fraction(plan.grid))
    diameter = max(plan.dem.classes.sauter_diameter, reference.plan.dem.classes.sauter_diameter)

    def judge(made: Average) -> Array:
        off = compare(truth, made.field, plan.case.outline.levels, diameter)[0].observed
        return np.array([made.blocks, made.errors(plan.case)["whole"], off])

    return judge


def _root_mean(figures: Sequence[Array]) -> str:
    blocks, noise, off = np.sqrt(np.mean(np.square(figures), axis=0))
    return f"{blocks:.0f}, {noise:.2%}, {off:.2%} ({len(figures)} ends)"


def _ended(figures: Array) -> str:
    averaged, blocks, noise, off = figures
    return f"{averaged:.0%}, {blocks:.0f}, {noise:.1%}, {off:.1%}"


def _finished(folder: Path) -> tuple[Plan, Production]:
    """The plan of a finished run that finds its start, and its production in the store beside its results."""
    plan = make_plan(read_case(folder / "case.yaml", {"homogenize.start": "auto"}).case, 1)
    store = Store(next(above / ".store" for above in folder.parents if (above / ".store").is_dir()))
    versions = library_versions() | program_versions(store.root / "programs.json")
    return plan, finished_productions(plan, store, versions)[0]


def _averaged(
    plan: Plan, segments: list[Sums], rule: Callable[[list[Sums], Plan], float]
) -> tuple[list[Sums], AveragedField]:
    """What is averaged from the start that a rule finds, and its field."""
    with mock.patch.object(averages, "_steady_start", rule):
        steady = steady_segments(segments, plan)
    return steady, averaged_field(plan.case, plan.outline, steady, plan.dem.classes.sauter_diameter)


if __name__ == "__main__":
    main()
