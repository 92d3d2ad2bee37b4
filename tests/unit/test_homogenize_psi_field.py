"""The ψ fit from segments to a field: storage, standard errors, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.analytic_flow import ConvergingFlow

from granpipe.errors import DataError
from granpipe.field import Grid, divergence, flux_from_psi, level_flow
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import measure_plug
from granpipe.homogenize.psi_field import psi_field

FLOW = ConvergingFlow(height=1.0, upper_radius=0.5, lower_radius=0.35, solids_flow=0.02, packing=0.58)
GRID = Grid.covering(0.5, 0.0, 1.0, 0.025)
DIAMETER = 0.1
INSIDE = (GRID.r_edges[:-1] < FLOW.wall(GRID.z_centres)[0][:, None] - 1e-9).astype(float)
TRUTH = FLOW.flux(GRID.r_edges, GRID.z_edges)
PLUG = (0.0, 0.2)


def segments(count=8, noise=0.1, filling=0.0, seed=0):
    """Segments of the analytic flow with noise; of it, the share `filling` is gathered evenly over the height.

    What gathers makes the flow smaller the farther down, in the shape of the flow itself.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(count):
        excess = filling * GRID.z_edges
        flux_r = TRUTH[0] * (1 + 0.5 * (excess[1:] + excess[:-1]))[:, None]
        flux_z = TRUTH[1] * (1 + excess)[:, None]
        flux_r = flux_r + noise * rng.normal(size=flux_r.shape) * np.abs(flux_r)
        flux_z = flux_z + noise * rng.normal(size=flux_z.shape) * np.abs(flux_z)
        gain = filling * FLOW.solids_flow * np.diff(GRID.z_edges)[:, None] * INSIDE / INSIDE.sum(axis=1, keepdims=True)
        parts.append(
            Sums(
                grid=GRID,
                sampling="displacement",
                start=float(number),
                stop=number + 1.0,
                duration=1.0,
                weight=1.0,
                volume=FLOW.packing * INSIDE * GRID.cell_volume,
                flow_r=flux_r * GRID.side_area,
                flow_z=flux_z * GRID.ring_area,
                gain=gain,
                time=np.array([number + 0.5]),
                level_flow=level_flow(flux_z, GRID)[None],
                solids=np.zeros(1),
                kinetic=np.zeros(1),
                count=np.zeros(1),
            )
        )
    return parts


def fitted(parts):
    return psi_field(parts, INSIDE, measure_plug(merge(parts), INSIDE, PLUG, DIAMETER), DIAMETER, flow_scale=0.1)


def error(field):
    return np.sqrt((GRID.ring_area * (field.flux_z - TRUTH[1]) ** 2).sum() / (GRID.ring_area * TRUTH[1] ** 2).sum())


def test_the_field_comes_from_its_psi_and_conserves():
    parts = segments()
    field = fitted(parts).field
    plug = measure_plug(merge(parts), INSIDE, PLUG, DIAMETER)
    assert np.allclose(flux_from_psi(field.psi, GRID)[1], field.flux_z, atol=1e-15)
    assert np.abs(divergence(field.flux_r, field.flux_z, GRID)).max() * GRID.cell < 1e-12 * np.abs(field.flux_z).max()
    assert np.abs(level_flow(field.flux_z, GRID) / plug.solids_flow - 1).max() < 1e-10
    assert field.psi[:, -1] == pytest.approx(np.full(41, -plug.packing * plug.bulk_flow / (2 * np.pi)), rel=1e-12)
    assert np.array_equal(field.raw_flux_z, merge(parts).mean_flux[1])
    assert field.flow_scale == 0.1


def test_the_fit_is_nearer_to_the_truth_than_the_average():
    field = fitted(segments(noise=0.2)).field
    assert error(field) < 0.5 * error(replace(field, flux_z=field.raw_flux_z))


def test_what_the_filling_gains_is_taken_off_first():
    filling = fitted(segments(noise=0.02, filling=0.1))
    steady = fitted(segments(noise=0.02))
    assert filling.storage == pytest.approx(0.09, abs=0.005)  # from the middle of the plug to the top
    assert steady.storage < 1e-12
    assert error(filling.field) < 1.5 * error(steady.field)
    assert error(filling.field) < 0.02


def test_a_vessel_that_fills_fast_is_refused():
    with pytest.raises(DataError, match=r"filling changes too fast.* 2[67]% of the flow gathers, of which 20%"):
        fitted(segments(filling=0.3))


def test_a_level_without_flow_is_named():
    parts = [replace(part, flow_z=np.where(np.arange(41)[:, None] == 30, 0, part.flow_z)) for part in segments()]
    with pytest.raises(DataError, match=r"no downward flow through z = 0\.75 m"):
        fitted(parts)


def test_standard_errors_need_seven_segments():
    few, enough = fitted(segments(6)), fitted(segments(7))
    assert few.field.flux_z_se is None
    assert few.field.raw_flux_z_se is None
    assert few.blocks == 6
    assert enough.blocks == 7
    for se, flux in ((enough.field.flux_r_se, enough.field.flux_r), (enough.field.raw_flux_z_se, enough.field.flux_z)):
        assert se.shape == flux.shape


def test_standard_errors_are_those_of_repeated_runs():
    # errors of final fields over independent runs against what each run says of itself
    fields = [fitted(segments(8, noise=0.3, seed=seed)).field for seed in range(16)]
    spread = np.std([field.flux_z for field in fields], axis=0)
    told = np.sqrt(np.mean([field.flux_z_se**2 for field in fields], axis=0))
    flowing = (np.abs(TRUTH[1]) > 0.05 * np.abs(TRUTH[1]).max()) & (spread > 0)
    assert np.median(told[flowing] / spread[flowing]) == pytest.approx(1, abs=0.3)


def test_noisier_runs_are_smoothed_more():
    assert fitted(segments(noise=0.5)).smoothing_length > fitted(segments(noise=0.01)).smoothing_length


def test_one_segment_or_equal_ones_give_no_weights():
    with pytest.raises(DataError, match="two segments or more"):
        fitted(segments(1))
    with pytest.raises(DataError, match="do not differ at all"):
        fitted(segments(noise=0.0))
