"""Onset of the steady state, blocks and standard errors, on series whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.sums import NOTHING
from scipy import stats
from scipy.signal import lfilter

from granpipe.errors import DataError
from granpipe.field import Box, Grid
from granpipe.homogenize.assemble import raw_field, with_standard_errors
from granpipe.homogenize.average import Collector, merge
from granpipe.homogenize.conserve import Plug
from granpipe.homogenize.statistics import (
    blocks,
    effective_samples,
    errors_in_space,
    local_effective_samples,
    off_centre,
    onset,
    standard_error,
    trend,
    turnovers,
)


def autoregressive(rng, count, memory):
    series = np.zeros(count)
    for at in range(1, count):
        series[at] = memory * series[at - 1] + rng.normal() * np.sqrt(1 - memory**2)
    return series


def begins(series, more=0.0):
    """Onset of a series, or of several that count by their size."""
    values = np.reshape(series, (len(series), -1))
    return onset(values @ values.T, more)


def test_a_steady_series_is_kept_nearly_whole():
    rng = np.random.default_rng(0)
    left_out = [begins(autoregressive(rng, 400, 0.5)) for _ in range(50)]
    assert np.median(left_out) <= 40


@pytest.mark.parametrize("end", [50, 100, 150])
def test_what_a_ramp_leaves_behind_is_within_the_error_of_the_mean(end):
    rng = np.random.default_rng(end)
    ramp = np.clip(10 * (1 - np.arange(400) / end), 0, None)
    begun = [begins(autoregressive(rng, 400, 0.3) + ramp) for _ in range(40)]
    bias = np.array([ramp[at:].mean() for at in begun])
    error = np.array([np.sqrt(1.3 / 0.7 / (400 - at)) for at in begun])
    assert np.sqrt((bias**2).mean()) < 1.3 * np.sqrt((error**2).mean())
    assert np.median(begun) < end + 40


@pytest.mark.parametrize("transient", [(0.0, 1.0), (2.0, 10.0), (5.0, 20.0)])
@pytest.mark.parametrize("process", [(0.0, 0.0), (0.8, 0.0), (1.06, -0.7225)], ids=["white", "slow", "bursts"])
def test_from_the_onset_on_intervals_hold_the_known_mean(process, transient):
    """AR(2) series with the mean 0 and a decaying transient: nominal 95 % intervals of what is left."""
    rng = np.random.default_rng(7)
    held, kept, count = [], [], 160
    for _ in range(30):
        series = lfilter([1.0], [1.0, -process[0], -process[1]], rng.normal(size=(count + 200, 6)), axis=0)[200:]
        decay = np.exp(-np.arange(count) / transient[1])[:, None]
        series = series + transient[0] * series.std(axis=0) * decay * rng.uniform(-1.5, 1.5, 6)
        left = series[begins(series) :]
        effective = min(effective_samples(left, np.zeros(len(left), dtype=int)), len(left))
        width = stats.t.ppf(0.975, effective / 3) * standard_error(left, effective)
        held.append((np.abs(left.mean(axis=0)) <= width).mean())
        kept.append(len(left) / count)
    assert np.mean(held) >= 0.92
    assert np.mean(kept) >= (0.85 if transient[0] == 0 else 0.6)


def test_a_transient_decides_where_it_is_a_large_part_of_the_error():
    rng = np.random.default_rng(1)
    early, late = rng.normal(size=(2, 400))
    late = late + 20 * np.exp(-np.arange(400) / 40)
    assert begins(early) < 60
    assert begins(np.stack([early, late], axis=1)) > 100
    assert begins(np.stack([100 * early, late], axis=1)) < 60


def test_the_unit_of_a_series_and_what_never_changes_do_not_matter():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(300, 8))
    rows[:80] += 5
    still = np.full((300, 1), 1e3)
    assert begins(np.concatenate([rows, still], axis=1)) == begins(1e-9 * rows) == begins(rows)
    assert begins(rows) == pytest.approx(80, abs=10)


def test_never_more_than_half_is_left_out():
    assert begins(np.arange(200.0)) <= 100
    assert begins(np.r_[np.zeros(190), np.ones(10) * 50]) <= 100


def test_what_else_adds_to_the_error_of_a_mean_counts_beside_its_noise():
    rng = np.random.default_rng(3)
    steady = rng.normal(size=400)  # the mean of all has a squared error of 1/400
    little, much = (np.where(np.arange(400) == 100, 0.0, size) for size in (1e-5, 1e-2))
    assert begins(steady, little) < 40
    assert begins(steady, much) == 100


def test_nothing_is_left_out_where_nothing_changes():
    assert begins(np.ones((40, 3))) == 0


def test_a_short_series_is_kept():
    assert begins(np.array([5.0, 1.0, 1.0])) == 0


def segments(values):
    return [
        replace(NOTHING, start=float(at), stop=at + 1.0, volume=np.full((2, 2), value))
        for at, value in enumerate(values)
    ]


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


@pytest.mark.parametrize(("memory", "count"), [(0.0, 30), (0.3, 30), (0.6, 60)])
def test_effective_samples_of_a_series_with_memory_are_what_its_correlation_says(memory, count):
    # the variance of the mean of n values with memory m: (1 + 2 Σ (1 − k/n) mᵏ)/n
    rng = np.random.default_rng(4)
    lag = np.arange(1, count)
    true = count / (1 + 2 * ((1 - lag / count) * memory**lag).sum())
    warmed = [[autoregressive(rng, count + 50, memory)[50:] for _ in range(40)] for _ in range(60)]
    counted = [effective_samples(np.array(columns).T, np.zeros(count, dtype=int)) for columns in warmed]
    assert 1 / np.mean(1 / np.array(counted)) == pytest.approx(true, rel=0.1)  # variances go with the inverse


def moving(rng, count, columns, weights):
    """(count, columns) sums of white noise over the last samples; the variance of their mean is known exactly."""
    noise = rng.normal(size=(count + len(weights) - 1, columns))
    return sum(w * noise[len(weights) - 1 - k : len(weights) - 1 - k + count] for k, w in enumerate(weights))


def variance_of_mean(count, weights):
    """Each white number enters the sum of `count` neighbours by the weights that still reach it."""
    full = np.convolve(np.ones(count), weights)
    return float((full**2).sum()) / count**2


@pytest.mark.parametrize(
    ("weights", "count", "ratio"),
    [
        ([1.0], 8, (0.94, 1.06)),
        ([1.0], 64, (0.96, 1.04)),
        ([1.0, 0.2, -0.15, -0.15, -0.1, -0.1, -0.05], 64, (0.9, 1.04)),  # what flowed too much comes back over 7 lags
        ([1.0, 0.2, -0.15, -0.15, -0.1, -0.1, -0.05], 30, (0.88, 1.04)),
        ([1.0, 0.2, -0.15, -0.15, -0.1, -0.1, -0.05], 10, (0.6, 1.0)),  # too short to see all: on the safe side
        ([1.0, 1.0, 1.0, 1.0], 64, (0.94, 1.06)),
        ([1.0, -0.5], 64, (0.85, 1.04)),
    ],
)
def test_errors_of_series_with_any_memory_are_those_of_their_mean(weights, count, ratio):
    """Scatter over claimed error, and how often the 95 % interval holds the mean, which is 0; 12 places alike."""
    rng, claimed, held = np.random.default_rng(11), [], []
    for _ in range(150):
        values = moving(rng, count, 12, weights)
        effective = effective_samples(values, np.zeros(count, dtype=int))
        error = standard_error(values, effective)
        claimed.append(np.mean(error**2))
        held.append(np.abs(values.mean(axis=0)) <= stats.t.ppf(0.975, min(effective, count) - 1) * error)
    found = np.sqrt(variance_of_mean(count, weights) / np.mean(claimed))
    assert ratio[0] <= found <= ratio[1]
    assert 0.93 <= np.mean(held) <= (0.97 if ratio[0] > 0.87 else 1.0)


def test_a_plain_average_claims_no_noise_that_flows_back():
    """Dumps without a vessel: flux whose noise comes back over seven segments, the same through all faces."""
    rng, weights, count = np.random.default_rng(12), [1.0, 0.2, -0.15, -0.15, -0.1, -0.1, -0.05], 64
    grid, told = NOTHING.grid, []
    for _ in range(60):
        noise = moving(rng, count, 1, weights)[:, 0]
        parts = [
            replace(part, flow_z=(value - 5) * part.weight * grid.ring_area + np.zeros((3, 2)))
            for part, value in zip(segments(np.ones(count)), noise, strict=True)
        ]
        plug, inside = Plug(0.6, 1.0, 0.0, (0.0, 0.1)), np.ones(grid.shape)
        told.append(with_standard_errors(raw_field(merge(parts), inside, plug, 0.05), parts, 0.05).flux_z_se[1, 1])
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(np.sqrt(variance_of_mean(count, weights)), rel=0.15)


def test_local_effective_samples_are_those_of_each_place():
    # left without memory, right with one of 0.6: a single time for both is wrong for either
    rng, count = np.random.default_rng(8), 60
    lag = np.arange(1, count)
    counted = []
    for _ in range(12):
        places = [[autoregressive(rng, count + 50, 0.6 * (at >= 10))[50:] for at in range(20)] for _ in range(12)]
        values = np.array(places).transpose(2, 0, 1)
        local = local_effective_samples(values, np.zeros(count, dtype=int), 2.0)
        counted.append([local[:, :6].mean(), local[:, 14:].mean()])
    slow = count / (1 + 2 * ((1 - lag / count) * 0.6**lag).sum())
    assert np.median(counted, axis=0) == pytest.approx([count, slow], rel=0.12)


def test_local_and_common_effective_samples_are_the_same_for_one_place():
    values = autoregressive(np.random.default_rng(9), 60, 0.5)
    run = np.repeat([0, 1], 30)
    local = local_effective_samples(values[:, None, None], run, 1.0)
    assert local == pytest.approx(effective_samples(values[:, None], run), rel=1e-9)


@pytest.mark.parametrize("count", [7, 8, 10, 33, 120])
def test_series_that_go_back_at_once_count_more_than_their_samples(count):
    """Alternating ones, and ones that step up and down over some samples, if many: their means are known well."""
    run, ramp = np.zeros(count, dtype=int), np.resize([2.0, 1.0, -1.0, -2.0], count)
    assert effective_samples(np.resize([1.0, -1.0], count)[:, None], run) > count
    assert effective_samples(ramp[:, None], run) > count or count < 8


def test_what_never_moves_counts_every_sample():
    assert local_effective_samples(np.ones((20, 3, 4)), np.zeros(20, dtype=int), 1.0) == pytest.approx(20)


def test_samples_of_different_runs_are_not_neighbours():
    rng = np.random.default_rng(6)
    values = np.concatenate([rng.normal(size=(20, 60)) + level * np.ones(60) for level in (0, 3)])
    swapped = np.argsort(np.arange(40) % 20, kind="stable")
    assert effective_samples(values, np.zeros(40, dtype=int)) < 0.2 * 40
    assert effective_samples(values[swapped], np.arange(40)) == pytest.approx(40)


def test_the_standard_error_of_few_effective_samples_is_that_of_so_many():
    values = np.repeat(np.random.default_rng(7).normal(size=25), 8)
    assert standard_error(values, 25) == pytest.approx(standard_error(values[::8]), rel=1e-12)


def test_the_standard_error_of_five_numbers_is_that_of_the_textbook():
    """1 … 5: the sample's standard deviation √2.5 over √5."""
    assert standard_error(np.arange(1.0, 6)) == pytest.approx(np.sqrt(0.5))


