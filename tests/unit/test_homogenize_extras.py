"""Extra sums: size classes, slip and contact along walls, pressure; against counts made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.spheres import Spheres

from granpipe.errors import DataError
from granpipe.field import Grid
from granpipe.geometry.outline import Outline
from granpipe.geometry.wall_pieces import WallPieces
from granpipe.homogenize.assemble import packing_fraction
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.homogenize.extras import (
    SizeClassVolumes,
    WallSlip,
    size_class_arrays,
    wall_forces,
    wall_pressure_arrays,
    wall_slip_arrays,
)

pytestmark = pytest.mark.filterwarnings("error")
"""A division by zero where nothing ever touches a wall was once told by Python."""

GRID = Grid.covering(0.3, 0.0, 0.4, 0.02)
RADII = np.array([0.01, 0.02])
INSIDE = np.ones(GRID.shape)
HOPPER = Outline.of(
    [(0.3, 0.4), (0.3, 0.2), (0.1, 0.0)], {"ring": [(0.15, 0.3), (0.2, 0.3), (0.2, 0.35), (0.15, 0.35)]}
)


def on_circle(count, r, z, radius, outward=0.0, upward=0.0, spin=0.0):
    """Spheres evenly round a circle of the vessel, all moving alike."""
    angle = 2 * np.pi * (np.arange(count) + 0.3) / count
    radial = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    round_about = np.column_stack([-np.sin(angle), np.cos(angle), 0 * angle])
    up = np.array([0, 0, 1.0])
    return Spheres(
        np.arange(1, count + 1),
        r * radial + z * up,
        outward * radial + upward * up + spin * round_about,
        np.full(count, radius),
    )


def cloud(count=300, seed=0):
    rng = np.random.default_rng(seed)
    position = np.column_stack([rng.uniform(-0.15, 0.15, (count, 2)), rng.uniform(0.05, 0.35, count)])
    return Spheres(np.arange(1, count + 1), position, rng.normal(0, 0.02, (count, 3)), rng.choice(RADII, count))


def sums_of(extra, start, times=(0.0, 0.1), sampling="velocity"):
    collector = Collector(GRID, sampling, extras=[extra])
    for time in times:
        collector.add(time, start.after(time))
    return collector.take()


@pytest.mark.parametrize("sampling", ["velocity", "displacement"])
def test_the_classes_together_are_the_packing(sampling):
    sums = sums_of(SizeClassVolumes(RADII), cloud(), sampling=sampling)
    found = size_class_arrays([sums], RADII, INSIDE)
    whole = packing_fraction(sums.mean_volume, INSIDE, GRID)
    assert np.allclose(found["class_packing"].sum(axis=0), whole, rtol=1e-12, atol=1e-15)


def test_a_class_is_the_packing_of_its_particles_alone():
    start = cloud()
    found = size_class_arrays([sums_of(SizeClassVolumes(RADII), start)], RADII, INSIDE)
    for k, radius in enumerate(RADII):
        own = start.radius == radius
        alone = Spheres(start.id[own], start.position[own], start.velocity[own], start.radius[own])
        volume = sums_of(SizeClassVolumes(RADII), alone).mean_volume
        assert np.allclose(found["class_packing"][k] * GRID.cell_volume, volume, rtol=1e-10, atol=1e-18)


def test_the_sauter_diameter_is_that_of_the_spheres_in_the_cell():
    # one cell holds all: Σ d³ / Σ d²
    start = cloud()
    one_cell = Grid.covering(0.4, 0.0, 0.4, 0.4)
    collector = Collector(one_cell, extras=[SizeClassVolumes(RADII)])
    collector.add(0.0, start)
    found = size_class_arrays([collector.take()], RADII, np.ones((1, 1)))["sauter_diameter"]
    assert found[0, 0] == pytest.approx(2 * (start.radius**3).sum() / (start.radius**2).sum(), rel=1e-12)


def test_pieces_cover_walls_and_obstacles_with_solid_to_their_left():
    pieces = WallPieces.of(HOPPER, 0.03)
    ends = pieces.ends
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() <= 0.03 + 1e-12
    slant = np.hypot(0.2, 0.2)
    by_hand = 2 * np.pi * (0.3 * 0.2 + 0.2 * slant)  # cylinder and cone
    assert pieces.area[pieces.labels == "wall"].sum() == pytest.approx(by_hand, rel=1e-12)
    ring = 2 * np.pi * (0.15 * 0.05 + 0.2 * 0.05 + 2 * 0.175 * 0.05)
    assert pieces.area[pieces.labels == "ring"].sum() == pytest.approx(ring, rel=1e-12)
    middle = ends.mean(axis=1) + 1e-6 * pieces.normal
    inside_ring = (middle[:, 0] > 0.15) & (middle[:, 0] < 0.2) & (middle[:, 1] > 0.3) & (middle[:, 1] < 0.35)
    beyond_wall = (middle[:, 0] > 0.3) | (middle[:, 0] > middle[:, 1] + 0.1)
    assert np.where(pieces.labels == "ring", inside_ring, beyond_wall).all()


def test_points_find_their_piece():
    pieces = WallPieces.of(HOPPER, 0.03)
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(0, 0.3, 500), rng.uniform(0, 0.4, 500)])
    piece, distance = pieces.nearest(points)
    along = np.linspace(0, 1, 400)[:, None]
    for point, own, far in zip(points[:50], piece, distance, strict=False):
        apart = [np.linalg.norm(a + along * (b - a) - point, axis=1).min() for a, b in pieces.ends]
        assert min(apart) == pytest.approx(far, abs=1e-4)
        assert apart[own] == pytest.approx(min(apart), abs=1e-4)


@pytest.mark.parametrize("sampling", ["velocity", "displacement"])
def test_slip_and_contact_of_spheres_that_slide_down_the_wall(sampling):
    radius, speed = 0.02, 0.1
    start = on_circle(12, 0.3 - radius, 0.31, radius, upward=-speed, spin=0.3 * (sampling == "velocity"))
    pieces = WallPieces.of(HOPPER, 0.05)
    sums = sums_of(WallSlip(pieces, 1e-3), start, (0.0, 0.05), sampling)
    found = wall_slip_arrays([sums], pieces)
    level = (found["wall_surface"] == "wall") & (found["wall_ends"][:, :, 1].max(axis=1) <= 0.35 + 1e-9)
    level &= found["wall_ends"][:, :, 1].min(axis=1) >= 0.3 - 1e-9
    assert level.sum() == 1
    assert found["wall_slip"][level] == pytest.approx(speed, rel=1e-9)
    assert found["wall_contact"][level] == pytest.approx(12 * np.pi * radius**2 / (2 * np.pi * 0.3 * 0.05), rel=1e-9)
    assert not found["wall_slip"][~level].any()
    assert not found["wall_contact"][~level].any()


def test_slip_on_a_cone_is_the_velocity_along_it():
    radius, speed = 0.01, 0.05
    down = np.sqrt(0.5)
    foot = np.array([0.21, 0.11])  # on the cone, whose normal into the solid is (1, −1)/√2
    centre = foot - radius * np.array([down, -down])
    start = on_circle(8, *centre, radius, outward=-down * speed, upward=-down * speed)
    pieces = WallPieces.of(HOPPER, 0.05)
    slip = wall_slip_arrays([sums_of(WallSlip(pieces, 1e-4), start, (0.0,))], pieces)["wall_slip"]
    assert slip[slip != 0] == pytest.approx([speed])


def test_particles_that_do_not_touch_do_not_count():
    start = on_circle(8, 0.3 - 0.02 - 2e-3, 0.3, 0.02, upward=-0.1)
    pieces = WallPieces.of(HOPPER, 0.05)
    assert not sums_of(WallSlip(pieces, 1e-3), start).extra["wall_shadow"].any()
    assert sums_of(WallSlip(pieces, 3e-3), start).extra["wall_shadow"].any()


def test_pressure_is_the_force_on_a_piece_over_its_area():
    pieces = WallPieces.of(HOPPER, 0.05)
    contacts = on_circle(10, 0.3, 0.32, 0.01, outward=-3.0, upward=5.0)  # pushed inwards by 3 N each, friction 5 N
    collector = Collector(GRID)
    for time in (0.0, 0.1, 0.2, 0.3):
        collector.add(time, cloud())
        collector.observe(wall_forces(pieces, contacts.position, contacts.velocity))
    found = wall_pressure_arrays([collector.take()], pieces)["wall_pressure"]
    assert found[found != 0] == pytest.approx([10 * 3.0 / (2 * np.pi * 0.3 * 0.05)])


def test_standard_errors_come_from_blocks():
    pieces = WallPieces.of(HOPPER, 0.05)
    parts, speeds = [], np.array([0.1, 0.12, 0.08, 0.11, 0.09, 0.1, 0.1])
    for number, speed in enumerate(speeds):
        start = on_circle(8, 0.28, 0.32, 0.02, upward=-speed)
        parts.append(sums_of(WallSlip(pieces, 1e-3), start.after(-number), (float(number),)))
    found = wall_slip_arrays(parts, pieces)
    at = found["wall_slip"] != 0
    assert found["wall_slip"][at] == pytest.approx(speeds.mean())
    assert found["wall_slip_se"][at] == pytest.approx(speeds.std(ddof=1) / np.sqrt(7))
    assert "wall_slip_se" not in wall_slip_arrays(parts[:6], pieces)


def test_extra_sums_merge_and_come_back_from_their_file(tmp_path):
    parts = [sums_of(SizeClassVolumes(RADII), cloud(seed=seed), (float(seed),)) for seed in (0, 1)]
    added = merge(parts).extra["class_volume"]
    assert np.allclose(added, parts[0].extra["class_volume"] + parts[1].extra["class_volume"], rtol=1e-14)
    parts[0].save(tmp_path / "sums.npz")
    assert np.array_equal(Sums.load(tmp_path / "sums.npz").extra["class_volume"], parts[0].extra["class_volume"])
    with pytest.raises(DataError, match="different extra sums"):
        merge([parts[0], replace(parts[1], extra={})])


def test_what_nobody_asks_for_is_in_no_file(tmp_path):
    collector = Collector(GRID)
    collector.add(0.0, cloud())
    collector.take().save(tmp_path / "sums.npz")
    with np.load(tmp_path / "sums.npz") as stored:
        assert not [name for name in stored.files if name.startswith(("extra", "class", "wall"))]
