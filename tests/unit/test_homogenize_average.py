"""Segment sums: what is summed, how segments join, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.spheres import Spheres

from granpipe.errors import DataError
from granpipe.field import Grid
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.homogenize.deposit import deposit

GRID = Grid.covering(0.3, 0.0, 0.4, 0.02)


def cloud(count=80, seed=0):
    rng = np.random.default_rng(seed)
    position = np.column_stack([rng.uniform(-0.15, 0.15, (count, 2)), rng.uniform(-0.1, 0.5, count)])
    velocity = np.column_stack([rng.normal(0, 0.02, (count, 2)), rng.uniform(-0.3, -0.1, count)])
    return Spheres(rng.permutation(count) + 1, position, velocity, rng.uniform(0.02, 0.04, count))


def collected(times, sampling="velocity", start=None):
    collector = Collector(GRID, sampling)
    for time in times:
        collector.add(time, (start or cloud()).after(time))
    return collector


def test_a_mean_over_velocity_samples_is_the_mean_of_their_deposits():
    sums = collected([0, 0.1, 0.3]).take()
    parts = [deposit(c.position, c.radius, c.velocity, GRID) for c in (cloud().after(t) for t in (0, 0.1, 0.3))]
    assert np.allclose(sums.mean_volume, np.mean([part.volume for part in parts], axis=0), rtol=1e-12)
    assert np.allclose(sums.mean_flux[1], np.mean([part.flow_z for part in parts], axis=0) / GRID.ring_area, rtol=1e-12)
    assert sums.level_flow == pytest.approx(np.array([-part.flow_z.sum(axis=1) for part in parts]))
    assert sums.weight == 3
    assert sums.time.tolist() == [0, 0.1, 0.3]


def test_series_hold_volume_energy_and_number_of_what_is_on_the_grid():
    start = cloud()
    sums = collected([0], start=start).take()
    within = (start.position[:, 2] >= 0) & (start.position[:, 2] <= 0.4)
    energy = 0.5 * 4 / 3 * np.pi * start.radius[within] ** 3 * (start.velocity[within] ** 2).sum(axis=1)
    assert sums.count.tolist() == [within.sum()]
    assert sums.kinetic[0] == pytest.approx(energy.sum(), rel=1e-12)
    assert sums.solids[0] == pytest.approx(sums.volume.sum(), rel=1e-12)


@pytest.mark.parametrize("sampling", ["velocity", "displacement"])
def test_storage_is_the_change_of_volume_over_the_time(sampling):
    sums = collected([0, 0.1, 0.3], sampling).take()
    first, last = (deposit(c.position, c.radius, c.velocity, GRID).volume for c in (cloud(), cloud().after(0.3)))
    assert np.allclose(sums.storage, (last - first) / 0.3, atol=1e-15)
    assert (sums.start, sums.stop, sums.duration) == (0, 0.3, pytest.approx(0.3))


def test_displacement_closes_the_balance_where_velocity_does_not():
    # particles that have stopped at every snapshot but moved in between, as in stick-slip flow
    still = replace(cloud(), velocity=np.zeros((80, 3)))
    steps = [replace(still, position=still.position + t * cloud().velocity) for t in (0, 0.05, 0.1)]
    residual = {}
    for sampling in ("velocity", "displacement"):
        collector = Collector(GRID, sampling, points=6)
        for number, step in enumerate(steps):
            collector.add(0.05 * number, step)
        sums = collector.take()
        flow = np.diff(sums.flow_r, axis=1) + np.diff(sums.flow_z, axis=0)
        residual[sampling] = np.abs(flow / sums.weight + sums.storage).sum() / np.abs(sums.storage).sum()
    assert residual["velocity"] == 1
    assert residual["displacement"] < 0.05


def test_displacement_pairs_particles_by_id_whatever_their_order():
    start, later = cloud(), cloud().after(0.1)
    order = np.random.default_rng(5).permutation(80)
    shuffled = Spheres(later.id[order], later.position[order], later.velocity[order], later.radius[order])
    one, other = Collector(GRID, "displacement"), Collector(GRID, "displacement")
    for collector, second in ((one, later), (other, shuffled)):
        collector.add(0, start)
        collector.add(0.1, second)
    assert np.allclose(one.take().flow_z, other.take().flow_z, rtol=1e-10, atol=1e-18)


def test_particles_that_come_or_go_between_snapshots_carry_no_flow():
    start, later = cloud(), cloud().after(0.1)
    collector = Collector(GRID, "displacement")
    collector.add(0, Spheres(start.id[:50], start.position[:50], start.velocity[:50], start.radius[:50]))
    collector.add(0.1, Spheres(later.id[30:], later.position[30:], later.velocity[30:], later.radius[30:]))
    both = Spheres(start.id[30:50], start.position[30:50], start.velocity[30:50], start.radius[30:50])
    assert np.allclose(
        collector.take().flow_z, collected([0, 0.1], "displacement", both).take().flow_z, rtol=1e-9, atol=1e-18
    )


@pytest.mark.parametrize("sampling", ["velocity", "displacement"])
def test_segments_of_a_run_merge_into_the_sums_of_the_whole(sampling):
    whole = collected([0, 0.1, 0.2, 0.3, 0.4], sampling).take()
    collector, parts = Collector(GRID, sampling), []
    for time in (0, 0.1, 0.2, 0.3, 0.4):
        collector.add(time, cloud().after(time))
        if time in (0.2, 0.4):
            parts.append(collector.take())
    merged = merge(parts[::-1])
    assert merged.duration == pytest.approx(whole.duration)
    assert (merged.start, merged.stop) == (whole.start, whole.stop)
    assert merged.time.tolist() == whole.time.tolist()
    for name in ("volume", "flow_r", "flow_z", "gain", "level_flow"):
        assert np.allclose(getattr(merged, name), getattr(whole, name), rtol=1e-12, atol=1e-18), name


def test_sums_come_back_from_their_file(tmp_path):
    sums = collected([0, 0.1]).take()
    sums.save(tmp_path / "sums.npz")
    loaded = Sums.load(tmp_path / "sums.npz")
    assert loaded.sampling == "velocity"
    assert np.array_equal(loaded.grid.z_edges, GRID.z_edges)
    for name in ("start", "stop", "duration", "weight", "volume", "flow_r", "flow_z", "gain", "time", "level_flow"):
        assert np.array_equal(getattr(loaded, name), getattr(sums, name)), name


def test_truncated_sums_are_refused(tmp_path):
    path = tmp_path / "sums.npz"
    collected([0, 0.1]).take().save(path)
    content = path.read_bytes()
    for length in (0, 10, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(DataError, match=r"sums\.npz"):
            Sums.load(path)


def test_different_grids_and_samplings_do_not_merge():
    sums = collected([0, 0.1]).take()
    with pytest.raises(DataError, match="different grids"):
        merge([sums, replace(sums, grid=Grid(GRID.r_edges, GRID.z_edges + 1e-9))])
    with pytest.raises(DataError, match="velocity and by displacement"):
        merge([sums, collected([0, 0.1], "displacement").take()])
    with pytest.raises(DataError, match="no segments"):
        merge([])


def test_snapshots_out_of_order_and_empty_segments_are_refused():
    collector = Collector(GRID)
    with pytest.raises(DataError, match="too few snapshots"):
        collector.take()
    collector.add(1, cloud())
    with pytest.raises(DataError, match="comes after"):
        collector.add(1, cloud())
    single = Collector(GRID, "displacement")
    single.add(0, cloud())
    with pytest.raises(DataError, match="too few snapshots"):
        single.take()
