"""Plug measurement and the paper's method on fields with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.analytic_flow import ConvergingFlow

from granpipe.errors import DataError
from granpipe.field import Grid, level_flow
from granpipe.homogenize.assemble import gaussian_field, packing_fraction, raw_field, unguided_plug
from granpipe.homogenize.average import Sums
from granpipe.homogenize.conserve import bed_packing, measure_plug, scale_rows

FLOW = ConvergingFlow(height=1.0, upper_radius=0.5, lower_radius=0.3, solids_flow=0.02, packing=0.58)
GRID = Grid.covering(0.5, 0.0, 1.0, 0.02)
DIAMETER = 0.08
INSIDE = (GRID.r_centres < FLOW.wall(GRID.z_centres)[0][:, None]).astype(float)


def average(noise=0.0, wall_layer=0.0, seed=0):
    """Sums as if made of the analytic flow: packing lower by `wall_layer` in the cells next to the wall."""
    rng = np.random.default_rng(seed)
    flux_r, flux_z = FLOW.flux(GRID.r_edges, GRID.z_edges)
    packing = np.full(GRID.shape, FLOW.packing)
    near = GRID.r_centres > FLOW.wall(GRID.z_centres)[0][:, None] - DIAMETER
    packing[near] -= wall_layer
    flux_r, flux_z = (flux * (1 + noise * rng.normal(size=flux.shape)) for flux in (flux_r, flux_z))
    zeros = np.zeros(GRID.shape)
    return Sums(
        grid=GRID,
        sampling="velocity",
        start=0.0,
        stop=1.0,
        duration=1.0,
        weight=1.0,
        volume=packing * INSIDE * GRID.cell_volume,
        flow_r=flux_r * GRID.side_area,
        flow_z=flux_z * GRID.ring_area,
        gain=zeros,
        time=np.zeros(1),
        level_flow=level_flow(flux_z, GRID)[None],
        solids=np.zeros(1),
        kinetic=np.zeros(1),
        count=np.zeros(1),
    )


def test_plug_packing_leaves_the_wall_layer_out_but_its_flow_does_not():
    plug = measure_plug(average(wall_layer=0.2), INSIDE, (0.0, 0.28), DIAMETER)
    assert plug.packing == pytest.approx(0.58, rel=1e-12)
    assert plug.solids_flow == pytest.approx(0.02, rel=1e-12)
    assert plug.bulk_flow == pytest.approx(0.02 / 0.58, rel=1e-12)
    assert plug.spread < 1e-12


def test_a_given_packing_wins_over_the_measured_one():
    plug = measure_plug(average(), INSIDE, (0.0, 0.28), DIAMETER, packing=0.6)
    assert plug.bulk_flow == pytest.approx(0.02 / 0.6, rel=1e-12)


def test_plug_that_cannot_be_measured_is_refused():
    with pytest.raises(DataError, match="no row"):
        measure_plug(average(), INSIDE, (0.1, 0.11), DIAMETER)
    with pytest.raises(DataError, match="too narrow"):
        measure_plug(average(), INSIDE, (0.0, 0.28), 0.4)
    still = replace(average(), flow_z=np.zeros((51, 25)))
    with pytest.raises(DataError, match="no downward flow"):
        measure_plug(still, INSIDE, (0.0, 0.28), DIAMETER)


def test_scaling_makes_every_level_carry_the_same():
    flux = average(noise=0.2).mean_flux
    _, scaled = scale_rows(*flux, GRID, 0.02)
    assert np.abs(level_flow(scaled, GRID) / 0.02 - 1).max() < 1e-14


def test_scaling_uses_one_factor_per_level_and_their_mean_for_the_rings_between():
    flux_r, flux_z = average(noise=0.2).mean_flux
    scaled_r, scaled_z = scale_rows(flux_r, flux_z, GRID, 0.02)
    factor = 0.02 / level_flow(flux_z, GRID)
    assert np.allclose(scaled_z, flux_z * factor[:, None], rtol=1e-14)
    assert np.allclose(scaled_r, flux_r * (factor[1:] + factor[:-1])[:, None] / 2, rtol=1e-14)


def test_a_blocked_level_is_named():
    flux_r, flux_z = average().mean_flux
    flux_z[31] = 0
    with pytest.raises(DataError, match=r"hardly any flow through z = 0\.62 m"):
        scale_rows(flux_r, flux_z, GRID, 0.02)


@pytest.mark.parametrize("passes", [0, 1, 4])
def test_the_papers_field_carries_the_plugs_flow_through_every_level(passes):
    sums = average(noise=0.3)
    plug = measure_plug(sums, INSIDE, (0.0, 0.28), DIAMETER)
    field = gaussian_field(sums, INSIDE, plug, DIAMETER, passes, flow_scale=0.1)
    assert np.abs(level_flow(field.flux_z, GRID) / plug.solids_flow - 1).max() < 1e-10
    assert field.flow_scale == 0.1
    assert field.bulk_flow == plug.bulk_flow
    assert np.array_equal(field.raw_flux_z, sums.mean_flux[1])
    assert field.psi is None


def test_smoothing_brings_the_field_nearer_to_the_truth():
    truth = FLOW.flux(GRID.r_edges, GRID.z_edges)[1]
    errors = []
    for passes in (0, 1, 2):
        sums = average(noise=0.3)
        field = gaussian_field(sums, INSIDE, measure_plug(sums, INSIDE, (0.0, 0.28), DIAMETER), DIAMETER, passes)
        errors.append(np.linalg.norm((field.flux_z - truth) * GRID.ring_area))
    assert errors[1] < 0.4 * errors[0]
    assert errors[2] < errors[1]


def test_a_raw_field_is_the_average_untouched():
    sums = average(noise=0.3)
    field = raw_field(sums, INSIDE, measure_plug(sums, INSIDE, (0.0, 0.28), DIAMETER), DIAMETER)
    assert np.array_equal(field.flux_z, sums.mean_flux[1])
    assert np.array_equal(field.flux_r, sums.mean_flux[0])
    assert field.packing_fraction == pytest.approx(0.58 * INSIDE)


def test_packing_counts_only_the_part_of_a_cell_inside():
    room = np.array([[1.0, 0.5, 0.25, 0.0]])
    grid = Grid(np.array([0.0, 0.1, 0.2, 0.3, 0.4]), np.array([0.0, 0.1]))
    volume = np.array([[0.6, 0.3, 0.5, 0.1]]) * grid.cell_volume
    assert packing_fraction(volume, room, grid).tolist() == [pytest.approx([0.6, 0.6, 1.0, 0.0])]


def test_plug_without_an_outline_is_estimated_from_the_fullest_cells():
    sums = average()
    half_empty = replace(sums, volume=np.where(GRID.z_centres[:, None] > 0.6, 0, sums.volume))
    plug = unguided_plug(half_empty)
    assert plug.packing == pytest.approx(0.58, rel=1e-12)
    assert plug.solids_flow == pytest.approx(0.02, rel=1e-12)
    with pytest.raises(DataError, match="no particles"):
        unguided_plug(replace(sums, volume=np.zeros(GRID.shape)))


def test_the_packing_of_a_bed_is_not_that_of_its_void_nor_of_the_dilated_outlet():
    sums = average()
    volume = sums.volume.copy()
    volume[: len(volume) // 4] *= 0.85
    volume[-len(volume) // 4 :] *= 0.01
    dilated = replace(sums, volume=volume)
    bottom = float(sums.grid.z_edges[len(volume) // 4])
    whole = bed_packing(sums, INSIDE, float(sums.grid.z_edges[0]), DIAMETER)
    assert bed_packing(dilated, INSIDE, bottom, DIAMETER) == pytest.approx(whole)
    assert bed_packing(sums, INSIDE, 1e3, DIAMETER) == pytest.approx(whole)  # a vessel that ends below that level
