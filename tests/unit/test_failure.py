"""A run whose segments give no field: what it was, in numbers, from flows that are known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.dem.health import ArchError
from granpipe.homogenize.average import Sums
from granpipe.pipeline.failure import NoFieldError, held_up, no_field, time_needed
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan

SEGMENTS, DURATION = 30, 0.1
PACKING = 0.58


@pytest.fixture
def plan(tiny: Path) -> Plan:
    wall = {"outline.wall": "[[6, 40], [6, 20], [5.2, 16], [5.2, 0]]", "dem.max_time": "3 s"}
    return make_plan(load_case(tiny, wall))


def segments(plan: Plan, share: np.ndarray, full: float = 1.0) -> list[Sums]:
    """Segments (n, nz+1) whose levels carry these shares of the plate's flow; the top holds `full` at the end."""
    grid, rows = plan.grid, plan.grid.shape[0]
    speed = plan.dem.inlet_speed * plan.outline.inlet_radius**2 / grid.r_edges[-1] ** 2
    flow = PACKING * plan.dem.inlet_speed * np.pi * plan.outline.inlet_radius**2
    found = []
    for number, levels in enumerate(share):
        volume = PACKING * np.broadcast_to(grid.cell_volume, grid.shape) * DURATION
        top = np.linspace(1, full, len(share))[number]
        volume = np.where((grid.z_edges[:-1] > 0.36)[:, None], top, 1.0) * volume
        flux = -PACKING * speed * levels[:, None] * np.ones((1, grid.shape[1])) * DURATION * grid.ring_area
        gain = (levels[1:] - levels[:-1]) * flow * DURATION
        found.append(
            Sums(
                grid=grid, sampling="displacement", start=number * DURATION, stop=(number + 1) * DURATION,
                duration=DURATION, weight=DURATION, volume=volume, flow_r=np.zeros((rows, grid.shape[1] + 1)),
                flow_z=flux, gain=np.repeat(gain[:, None] / grid.shape[1], grid.shape[1], axis=1),
                time=np.array([(number + 0.5) * DURATION]), level_flow=flow * levels[None],
                solids=np.array([1.0]), kinetic=np.array([1.0]), count=np.array([1]),
            )
        )  # fmt: skip
    return found


def story(plan: Plan, share: np.ndarray, full: float = 1.0) -> NoFieldError:
    return no_field("the reason", plan, (), segments(plan, share, full))


def test_an_arch_is_told_with_its_place_and_its_time(plan: Plan) -> None:
    share = np.ones((SEGMENTS, len(plan.grid.z_edges)))
    share[10:, plan.grid.z_edges > 0.16] = 0.01
    error = story(plan, share)
    assert error.story.cause == "arch"
    assert "since 1 s" in str(error)
    z = float(re.search(r"z = ([\d.]+) m", str(error)).group(1))  # type: ignore[union-attr]
    assert z == pytest.approx(0.16, abs=2 * plan.grid.cell)


def test_a_feed_that_does_not_keep_up_is_told_with_a_slower_plate(plan: Plan) -> None:
    error = story(
        plan, np.full((SEGMENTS, len(plan.grid.z_edges)), 1.0) * np.linspace(1, 0.6, len(plan.grid.z_edges)), 0.3
    )
    assert error.story.cause == "feed"
    slower = float(re.search(r"plate_speed of ([\d.e-]+)", str(error)).group(1))  # type: ignore[union-attr]
    assert slower == pytest.approx(0.6 * plan.dem.plate_speed, rel=0.05)


@pytest.mark.parametrize("rate", [0.3, 1.0])
def test_a_short_run_is_told_the_time_after_which_what_gathers_is_a_tenth_of_the_flow(plan: Plan, rate: float) -> None:
    """What gathers below the top decays as e^(−rate t): on average over the second half of T it is a tenth at T."""
    t = (np.arange(SEGMENTS) + 0.5) * DURATION
    z = plan.grid.z_edges / plan.grid.z_edges[-1]
    share = 1 + 0.8 * np.exp(-rate * t)[:, None] * z
    found = segments(plan, share)
    error = no_field("the reason", plan, (), found)
    assert error.story.cause == "short"
    told = time_needed(found, error.story.levels)
    later = np.linspace(told / 2, told, 1000)
    assert float(np.mean(0.8 * np.exp(-rate * later))) <= 0.1
    assert told < 4 * (np.log(8) / rate)
    advised = float(re.search(r"max_time: ([\d.]+) s", str(error)).group(1))  # type: ignore[union-attr]
    assert advised > SEGMENTS * DURATION


def test_a_run_that_was_stopped_at_an_arch_keeps_what_was_seen_and_since_when(plan: Plan) -> None:
    share = np.ones((SEGMENTS, len(plan.grid.z_edges)))
    share[12:, plan.grid.z_edges > 0.19] = 0.0
    error = ArchError("nothing has passed the throat", "an arch; use smaller particles", 0.2)
    error.evidence = Path("somewhere")
    told = held_up(error, plan, (), segments(plan, share))
    assert told.story.cause == "arch"
    assert str(told) == (
        "nothing has passed the throat; an arch; use smaller particles; hardly any pass it since 1.2 s\n"
        "evidence: somewhere"
    )
    assert told.story.levels.late[-1] < 0.1