def test_blocks_never_join_two_runs():
    parts = [replace(part, run=run) for run in (1, 0) for part in segments(range(10))]
    made = blocks(parts)
    assert [block.run for block in made] == sorted(block.run for block in made)
    assert len(made) == 10
    assert {block.weight for block in made} == {2}


def test_a_trend_is_told_from_noise():
    rng = np.random.default_rng(5)
    false = np.mean([trend(rng.normal(size=12)).p_value < 0.05 for _ in range(400)])
    assert 0.02 < false < 0.09
    values = rng.normal(size=9)
    assert trend(values).p_value == pytest.approx(stats.linregress(np.arange(9), values).pvalue, rel=1e-10)
    found = trend(3 * np.arange(12) / 11 + 0.1 * rng.normal(size=12))
    assert found.change == pytest.approx(3, abs=0.3)
    assert found.p_value < 1e-6


def test_a_straight_line_changes_by_what_lies_between_its_ends():
    assert trend(7 + 3 * np.arange(12) / 11).change == pytest.approx(3, rel=1e-9)


class Wreath:
    """36 spheres on a circle that fall at 0.1 (1 + a cos(θ − 0.7) + 0.2 cos(2θ + 0.3)) m/s and turn."""

    def __init__(self, lean, spin):
        angle = 2 * np.pi * np.arange(36) / 36
        self.id, self.radius = np.arange(36), np.full(36, 0.01)
        self.position = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), np.full(36, 0.2)])
        w = -0.1 * (1 + lean * np.cos(angle - 0.7) + 0.2 * np.cos(2 * angle + 0.3))
        self.velocity = np.column_stack([-spin * np.sin(angle), spin * np.cos(angle), w])


