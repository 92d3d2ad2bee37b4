"""Where the average of a run with a faster start begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fakes.sums import NOTHING

from granpipe.case.reader import load_case
from granpipe.errors import DataError
from granpipe.field import Box, Grid
from granpipe.homogenize.average import Sums
from granpipe.homogenize.psi_field import MOST_STORAGE
from granpipe.pipeline.averages import after_transient
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan


def faster(tiny: Path, start: str) -> Plan:
    return make_plan(
        load_case(tiny, {"outline.wall": "[[6, 30], [6, 0]]", "dem.start_speed": "auto", "homogenize.start": start})
    )


def segments_of(plan: Plan, count: int, run: int = 0) -> list[Sums]:
    """Segments of a steady bed, flow and all, whatever the plate did in them."""
    length = plan.dem.segment_steps * plan.dem.time_step
    steady = replace(NOTHING, level_flow=np.ones((1, 3)), run=run, duration=length)
    return [replace(steady, start=n * length, stop=(n + 1) * length, time=np.array([n * length])) for n in range(count)]


def flowing(plan: Plan, flows: Sequence[float], gains: Sequence[float], seed: int = 0) -> list[Sums]:
    """Segments after a faster start, with these flows downwards, under noise, and what gathered in each [m³]."""
    rng, grid = np.random.default_rng(seed), Grid.covering(0.2, 0.0, 0.4, 0.02)
    nz, nr = grid.shape
    left_out = plan.dem.segments_left_out
    made = segments_of(plan, left_out + len(flows))[left_out:]
    return [
        replace(
            one,
            grid=grid,
            flow_r=np.zeros((nz, nr + 1)),
            flow_z=-flow * grid.ring_area * rng.normal(1.0, 0.2, (nz + 1, nr)),
            volume=np.zeros((nz, nr)),
            level_flow=np.full((1, nz + 1), flow * grid.ring_area.sum()),
            gain=np.full((nz, nr), gain / (nz * nr)),
        )
        for one, flow, gain in zip(made, flows, gains, strict=True)
    ]


def test_flow_that_is_not_yet_that_of_the_rest_is_left_out(tiny: Path) -> None:
    plan = faster(tiny, "auto")
    assert len(after_transient(flowing(plan, [1.5] * 9 + [1.0] * 31, [0.0] * 40), plan)) == 31


def test_flow_that_differs_by_less_than_noise_would_grow_is_not_left_out(tiny: Path) -> None:
    plan = faster(tiny, "auto")
    begun = [flowing(plan, [1.01] * 6 + [1.0] * 30, [0.0] * 36, seed) for seed in range(10)]
    assert np.mean([len(after_transient(segments, plan)) for segments in begun]) > 33


def test_an_average_holds_whole_turns_of_bursts_and_rests(tiny: Path) -> None:
    """Solids gather over four segments and leave in the fifth; three more are at the begin."""
    plan = faster(tiny, "auto")
    gathered = 0.5 * np.pi * 0.2**2 * plan.dem.segment_steps * plan.dem.time_step  # half of the flow
    turn = [gathered] * 4 + [-4 * gathered]
    assert len(after_transient(flowing(plan, [1.0] * 28, [*turn[1:4], *turn * 5]), plan)) == 25


def test_a_start_that_gives_no_field_is_not_taken_where_another_gives_one(tiny: Path) -> None:
    """The first six segments flow 5 % faster and lose what gathers in the next twelve, up to 40 %."""
    plan = faster(tiny, "auto")
    through = np.pi * 0.2**2 * plan.dem.segment_steps * plan.dem.time_step  # m³ in a segment
    gains = [-2 * through] * 6 + [through] * 12 + [0.0] * 18
    kept = after_transient(flowing(plan, [1.05] * 6 + [1.0] * 30, gains), plan)
    assert abs(sum(one.gain.sum() for one in kept)) < MOST_STORAGE * through * len(kept)
    assert len(kept) in (36, *range(18, 23))


def test_a_start_after_which_nothing_flows_down_is_not_taken(tiny: Path) -> None:
    """The last half flows up a little: from there alone there would be no field."""
    plan = faster(tiny, "auto")
    kept = after_transient(flowing(plan, [1.0] * 20 + [-0.01] * 20, [0.0] * 40), plan)
    assert len(kept) > 20


@pytest.mark.parametrize("flat", [False, True])
def test_a_vessel_that_is_not_round_has_a_start_as_well(tiny: Path, flat: bool) -> None:
    plan = faster(tiny, "auto")
    grid = Box.within((-0.1, 0.1), (-0.1, 0.1), (0.0, 0.4), 0.02, flat=flat, cut=False)
    cells, rng = np.ones(grid.shape), np.random.default_rng(6)
    faces = {
        "flow_r": np.zeros((*grid.shape[:-1], grid.shape[-1] + 1)),
        "flow_y": None if flat else np.zeros((grid.shape[0], grid.shape[1] + 1, grid.shape[2])),
    }
    after = segments_of(plan, plan.dem.segments_left_out + 30)[-30:]
    made = [
        replace(
            one,
            grid=grid,
            **faces,
            flow_z=-flow * grid.ring_area * rng.normal(1.0, 0.2, (grid.shape[0] + 1, *grid.shape[1:])),
            volume=0 * cells,
            level_flow=np.full((1, grid.shape[0] + 1), flow),
            gain=0 * cells,
        )
        for one, flow in zip(after, [1.5] * 8 + [1.0] * 22, strict=True)
    ]
    assert len(after_transient(made, plan)) == 22


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
