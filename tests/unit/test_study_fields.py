"""Shorter averages and larger cells from the segments of a run that is done, and the time that they take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from fakes.records import SETTLED, segment
from fakes.sums import NOTHING

from granpipe.case.reader import load_case
from granpipe.planning.make import make_plan
from granpipe.study.fields import FinishedRun


@dataclass
class Segment:
    run: int
    start: float
    stop: float


@dataclass
class Chain:
    """A production that only knows its clock."""

    run: int
    settled: Path
    wall: list[float]

    def sums(self):
        return (Segment(self.run, float(number), number + 1.0) for number in range(len(self.wall)))

    def reports(self):
        return [segment(processor_seconds=seconds) for seconds in self.wall]


@pytest.fixture
def settled(tmp_path: Path) -> Path:
    SETTLED.write(tmp_path)
    return tmp_path


def finished(*chains: Chain) -> FinishedRun:
    return FinishedRun(plan=None, productions=chains)  # type: ignore[arg-type]


def test_the_clock_goes_on_where_production_was_resumed(settled: Path) -> None:
    made = finished(Chain(0, settled, [10.0, 20.0, 5.0, 15.0]))
    assert made.clocks[0].tolist() == [13, 23, 28, 38]
    assert made.seconds(2.0) == 23
    assert made.seconds(3.0) == 28
    assert made.seconds(np.inf) == 38


def test_of_replicas_the_slowest_counts_and_every_core(settled: Path) -> None:
    made = finished(Chain(0, settled, [10.0, 20.0]), Chain(1, settled, [11.0, 30.0]))
    assert made.seconds(1.0) == 14
    assert made.seconds(np.inf) == 33
    assert made.cores == 2


def test_averages_are_shortened_by_a_fifth_until_they_have_no_error_bar(settled: Path) -> None:
    made = finished(Chain(0, settled, [float(n) for n in range(1, 41)]))
    assert made.ends == [40, 32, 25, 20, 16, 13, 10]
    short = finished(Chain(0, settled, [float(n) for n in range(1, 11)]))
    assert short.ends == [10, 8]


def test_a_run_with_the_time_of_a_shorter_average_ends_where_that_does(tiny: Path) -> None:
    changes = {"dem.start_speed": "auto", "outline.wall": "[[6, 30], [6, 0]]", "dem.max_time": "3 s"}
    plan = make_plan(load_case(tiny, changes))
    segment = plan.dem.segment_steps * plan.dem.time_step
    assert plan.dem.start_segments > 1
    for count in (plan.dem.segments_left_out + 12, plan.dem.segments):
        time = FinishedRun(plan, ()).max_time(count * segment)
        assert make_plan(load_case(tiny, changes | {"dem.max_time": f"{time:.4g} s"})).dem.segments == count


def test_a_study_tells_solids_of_rigid_particles_as_a_run_does(tiny: Path) -> None:
    """A mean overlap of 3 % over both chains: volumes and flows are (1 − 0.03)³ of the sums."""
    plan = make_plan(load_case(tiny, {"homogenize.start": "0 s"}))

    class Soft(Chain):
        def sums(self):
            return (
                replace(NOTHING, run=self.run, start=float(number), stop=number + 1.0, flow_z=NOTHING.flow_z - 2.0)
                for number in range(len(self.wall))
            )

        def reports(self):
            return [segment(reference_overlap=0.02 + 0.02 * self.run) for _ in self.wall]

    chains = Soft(0, tiny, [1.0, 2.0]), Soft(1, tiny, [1.0, 2.0])
    told = FinishedRun(plan=plan, productions=chains).until(np.inf)  # type: ignore[arg-type]
    assert len(told) == 4
    for sums in told:
        np.testing.assert_allclose(sums.flow_z, -2 * 0.97**3)
