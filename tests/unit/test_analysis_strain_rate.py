"""Rate of strain against flows whose gradients are known in closed form."""

import numpy as np
import pytest

from granpipe.analysis.strain_rate import COMPONENTS, shear_rate, shear_rate_change, strain_rate
from granpipe.field import Field, Grid, flux_from_psi
from granpipe.pipeline.extra_fields import strain_errors, with_derived

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


def test_errors_are_those_of_the_blocks():
    """Blocks that are a parabola times (1 + e): every component errs by the scatter of e."""
    field = field_of(lambda r, z: -(r**2 / 2 - r**4 / (4 * 0.09)))
    scatter = np.random.default_rng(0).normal(0, 0.1, 12)
    found = strain_errors(field, [(field.flux_r * (1 + e), field.flux_z * (1 + e)) for e in scatter], 8.0)
    strain = strain_rate(field)
    share = scatter.std() / np.sqrt(7)
    assert found["strain_rz_se"] == pytest.approx(share * np.abs(strain[3]), rel=1e-9, abs=1e-12)
    assert found["shear_rate_se"] == pytest.approx(share * shear_rate(strain), rel=1e-9, abs=1e-9)
    assert set(found) == {f"{name}_se" for name in (*COMPONENTS, "shear_rate")}


def test_a_change_of_the_shear_rate_is_linear_in_small_changes():
    strain, _, _ = sink(0.01)
    other = strain * (1 + 1e-6 * np.arange(4))[:, None, None]
    exact = shear_rate(other) - shear_rate(strain)
    assert shear_rate_change(strain, other) == pytest.approx(exact, rel=1e-4, abs=1e-12)


def test_fields_of_any_model_have_it_on_request():
    field, _ = with_derived(field_of(lambda r, z: -(r**2)), ["strain_rate"])
    assert set(field.extra) == {*COMPONENTS, "shear_rate"}
    field.check()
