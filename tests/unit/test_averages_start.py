"""Where the average of a run with a faster start begins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fakes.sums import NOTHING

from granpipe.case.reader import load_case
from granpipe.errors import DataError
from granpipe.homogenize.average import Sums
from granpipe.pipeline.averages import after_transient
from granpipe.planning.plan import Plan, make_plan


def faster(tiny: Path, start: str) -> Plan:
    return make_plan(
        load_case(tiny, {"outline.wall": "[[6, 30], [6, 0]]", "dem.start_speed": "auto", "homogenize.start": start})
    )


def segments_of(plan: Plan, count: int, run: int = 0) -> list[Sums]:
    """Segments of a steady bed, flow and all, whatever the plate did in them."""
    length = plan.dem.segment_steps * plan.dem.time_step
    steady = replace(NOTHING, level_flow=np.ones((1, 3)), run=run, duration=length)
    return [replace(steady, start=n * length, stop=(n + 1) * length, time=np.array([n * length])) for n in range(count)]


@pytest.mark.parametrize("start", ["auto", "0 s"])
def test_nothing_of_a_faster_start_is_averaged_in_any_of_the_runs(tiny: Path, start: str) -> None:
    plan = faster(tiny, start)
    left_out = plan.dem.segments_left_out
    both = [sums for run in (0, 1) for sums in segments_of(plan, left_out + 5, run)]
    kept = after_transient(both, plan)
    assert len(kept) == 2 * 5
    assert min(sums.start for sums in kept) == pytest.approx(plan.dem.average_from)


def test_a_start_that_the_case_gives_is_counted_from_the_end_of_the_faster_start(tiny: Path) -> None:
    plan = faster(tiny, "0.4 s")
    kept = after_transient(segments_of(plan, plan.dem.segments), plan)
    length = plan.dem.segment_steps * plan.dem.time_step
    assert plan.dem.average_from + 0.4 - 1e-9 <= kept[0].start < plan.dem.average_from + 0.4 + length


def test_a_run_that_did_not_get_beyond_its_faster_start_has_no_average(tiny: Path) -> None:
    plan = faster(tiny, "auto")
    with pytest.raises(DataError, match="no segment begins after the faster start, which ends at"):
        after_transient(segments_of(plan, plan.dem.segments_left_out), plan)
