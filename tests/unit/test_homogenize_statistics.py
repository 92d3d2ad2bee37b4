"""Onset of the steady state, blocks and standard errors, on series whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from granpipe.errors import DataError
from granpipe.field import Grid
from granpipe.homogenize.average import Sums
from granpipe.homogenize.statistics import blocks, onset, standard_error


def autoregressive(rng, count, memory):
    series = np.zeros(count)
    for at in range(1, count):
        series[at] = memory * series[at - 1] + rng.normal() * np.sqrt(1 - memory**2)
    return series


def test_a_steady_series_is_kept_nearly_whole():
    rng = np.random.default_rng(0)
    left_out = [onset(autoregressive(rng, 400, 0.5)) for _ in range(50)]
    assert np.median(left_out) <= 40


@pytest.mark.parametrize("end", [50, 100, 150])
def test_a_ramp_at_the_beginning_is_left_out(end):
    rng = np.random.default_rng(end)
    found = []
    for _ in range(20):
        series = autoregressive(rng, 400, 0.3)
        series[:end] += 10 * (1 - np.arange(end) / end)
        found.append(onset(series))
    assert 0.7 * end < np.median(found) < end + 40


def test_the_slowest_of_several_series_decides():
    rng = np.random.default_rng(1)
    early, late = rng.normal(size=(2, 400))
    late = late + 20 * np.exp(-np.arange(400) / 40)
    alone, together = onset(early), onset(early, late)
    assert alone < 60
    assert together > 100


def test_series_of_any_scale_and_width_count_alike():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(300, 8))
    rows[:80] += 5
    assert onset(1e-9 * rows, 1e6 + np.ones(300)) == onset(rows) == 80


def test_never_more_than_half_is_left_out():
    assert onset(np.arange(200.0)) <= 100
    assert onset(np.r_[np.zeros(190), np.ones(10) * 50]) <= 100


def test_a_short_series_is_kept():
    assert onset(np.array([5.0, 1.0, 1.0])) == 0


def segments(values):
    grid = Grid.covering(0.1, 0.0, 0.1, 0.05)
    zero = np.zeros((2, 2))
    base = Sums(
        grid=grid,
        sampling="velocity",
        start=0.0,
        stop=1.0,
        duration=1.0,
        weight=1.0,
        volume=zero,
        flow_r=np.zeros((2, 3)),
        flow_z=np.zeros((3, 2)),
        gain=zero,
        time=np.zeros(1),
        level_flow=np.zeros((1, 3)),
        solids=np.zeros(1),
        kinetic=np.zeros(1),
        count=np.zeros(1),
    )
    return [replace(base, start=float(at), stop=at + 1.0, volume=zero + value) for at, value in enumerate(values)]


@pytest.mark.parametrize(("count", "length", "number"), [(7, 1, 7), (13, 1, 13), (14, 2, 7), (23, 3, 7), (60, 8, 7)])
def test_blocks_are_the_longest_that_leave_seven(count, length, number):
    made = blocks(segments(range(count))[::-1])
    assert len(made) == number
    assert {block.weight for block in made} == {length}
    assert made[-1].stop == count  # what is left over lies at the beginning
    assert [block.start for block in made] == sorted(block.start for block in made)


def test_too_few_segments_give_no_error_bar():
    with pytest.raises(DataError, match="at least 7"):
        blocks(segments(range(6)))


def test_blocks_see_the_error_that_correlated_samples_hide():
    # the mean of n values with memory m of unit variance has the variance (1 + m)/(1 − m)/n, to first order in 1/n
    rng = np.random.default_rng(3)
    runs = [autoregressive(rng, 700, 0.9) for _ in range(60)]
    true = np.sqrt(1.9 / 0.1 / 700)
    naive = np.mean([run.std() / np.sqrt(700) for run in runs])
    told = np.mean([standard_error(np.array([b.mean_volume[0, 0] for b in blocks(segments(run))])) for run in runs])
    assert naive < 0.4 * true
    assert told == pytest.approx(true, rel=0.15)
