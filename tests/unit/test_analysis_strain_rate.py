"""Rate of strain against flows whose gradients are known in closed form."""

import numpy as np
import pytest

from granpipe.analysis.strain_rate import COMPONENTS, shear_rate, strain_rate
from granpipe.field import Field, Grid, flux_from_psi
from granpipe.homogenize.average import Sums
from granpipe.homogenize.solids_velocity import solids_velocity, window_cells
from granpipe.pipeline.extra_fields import with_derived

PACKING = 0.6


def field_of(psi, cell=0.01, radius=0.3, low=0.5, high=0.9):
    grid = Grid.covering(radius, low, high, cell)
    r, z = np.meshgrid(grid.r_edges, grid.z_edges)
    flux = flux_from_psi(PACKING * psi(r, z), grid)
    flow = -2 * np.pi * psi(radius, low)
    ones = np.ones(grid.shape)
    return Field(grid, ones, ones > 0, *flux, bulk_flow=flow, bulk_packing=PACKING, flow_scale=0.1)


def centres(field):
    return np.meshgrid(field.grid.r_centres, field.grid.z_centres)


def test_stretching_is_exact():
    """u = −a r/2, w = a z."""
    rr, tt, zz, rz = strain_rate(field_of(lambda r, z: 2.0 * z * r**2 / 2))
    for found, exact in ((rr, -1), (tt, -1), (zz, 2), (rz, 0)):
        assert found == pytest.approx(exact, abs=1e-10)


def test_a_parabola_is_pure_shear():
    """w = −(1 − r²/R²): D_rz = r/R², the shear rate twice that; beside the wall it is that of the nodes inside."""
    field = field_of(lambda r, z: -(r**2 / 2 - r**4 / (4 * 0.09)))
    strain = strain_rate(field)
    r, _ = centres(field)
    inner = np.s_[:, :-1]
    assert strain[3][inner] == pytest.approx((r / 0.09)[inner], rel=1e-3, abs=2e-2)
    assert strain[:3] == pytest.approx(0, abs=1e-10)
    assert shear_rate(strain)[inner] == pytest.approx((2 * r / 0.09)[inner], rel=1e-3, abs=4e-2)
    assert strain[3][:, -1] == pytest.approx((0.3 - 0.01) / 0.09, rel=1e-3)


def sink(cell):
    """v = −x/R³ towards the origin: D_ij = −δ_ij/R³ + 3 x_i x_j/R⁵."""
    field = field_of(lambda r, z: z / np.hypot(r, z) - 1, cell)
    r, z = centres(field)
    R = np.hypot(r, z)
    exact = np.array([-1 / R**3 + 3 * r**2 / R**5, -1 / R**3, -1 / R**3 + 3 * z**2 / R**5, 3 * r * z / R**5])
    strain = strain_rate(field)
    inner = np.s_[:, 1:-1, :-1]
    return strain, exact, np.abs(strain - exact)[inner].max() / np.abs(exact).max()


def test_a_point_sink_converges_at_second_order():
    errors = [sink(cell)[2] for cell in (0.02, 0.01, 0.005)]
    assert errors[1] < 0.005
    assert errors[0] / errors[1] > 3.4
    assert errors[1] / errors[2] > 3.4


def test_what_conserves_has_no_trace():
    strain, _, _ = sink(0.01)
    assert strain[:3].sum(axis=0) == pytest.approx(0, abs=1e-9)


def test_cells_that_a_wall_cuts_and_voids_have_none():
    field = field_of(lambda r, z: -(r**2))
    field.inside_fraction[:, -1] = 0.7
    field.bulk[:5] = False
    strain = strain_rate(field)
    assert np.isnan(strain[:, :, -1]).all()
    assert np.isnan(strain[:, :5]).all()
    assert strain[:, 5:, :-1] == pytest.approx(0, abs=1e-9)


def sums_of(packing, w, cell=0.005, radius=0.1):
    """Sums over one second of solids (r) that sink at w(r) in a pipe."""
    grid = Grid.covering(radius, 0.0, 0.2, cell)
    r = grid.r_centres
    flux = np.broadcast_to(packing(r) * w(r) * grid.ring_area, (grid.shape[0] + 1, grid.shape[1]))
    nothing = np.zeros((grid.shape[0], grid.shape[1] + 1))
    return Sums(
        grid=grid, sampling="displacement", start=0.0, stop=1.0, duration=1.0, weight=1.0,
        volume=packing(r) * grid.cell_volume * np.ones(grid.shape), flow_r=nothing, flow_z=flux,
        gain=np.zeros(grid.shape), time=np.array([0.5]), level_flow=flux.sum(axis=1)[None], solids=np.array([1.0]),
        kinetic=np.array([1.0]), count=np.array([1]),
    )  # fmt: skip


def layers(r):
    """Packing of layers, 20 mm wide, along a wall at 100 mm."""
    return 0.6 * (1 + 0.4 * np.cos(2 * np.pi * (0.1 - r) / 0.02))


def rates(sums, diameter):
    ones = np.ones(sums.grid.shape)
    field = Field(sums.grid, ones, ones > 0, *sums.mean_flux, bulk_flow=1.0, bulk_packing=PACKING, flow_scale=0.1)
    return shear_rate(strain_rate(field, solids_velocity(sums, diameter))), shear_rate(strain_rate(field))


def test_layers_that_sink_as_one_are_not_sheared_though_their_flux_is_uneven():
    solids, bulk = rates(sums_of(layers, lambda r: -0.04 + 0 * r), 0.02)
    assert np.abs(solids).max() < 1e-9
    assert bulk.max() > 0.04 * 0.4 / 0.005 / 4


def test_solids_in_layers_are_sheared_as_their_velocity_says():
    """w = −0.04 + 2 r: the shear rate is 2 1/s, to what the weights of a layer's two sides change."""
    solids, _ = rates(sums_of(layers, lambda r: -0.04 + 2 * r), 0.02)
    inner = solids[5:-5, 4:-4]
    assert inner == pytest.approx(2, rel=0.35)
    assert inner.mean() == pytest.approx(2, rel=0.03)


def test_solids_without_layers_are_sheared_exactly_so():
    solids, _ = rates(sums_of(lambda r: 0.6 + 0 * r, lambda r: -0.04 + 2 * r), 0.005)
    assert solids[:, 1:-1] == pytest.approx(2, rel=1e-9)


@pytest.mark.parametrize(("diameter", "cells"), [(0.004, 1), (0.01, 1), (0.011, 3), (0.02, 5), (0.026, 5), (1e-9, 1)])
def test_the_window_is_about_a_particle_wide(diameter, cells):
    assert window_cells(diameter, 0.005) == cells


def test_fields_of_any_model_have_it_on_request():
    field, _ = with_derived(field_of(lambda r, z: -(r**2)), ["strain_rate"])
    assert set(field.extra) == {*COMPONENTS, "shear_rate"}
    field.check()
