"""Granular temperature, coordination and mixing: against what is known of the particles that they are made from."""

import numpy as np
import pytest
from fakes.spheres import Spheres

from granpipe.field import Grid
from granpipe.homogenize.average import Collector
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.particle_fields import (
    LEAST_SAMPLES,
    SAMPLE_DIAMETERS,
    contact_counts,
    coordination_arrays,
    mixing_arrays,
    mixing_sums,
    temperature_arrays,
    velocity_moments,
    whole_mixing,
)

GRID = Grid.covering(0.3, 0.0, 0.4, 0.005)
DIAMETER = 0.02
BINS = Bins.of(GRID, DIAMETER)
INSIDE = np.ones(GRID.shape)
RADII = np.array([0.008, 0.012])


def cloud(count, seed=0, radii=(0.5 * DIAMETER,)):
    rng = np.random.default_rng(seed)
    distance, angle = 0.3 * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    place = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0, 0.4, count)])
    return Spheres(np.arange(count), place, np.zeros((count, 3)), rng.choice(radii, count))


def moving(spheres, outward, around, upward):
    """The spheres with velocities given by components (n,)."""
    x, y, _ = spheres.position.T
    r = np.hypot(x, y)
    across = np.column_stack([x * outward - y * around, y * outward + x * around]) / r[:, None]
    return Spheres(spheres.id, spheres.position, np.column_stack([across, upward]), spheres.radius)


def segment_of(*values):
    collector = Collector(GRID)
    collector.add(0.0, cloud(1))
    for one in values:
        collector.observe(one)
    return collector.take()


def temperature(*snapshots):
    segment = segment_of(*(velocity_moments(BINS, one) for one in snapshots))
    return temperature_arrays([segment], BINS)["granular_temperature"]


def test_the_gradient_of_the_mean_velocity_is_no_temperature():
    start = cloud(60_000, radii=RADII)
    r, z = np.hypot(*start.position[:, :2].T), start.position[:, 2]
    sheared = moving(start, 0.3 * r - 0.2 * z + 0.1, 0.7 * r, 2.0 * r + 1.5 * z - 0.4)
    per_diameter = 2.0 * DIAMETER  # the velocity that a diameter of shear makes
    assert np.nanmax(temperature(sheared)) < 1e-9 * per_diameter**2
    # about the mean of each window alone, it would be (γ̇ w)²/36 with windows w = 1.5 d wide, of one component in three
    assert per_diameter**2 * 1.5**2 / 36 > 0.06 * per_diameter**2


def test_a_maxwell_distribution_gives_its_variance_on_top_of_any_shear():
    start, sigma = cloud(100_000, radii=RADII), 0.03
    r, z = np.hypot(*start.position[:, :2].T), start.position[:, 2]
    rng = np.random.default_rng(3)
    noise = rng.normal(0, sigma, (3, len(r)))
    found = temperature(moving(start, 0.3 * r + noise[0], noise[1], 2.0 * r + 1.5 * z + noise[2]))
    assert np.nanmean(found) == pytest.approx(sigma**2, rel=0.01)
    assert np.isfinite(found).mean() > 0.95


def test_few_particles_do_not_bias_the_temperature():
    """Fitting a line to a few velocities takes up a part of their scatter, which is given back."""
    rng = np.random.default_rng(5)
    found = []
    for seed in range(40):
        start = cloud(3000, seed)
        found.append(temperature(moving(start, *rng.normal(0, 0.03, (3, 3000)))))
    known = np.isfinite(found)
    assert 0.2 < known.mean() < 0.9
    assert np.mean(np.array(found)[known]) == pytest.approx(0.03**2, rel=0.02)


def test_curvature_of_the_mean_counts_little():
    """w = −(1 − r²/R²): what a straight line leaves in a window of 1.5 d is below 1 % of (γ̇ d)² at the wall."""
    start = cloud(60_000)
    r = np.hypot(*start.position[:, :2].T)
    found = temperature(moving(start, 0 * r, 0 * r, -(1 - (r / 0.3) ** 2)))
    assert np.nanmax(found) < 0.01 * (2 / 0.3 * DIAMETER) ** 2


def test_where_few_particles_were_no_temperature_is_told():
    assert np.isnan(temperature(cloud(LEAST_SAMPLES - 1))).all()


def packed(step, basis, side=9):
    """A lattice of spheres that overlap by a part in a thousand, round the axis."""
    steps = np.array(np.meshgrid(*[np.arange(-side, side + 1)] * 3)).reshape(3, -1).T
    place = np.concatenate([(steps + shift) * step for shift in np.array(basis)]) + np.array([0.001, 0.002, 0.2])
    count = len(place)
    return Spheres(np.arange(count), place, np.zeros((count, 3)), np.full(count, 0.5 * 1.001 * DIAMETER))


def coordination(spheres):
    return coordination_arrays([segment_of(contact_counts(BINS, spheres))], BINS)


