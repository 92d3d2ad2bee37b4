"""When the average of a run in progress is good enough: the convergence criterion of a case."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import level_flow
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import gathered_flow
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import AveragedField, steady_segments
from granpipe.pipeline.gates import SEGMENTS, Gate, error_gates, level_flow_gates, missing_time
from granpipe.pipeline.space_average import averaged_of
from granpipe.planning.plan import Plan


@dataclass(frozen=True)
class Convergence:
    """How good the average of a run in progress is.

    Parameters
    ----------
    errors : section → statistical error of the final field, the whole included; empty while it is not known
    reached : the criterion is met: no run need go on
    missing : simulated time [s] that is still missing, for all replicas together; None if it is not known
    """

    errors: dict[str, float] = field(default_factory=dict)
    reached: bool = False
    missing: float | None = None

    def __str__(self) -> str:
        if not self.errors:
            return "error not known yet"
        sections = ", ".join(f"{name} {100 * e:.2g}" for name, e in self.errors.items() if name != "whole")
        return f"error {100 * self.errors['whole']:.2g} % ({sections})"


Criterion = Callable[[Sequence[Sums]], Convergence]
"""Sums of all segments so far → how good their average is."""


class RunningAverage:
    """The sums that the replicas of a case have made so far, and how good their average is.

    The criterion takes a second: it is evaluated when there are a certain share more segments than at the last time, a
    larger one where no target can end the run and the error is only shown.
    """

    def __init__(self, criterion: Criterion, sums: Sequence[Sums], *, target: bool) -> None:
        self._criterion, self._sums, self._next = criterion, list(sums), 0.0
        self._more = 1.08 if target else 1.5
        self.convergence = Convergence()

    def add(self, sums: Sums) -> None:
        """Add a new segment of one of the runs."""
        self._sums.append(sums)
        self.evaluate()

    def replace(self, run: int, sums: Iterator[Sums]) -> None:
        """Replace the sums of one of the runs: a damaged segment may have been dropped."""
        self._sums = [one for one in self._sums if one.run != run] + list(sums)

    def evaluate(self) -> None:
        """Evaluate the criterion, if there are enough more segments than before."""
        if len(self._sums) >= self._next:
            self._next = self._more * len(self._sums)
            self.convergence = self._criterion(self._sums)

    @property
    def reached(self) -> bool:
        """The criterion is met: no run need go on."""
        return self.convergence.reached


def average_gates(case: Case, averaged: AveragedField, steady: Sums, diameter: float) -> list[Gate]:
    """The gates that a longer average can pass; `diameter` is that of the particles [m]."""
    field, plug, target = averaged.field, averaged.plug, case.dem.statistical_error
    assert field.raw_flux_z is not None
    gates = level_flow_gates(
        level_flow(field.raw_flux_z, field.grid) + averaged.left,
        gathered_flow(steady, plug.z_range),
        plug.solids_flow,
        steady.duration,
    )
    if (blocks := averaged.figures.get("blocks")) is not None:
        gates.append(SEGMENTS.gate(blocks))
    if target is not None:
        errors, effective = averaged.figures.get("statistical_error", {}), averaged.figures["effective_blocks"]
        travel = widest_level_travel(averaged, steady, diameter)
        gates += error_gates(errors, effective, travel, target, steady.duration)
    return gates


def widest_level_travel(averaged: AveragedField, steady: Sums, diameter: float) -> float:
    """How far the level that holds the most solids went during the average, in particle diameters [m]."""
    area = steady.mean_volume.reshape(len(steady.mean_volume), -1).sum(axis=1).max() / steady.grid.cell
    return float(averaged.plug.solids_flow * steady.duration / (area * diameter))


class StatisticalErrorCriterion:
    """The convergence criterion of a case: `dem.statistical_error` in every section, and the gates of an average."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def __call__(self, sums: Sequence[Sums]) -> Convergence:
        """How good the average of the segments so far is."""
        plan = self._plan
        if len(sums) < LEAST_BLOCKS or plan.case.homogenize.method == "gaussian":
            return Convergence()
        try:
            steady = steady_segments(sums, plan)
            averaged = averaged_of(plan, steady)
        except DataError:
            return Convergence()  # no flow at some level yet, or the filling still changes too fast
        target, errors = plan.case.dem.statistical_error, averaged.figures.get("statistical_error", {})
        if target is None or not errors:
            return Convergence(errors)
        whole, diameter = merge(steady), plan.dem.classes.sauter_diameter
        reached = all(gate.passed for gate in average_gates(plan.case, averaged, whole, diameter))
        effective = averaged.figures["effective_blocks"]
        travel = widest_level_travel(averaged, whole, diameter)
        return Convergence(errors, reached, missing_time(errors, effective, travel, target, whole.duration))
