"""`homogenize.fields` in a slab: against flows and particles of which all is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fakes.spheres import Spheres

from granpipe.analysis.compare import compare
from granpipe.analysis.residence_time import residence_time
from granpipe.analysis.strain_rate import shear_rate, strain_rate
from granpipe.analysis.streamlines import age, streamlines
from granpipe.analysis.surfaces import stagnant_area, void_area
from granpipe.errors import DataError
from granpipe.field import Array, Box, Field, Grid, Measure, flux_from_psi
from granpipe.geometry.outline import Outline
from granpipe.geometry.wall_pieces import WallPieces
from granpipe.homogenize.average import Collector, Sums
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.extras import (
    SizeClassVolumes,
    WallSlip,
    size_class_arrays,
    wall_forces,
    wall_pressure_arrays,
    wall_slip_arrays,
)
from granpipe.homogenize.particle_fields import (
    contact_counts,
    coordination_arrays,
    mixing_arrays,
    mixing_sums,
    temperature_arrays,
    velocity_moments,
)
from granpipe.pipeline.extra_fields import with_derived

LEFT, RIGHT, HIGH, DEEP = -0.11, 0.19, 0.4, 0.12
GRID = Box.within((LEFT, RIGHT), (0.0, DEEP), (0.0, HIGH), 0.005, flat=True, cut=True).of_slice(Measure(DEEP, False))
INSIDE = np.ones(GRID.shape)
DIAMETER = 0.02
BINS = Bins.of(GRID, DIAMETER)
RADII = np.array([0.008, 0.012])


# --- from the stream function -----------------------------------------------------------------------------------------


def flow(psi: Array, packing: float = 0.6) -> Field:
    """A field of a stream function (nz+1, nx+1), from which all is bulk."""
    flux = flux_from_psi(psi, GRID)
    whole = float(DEEP * (psi[-1, 0] - psi[-1, -1]))
    return Field(GRID, INSIDE, INSIDE > 0, *flux, whole / packing, packing, 1.0, psi=psi)


def sheared(a: float = 0.02, b: float = 0.3) -> Field:
    """w = −a − b (x − LEFT) at every level, in bulk."""
    s = GRID.r_edges - LEFT
    return flow(-0.6 * np.tile(a * s + 0.5 * b * s**2, (len(GRID.z_edges), 1)))


def test_ages_are_those_of_straight_paths():
    """Cells are faster on the right; their age is the way from the inlet over their own speed."""
    field = sheared()
    speed = 0.02 + 0.3 * (GRID.r_centres - LEFT)
    np.testing.assert_allclose(age(field), (HIGH - GRID.z_centres)[:, None] / speed, rtol=1e-9)


def test_streamlines_divide_the_flow_from_the_left_wall():
    lines = streamlines(sheared(), count=5)
    for line in lines:
        s = line.r - LEFT
        np.testing.assert_allclose(s, s[0], rtol=1e-9)
        assert (0.02 * s[0] + 0.15 * s[0] ** 2) / (0.02 * 0.3 + 0.15 * 0.09) == pytest.approx(line.within, rel=5e-3)
        assert line.leaves
    assert [line.within for line in lines] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])


def test_shear_and_stretching_are_exact_though_cells_are_no_squares():
    """w = −a − b s is sheared by b; ψ = c x z is stretched: u = −c x, w = c z."""
    uneven = replace(GRID, r_edges=np.linspace(LEFT, RIGHT, 51))
    assert uneven.r_edges[1] - uneven.r_edges[0] > 1.1 * uneven.cell
    z, x = np.meshgrid(uneven.z_edges, uneven.r_edges, indexing="ij")
    s = x - LEFT
    for psi, expected in (
        (-0.6 * (0.02 * s + 0.15 * s**2), (0, 0, 0, -0.15)),
        (0.6 * 0.7 * x * (z - 1), (-0.7, 0, 0.7, 0)),
    ):
        flux = flux_from_psi(psi, uneven)
        inside = np.ones(uneven.shape)
        strain = strain_rate(Field(uneven, inside, inside > 0, *flux, 1.0, 0.6, 1.0, psi=psi))
        np.testing.assert_allclose(
            strain[:, 1:-1, 1:-1], np.array(expected)[:, None, None] + 0 * x[2:-1, 2:-1], atol=1e-9
        )
    assert np.nanmax(np.abs(shear_rate(strain_rate(sheared())) - 0.3)) < 1e-9


def test_their_components_are_named_after_x_and_y_in_a_file(tmp_path: Path):
    made, _ = with_derived(sheared(), ("strain_rate", "age", "residence_time"))
    made.save(tmp_path / "field.npz")
    with np.load(tmp_path / "field.npz") as stored:
        assert {"strain_xx", "strain_yy", "strain_zz", "strain_xz", "flux_x", "age"} <= set(stored)
        assert not {"strain_rr", "strain_rz", "flux_r"} & set(stored)
    again = Field.load(tmp_path / "field.npz")
    np.testing.assert_array_equal(again.extra["strain_rz"], made.extra["strain_rz"])


# --- from particles ---------------------------------------------------------------------------------------------------


def cloud(count: int, seed: int = 0, radii: Array = RADII) -> Spheres:
    rng = np.random.default_rng(seed)
    place = rng.uniform((LEFT, 0, 0), (RIGHT, DEEP, HIGH), (count, 3))
    return Spheres(np.arange(count), place, np.zeros((count, 3)), rng.choice(radii, count))


def segment_of(*values: dict[str, Array]) -> Sums:
    collector = Collector(GRID)
    collector.add(0.0, cloud(1))
    for one in values:
        collector.observe(one)
    return collector.take()


def temperature(spheres: Spheres) -> Array:
    return temperature_arrays([segment_of(velocity_moments(BINS, spheres))], BINS)["granular_temperature"]


def test_a_linear_flow_has_no_temperature_and_a_maxwell_distribution_on_top_its_variance():
    start, sigma = cloud(60_000), 0.03
    x, _, z = start.position.T
    steady = np.column_stack([0.3 * x - 0.2 * z, 0.5 * x + 0.1, 2.0 * x + 1.5 * z])
    assert np.nanmax(temperature(replace(start, velocity=steady))) < 1e-9 * sigma**2
    noise = np.random.default_rng(3).normal(0, sigma, steady.shape)
    found = temperature(replace(start, velocity=steady + noise))
    assert np.nanmean(found) == pytest.approx(sigma**2, rel=0.01)
    assert np.isfinite(found).mean() > 0.95


def test_spheres_on_a_lattice_touch_six_others_across_the_periodic_faces_too():
    """Six on y, the depth long: inside each has six contacts; without the periodic faces those at the ends had five."""
    step = DEEP / 6
    x, y, z = np.meshgrid(LEFT + step * (np.arange(15) + 0.5), step * np.arange(6), step * (np.arange(20) + 0.5))
    place = np.column_stack([x.ravel(), y.ravel() - 0.3 * step, z.ravel()])  # some have left through the front
    count = len(place)
    spheres = Spheres(np.arange(count), place, np.zeros((count, 3)), np.full(count, 0.501 * step))
    counted = contact_counts(Bins.of(GRID, DIAMETER), spheres)["contacts"]
    contacts = 3 * count - (6 * 20 + 6 * 15)  # pairs along y: all; along x and z less those at the ends
    assert counted[0].sum() == count
    assert counted[1].sum() == 2 * contacts
    whole = coordination_arrays([segment_of(*[{"contacts": 20 * counted}])], BINS)["coordination"]
    middle = whole[30:50, 25:35]
    np.testing.assert_allclose(middle[np.isfinite(middle)], 6.0)


def test_sizes_side_by_side_are_apart_and_shuffled_ones_are_mixed():
    start = cloud(8_000)
    shuffled = segment_of(mixing_sums(GRID, RADII, DIAMETER, start))
    apart = replace(start, radius=np.where(start.position[:, 0] < 0.04, *RADII))
    parted = segment_of(mixing_sums(GRID, RADII, DIAMETER, apart))
    mixed, unmixed = (mixing_arrays([one], GRID, DIAMETER, INSIDE)["mixing_index"] for one in (shuffled, parted))
    assert np.nanmean(mixed) == pytest.approx(1, abs=0.03)
    assert np.nanmax(unmixed) < 0.2


def test_packing_of_each_size_is_its_volume_over_that_of_the_slice_wherever_along_y_it_lies():
    start = cloud(300)
    inner = start.position * [0.8, 1.0, 0.8] + [0.01, 0.0, 0.04]  # away from what cuts them; y is not cut
    start = replace(start, position=inner)
    collector = Collector(GRID, extras=[SizeClassVolumes(RADII)])
    collector.add(0.0, start)
    found = size_class_arrays([collector.take()], RADII, INSIDE)["class_packing"]
    for k, radius in enumerate(RADII):
        volume = 4 / 3 * np.pi * radius**3 * (start.radius == radius).sum()
        assert (found[k] @ GRID.cell_volume).sum() == pytest.approx(volume, rel=1e-9)


# --- along walls ------------------------------------------------------------------------------------------------------

HOPPER = Outline.of([(0.2, 0.4), (0.2, 0.2), (0.05, 0.0)], {}, {}, [(-0.1, 0.4), (-0.1, 0.25), (-0.05, 0.0)], DEEP)


def pieces() -> WallPieces:
    return WallPieces.of(HOPPER, 0.02)


def test_pieces_lie_on_both_walls_their_normals_point_out_and_their_area_is_that_of_the_walls():
    found = pieces()
    middle = found.ends.mean(axis=1)
    assert set(found.labels) == {"right", "left"}
    right = found.labels == "right"
    assert ((found.normal[:, 0] > 0) == right).all()
    assert ((middle[:, 0] > 0) == right).all()
    lengths = 0.2 + np.hypot(0.15, 0.2), 0.15 + np.hypot(0.05, 0.25)
    assert found.area[right].sum() == pytest.approx(DEEP * lengths[0])
    assert found.area[~right].sum() == pytest.approx(DEEP * lengths[1])


def test_solids_that_slide_down_each_wall_have_their_own_speed_there():
    """Along the pieces, which run down on the right and up on the left."""
    y = np.linspace(0.005, DEEP - 0.005, 8)
    at = [np.column_stack([np.full(8, x), y, np.full(8, 0.32)]) for x in (0.2 - 0.0101, -0.1 + 0.0101)]
    speed = np.repeat([[0, 0, -0.3], [0.02, 0.1, -0.1]], 8, axis=0)
    spheres = Spheres(np.arange(16), np.concatenate(at), speed, np.full(16, 0.01))
    collector = Collector(GRID, "velocity", extras=[WallSlip(pieces(), 0.001)])
    collector.add(0.0, spheres)
    collector.add(0.1, spheres)
    arrays = wall_slip_arrays([collector.take()], pieces())
    touched = arrays["wall_contact"] > 0
    slip = dict(zip(arrays["wall_surface"][touched], arrays["wall_slip"][touched], strict=True))
    assert slip == {"right": pytest.approx(0.3), "left": pytest.approx(-0.1)}
    area = pieces().area[touched]
    np.testing.assert_allclose(arrays["wall_contact"][touched], 8 * np.pi * 0.01**2 / area)


def test_the_pressure_of_an_even_push_on_both_walls_is_that_push():
    """Forces of p per area at many points of each wall, normal to it and with friction along it."""
    found, pressure = pieces(), 250.0
    middle = found.ends.mean(axis=1)
    point = np.column_stack([middle[:, 0], np.full(len(found), 0.4 * DEEP), middle[:, 1]])
    inward = -np.column_stack([found.normal[:, 0], 0 * point[:, 0], found.normal[:, 1]])
    along = np.column_stack([found.tangent[:, 0], 0 * point[:, 0] + 1, found.tangent[:, 1]])
    force = pressure * found.area[:, None] * (inward + 0.3 * along)
    arrays = wall_pressure_arrays([segment_of(wall_forces(found, point, force))], found)
    np.testing.assert_allclose(arrays["wall_pressure"], pressure)


# --- studies and comparisons ------------------------------------------------------------------------------------------


def test_slices_of_two_thicknesses_with_one_flow_are_no_different():
    """A point of a study has a slice of its own; velocities are those at the flow rate of the case."""
    thin = sheared()
    thick = replace(thin, grid=GRID.of_slice(Measure(3 * DEEP, False)), bulk_flow=3 * thin.bulk_flow)
    (whole,) = compare(replace(thin, flow_scale=3.0), replace(thick, flow_scale=3.0), {}, DIAMETER)
    assert whole.observed == 0
    assert residence_time(thick).quantile(0.5) == pytest.approx(residence_time(thin).quantile(0.5))


def test_fields_at_another_x_or_about_an_axis_are_not_compared():
    field = sheared()
    moved = replace(field, grid=replace(GRID, r_edges=GRID.r_edges + 0.01))
    with pytest.raises(DataError, match=r"lie at different x: -0\.11 … 0\.19 m and -0\.1 … 0\.2 m"):
        compare(field, moved, {}, DIAMETER)
    rings = replace(field, grid=Grid(0.005 * np.arange(61.0), GRID.z_edges))
    with pytest.raises(DataError, match="of a body of revolution"):
        compare(field, rings, {}, DIAMETER)


def test_area_at_rest_is_that_of_its_cells_though_they_are_no_squares():
    uneven = replace(GRID, r_edges=np.linspace(LEFT, RIGHT, 51))
    x = np.tile(uneven.r_edges, (len(uneven.z_edges), 1))
    psi = -0.6 * np.maximum(x - 0.04, 0.0)  # all left of x = 0.04 m is at rest
    inside = np.ones(uneven.shape)
    field = Field(uneven, inside, inside > 0, *flux_from_psi(psi, uneven), 0.15 * DEEP, 0.6, 1.0, psi=psi)
    assert stagnant_area(field, (0.0, HIGH)) == pytest.approx(0.15 * HIGH, rel=0.05)
    assert void_area(replace(field, bulk=uneven.r_centres + 0 * inside > 0.04), (0.0, HIGH)) == pytest.approx(
        0.15 * HIGH
    )