def test_amplitudes_swirl_and_errors_of_a_wreath_are_exact():
    """A lean of 0.2 and 0.4, a turn of 0.01 and 0.03 m/s in turns, ten times: errors are half the difference over √9;
    that of an amplitude is the root mean square of two components, over which the lean's phase spreads it."""
    collector, parts = Collector(Grid.covering(0.2, 0.0, 0.4, 0.1)), []
    for number in range(10):
        collector.add(float(number), Wreath(*((0.2, 0.01), (0.4, 0.03))[number % 2]))
        parts.append(collector.take())
    found = off_centre(parts, (0.0, 0.4))
    np.testing.assert_allclose(found.amplitude, [0.3, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found.amplitude_se, [0.1 / 3 / np.sqrt(2), 0], rtol=1e-6, atol=1e-9)
    assert found.swirl == pytest.approx(0.2, rel=1e-6)
    assert found.swirl_se == pytest.approx(0.1 / 3, rel=1e-6)


def test_a_column_that_sinks_is_renewed_as_often_as_its_flow_says():
    """In 3 s 0.05 m/s of solids flux leave a column of 0.1 m with a packing of 0.6: 2.5 times; its upper half 5."""
    volume, flow = 0.6 * NOTHING.grid.cell_volume + np.zeros((2, 2)), -0.05 * NOTHING.grid.ring_area + np.zeros((3, 2))
    column = replace(NOTHING, weight=4.0, duration=3.0, volume=4 * volume, flow_z=4 * flow)
    assert turnovers(column, (0.0, 0.1)) == pytest.approx(2.5)
    assert turnovers(column, (0.05, 0.1)) == pytest.approx(5)


class Rain:
    """Spheres spread over a cylinder that fall at a speed depending on their angle, and turn about the axis."""

    def __init__(self, seed, lean=0.0, lobes=0.0, spin=0.0):
        rng = np.random.default_rng(seed)
        count = 4000
        r, angle = 0.2 * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
        self.id = np.arange(count)
        self.radius = np.full(count, 0.01)
        self.position = np.column_stack([r * np.cos(angle), r * np.sin(angle), rng.uniform(-0.05, 0.45, count)])
        w = -0.1 * (1 + lean * np.cos(angle - 0.7) + lobes * np.cos(2 * angle + 0.3))
        self.velocity = np.column_stack([-spin * np.sin(angle), spin * np.cos(angle), w])


def rained(**asymmetry):
    collector, parts = Collector(Grid.covering(0.2, 0.0, 0.4, 0.1)), []
    for number in range(10):
        collector.add(float(number), Rain(number, **asymmetry))
        parts.append(collector.take())
    return parts


def test_lean_lobes_and_swirl_are_told_with_their_errors():
    found = off_centre(rained(lean=0.3, lobes=0.2, spin=0.02), (0.0, 0.4))
    assert (np.abs(found.amplitude - [0.3, 0.2]) < 4 * found.amplitude_se).all()
    assert abs(found.swirl - 0.2) < 4 * found.swirl_se + 1e-3
    assert (found.amplitude_se < 0.02).all()


def test_symmetric_flow_has_amplitudes_of_the_size_of_their_errors():
    found = off_centre(rained(), (0.1, 0.3))
    assert (found.amplitude < 4 * found.amplitude_se).all()
    assert abs(found.swirl) < 1e-12


def test_turnovers_count_how_often_the_filling_is_renewed():
    # 0.1 m/s through 0.4 m for 9 s: 2.25 times, for the lower half twice that
    whole = merge(rained())
    assert turnovers(whole, (0.0, 0.4)) == pytest.approx(9 * 0.1 / 0.4, rel=0.1)
    assert turnovers(whole, (0.0, 0.2)) == pytest.approx(9 * 0.1 / 0.2, rel=0.1)
    with pytest.raises(DataError, match="no row"):
        turnovers(whole, (0.5, 0.6))


def of_faces_in_space(memory: float, level: float, rng: np.random.Generator) -> list[tuple[np.ndarray, ...]]:
    """36 samples of noise about `level` through the faces of 8³ cells; few particles make it lumpy, half is at rest."""
    count, faces = 36, 8 * 8 * 9
    noise = rng.normal(size=(count + 50, 3, faces))
    for at in range(1, count + 50):
        noise[at] = memory * noise[at - 1] + noise[at] * np.sqrt(1 - memory**2)
    lumps = np.where(np.abs(noise[50:]) > 1.2, noise[50:], 0.0)
    lumps[:, :, ::5] = 0.0  # closed
    return [(level + x.reshape(8, 8, 9), level + y.reshape(8, 9, 8), level + z.reshape(9, 8, 8)) for x, y, z in lumps]


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_intervals_in_space_hold_the_truth_where_few_particles_pass_a_face(memory):
    rng, run, grid = (
        np.random.default_rng(11),
        np.zeros(36, dtype=int),
        Box.within((0, 8), (0, 8), (0, 8), 1.0, flat=False, cut=True),
    )
    held = []
    for _ in range(4):
        samples = of_faces_in_space(memory, 0.3, rng)
        errors, effective = errors_in_space(samples, run, grid, 2.0)
        reach = stats.t.ppf(0.975, effective - 1)
        for error, values in zip(errors, zip(*samples, strict=True), strict=True):
            opened = error > 0
            held.append((np.abs(np.mean(values, axis=0) - 0.3) <= reach * error)[opened].mean())
            assert opened.mean() == pytest.approx(0.8, abs=0.01)  # nothing is known of noise where nothing moves
    assert 0.93 < np.mean(held) < 0.98


def test_slow_and_wide_motion_counts_for_few_samples_at_every_face():
    rng, run, grid = (
        np.random.default_rng(12),
        np.zeros(36, dtype=int),
        Box.within((0, 8), (0, 8), (0, 8), 1.0, flat=False, cut=True),
    )
    slow = np.sin(2 * np.pi * np.arange(36) / 36)[:, None, None, None]
    noise = [
        rng.normal(size=(36, *shape)) * np.linspace(0.2, 3, shape[2]) for shape in ((8, 8, 9), (8, 9, 8), (9, 8, 8))
    ]
    (_, _, still), alone = errors_in_space(list(zip(*noise, strict=True)), run, grid, 2.0)
    (_, _, moving), together = errors_in_space(
        list(zip(noise[0], noise[1], noise[2] + 3 * slow, strict=True)), run, grid, 2.0
    )
    assert together < 0.4 * alone
    assert (moving > 1.3 * still).all()