@pytest.mark.parametrize(
    ("step", "basis", "expected"),
    [
        (DIAMETER, [[0, 0, 0]], 6),
        (DIAMETER * np.sqrt(2), [[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]], 12),
        (DIAMETER * 2 / np.sqrt(3), [[0, 0, 0], [0.5, 0.5, 0.5]], 8),
    ],
    ids=["simple cubic", "face-centred", "body-centred"],
)
def test_lattices_have_their_coordination_numbers(step, basis, expected):
    found = coordination(packed(step, basis))
    inner = np.hypot(*np.meshgrid(GRID.r_centres, GRID.z_centres - 0.2)) < 0.1
    for name in ("coordination", "mechanical_coordination"):
        values = found[name][inner]
        assert np.isfinite(values).any()
        assert values[np.isfinite(values)] == pytest.approx(expected, abs=1e-12)
    assert np.nanmax(found["rattlers"][inner]) == 0


def test_particles_without_contacts_are_rattlers():
    """Pairs, lone ones, and chains of three on lines far apart: Z = 1, 0, and 1, 2, 1."""
    lines = np.arange(-5, 6) * 0.05
    x, y = np.meshgrid(lines, lines)
    feet = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    up = 0.999 * DIAMETER * np.array([0, 0, 1.0])
    place = np.concatenate([feet + [0, 0, 0.2] + k * up for k in range(3)])
    spheres = Spheres(np.arange(len(place)), place, 0 * place, np.full(len(place), DIAMETER / 2))
    one_bin = Bins(GRID, 1000)
    found = coordination_arrays([segment_of(contact_counts(one_bin, spheres))], one_bin)
    assert found["coordination"][0, 0] == pytest.approx(4 / 3)
    assert found["mechanical_coordination"][0, 0] == pytest.approx(2)  # (4 − 2)/1
    assert found["rattlers"][0, 0] == pytest.approx(2 / 3)


def mixed(spheres):
    segment = segment_of(mixing_sums(GRID, RADII, DIAMETER, spheres))
    return mixing_arrays([segment], GRID, DIAMETER, INSIDE)["mixing_index"], whole_mixing([segment])


def sized(spheres, large):
    return Spheres(spheres.id, spheres.position, spheres.velocity, np.where(large, RADII[1], RADII[0]))


def test_sizes_at_random_have_the_index_1():
    rng = np.random.default_rng(100)
    found = []
    for seed in range(20):
        start = cloud(8000, seed)
        found.append(mixed(sized(start, rng.uniform(size=8000) < 0.3))[1])
    assert np.mean(found) == pytest.approx(1, abs=4 * np.std(found) / np.sqrt(20))
    assert np.std(found) < 0.01


@pytest.mark.parametrize("part", [0.5, 0.1])
def test_sizes_wholly_apart_have_the_index_0(part):
    """Apart along a plane between cubes: no cube holds both."""
    start = cloud(8000)
    size = SAMPLE_DIAMETERS * DIAMETER
    plane = {0.5: 0.0, 0.1: 3 * size}[part]
    rows, whole = mixed(sized(start, start.position[:, 0] > plane))
    assert whole == pytest.approx(0, abs=1e-12)
    assert rows == pytest.approx(0, abs=1e-12)


def test_layers_are_unmixed_as_a_whole_and_tell_nothing_by_height():
    start = cloud(8000)
    rows, whole = mixed(sized(start, start.position[:, 2] > 2 * SAMPLE_DIAMETERS * DIAMETER))
    assert whole == pytest.approx(0, abs=1e-12)
    assert np.isnan(rows).all()


def test_half_mixed_lies_between():
    start = cloud(8000)
    rng = np.random.default_rng(101)
    right = start.position[:, 0] > 0
    large = rng.uniform(size=8000) < np.where(right, 0.75, 0.25)
    _, whole = mixed(sized(start, large))
    # S² = 1/16 between the halves of S₀² = 1/4, over the random part
    assert whole == pytest.approx(0.75, abs=0.03)


def test_each_height_has_its_own_index():
    start = cloud(20_000)
    rng = np.random.default_rng(101)
    slab = 3 * SAMPLE_DIAMETERS * DIAMETER
    lower = start.position[:, 2] < slab
    large = np.where(lower, start.position[:, 0] > 0, rng.uniform(size=20_000) < 0.5)
    rows, _ = mixed(sized(start, large))
    assert rows[slab > GRID.z_centres] == pytest.approx(0, abs=1e-12)
    assert rows[slab < GRID.z_centres] == pytest.approx(1, abs=0.05)


def test_an_empty_snapshot_tells_nothing():
    empty = cloud(0)
    assert np.isnan(temperature(empty)).all()
    assert np.isnan(coordination(empty)["coordination"]).all()
    assert np.isnan(mixed(empty)[1])


def test_bins_hold_every_cell_once_and_their_windows_their_neighbours():
    grid = Grid.covering(0.23, 0.0, 0.31, 0.01)
    bins = Bins.of(grid, 0.06)
    values = np.random.default_rng(0).uniform(size=grid.shape)
    joined = bins.joined(values)
    assert joined.shape == bins.shape == (11, 8)
    assert joined.sum() == pytest.approx(values.sum())
    assert joined[-1, -1] == pytest.approx(values[30:, 21:].sum())
    assert bins.window(joined)[4, 5] == pytest.approx(values[9:18, 12:21].sum())
    assert bins.window(joined)[0, 0] == pytest.approx(values[:6, :6].sum())
    assert np.array_equal(bins.on_cells(joined)[5:7, 2:4], [[joined[1, 0], joined[1, 1]], [joined[2, 0], joined[2, 1]]])
    assert bins.on_cells(joined).shape == grid.shape
