"""The ψ fit: conditions on the nodes, exact recovery, what smoothing leaves alone."""

import numpy as np
import pytest

from granpipe.errors import DataError
from granpipe.field import Grid, divergence, flux_from_psi, level_flow
from granpipe.homogenize.psi_fit import AXIS, FREE, WALL, NormalEquations, Weights, node_roles

GRID = Grid.covering(0.4, 0.0, 0.6, 0.02)
ROWS, COLUMNS = GRID.shape
FLOW = 0.03


def even_weights():
    return Weights(np.tile(np.maximum(GRID.side_area, 1e-4), (ROWS, 1)), np.tile(GRID.ring_area, (ROWS + 1, 1)))


def open_cells():
    return np.ones(GRID.shape)


def fitted(inside, bulk, flux, smoothing_length=0.0, clearance=0.0, flow=FLOW):
    fit = NormalEquations(GRID, node_roles(inside, bulk), even_weights(), clearance).fit(smoothing_length)
    return fit.solve(*flux, flow)


def plug_psi(radius=0.4, flow=FLOW):
    r = np.minimum(GRID.r_edges / radius, 1)
    return np.tile(-flow / (2 * np.pi) * r**2, (ROWS + 1, 1))


def test_axis_wall_and_nodes_between_have_their_roles():
    inside = open_cells()
    inside[:10, 15:] = 0
    roles = node_roles(inside, inside > 0)
    assert (roles[:, 0] == AXIS).all()
    assert (roles[:11, 15:] == WALL).all()
    assert (roles[:10, 1:15] == FREE).all()
    assert (roles[11:, 20] == WALL).all()
    assert (roles[11:, 1:20] == FREE).all()


def test_a_cavity_under_a_ring_on_the_wall_has_the_walls_psi():
    inside, bulk = open_cells(), np.ones(GRID.shape, dtype=bool)
    inside[14:17, 12:] = 0
    bulk[14:17, 12:] = False
    bulk[10:14, 14:] = False
    assert (node_roles(inside, bulk)[10:18, 14:] == WALL).all()


def test_what_stands_on_the_axis_has_its_psi():
    inside = open_cells()
    inside[12:16, :5] = 0
    roles = node_roles(inside, inside > 0)
    assert (roles[12:17, :6] == AXIS).all()
    assert (roles[12:17, 6:20] == FREE).all()


def test_free_rings_are_bodies_of_their_own():
    inside = open_cells()
    inside[5:8, 6:9] = 0
    inside[20:23, 10:13] = 0
    roles = node_roles(inside, inside > 0)
    assert len({*roles[5:9, 6:10].ravel()}) == len({*roles[20:24, 10:14].ravel()}) == 1
    assert {roles[5, 6], roles[20, 10]} == {WALL + 1, WALL + 2}


def test_a_vessel_without_passage_is_refused():
    inside = open_cells()
    inside[9] = 0
    with pytest.raises(DataError, match="no passage"):
        node_roles(inside, inside > 0)


def test_data_that_have_a_stream_function_give_it_back():
    rng = np.random.default_rng(0)
    psi = plug_psi() + 0.001 * rng.normal(size=(ROWS + 1, COLUMNS + 1))
    psi[:, 0], psi[:, -1] = 0, -FLOW / (2 * np.pi)
    assert np.allclose(fitted(open_cells(), open_cells() > 0, flux_from_psi(psi, GRID)), psi, atol=1e-12)


def test_a_free_ring_finds_how_much_passes_on_either_side():
    inside = open_cells()
    inside[12:16, 8:12] = 0
    roles = node_roles(inside, inside > 0)
    psi = plug_psi()
    psi[roles > WALL] = -0.3 * FLOW / (2 * np.pi)
    found = fitted(inside, inside > 0, flux_from_psi(psi, GRID))
    assert np.allclose(found, psi, atol=1e-12)


def test_the_fit_conserves_in_every_cell_and_carries_the_flow_through_every_level():
    rng = np.random.default_rng(1)
    flux = rng.normal(size=(ROWS, COLUMNS + 1)), rng.normal(-0.2, 1, size=(ROWS + 1, COLUMNS))
    flux_r, flux_z = flux_from_psi(fitted(open_cells(), open_cells() > 0, flux, 0.04, 0.05), GRID)
    assert np.abs(divergence(flux_r, flux_z, GRID)).max() * GRID.cell < 1e-12 * np.abs(flux_z).max()
    assert np.allclose(level_flow(flux_z, GRID), FLOW, rtol=1e-12)


def test_void_carries_nothing():
    bulk = np.ones(GRID.shape, dtype=bool)
    bulk[10:16, 12:] = False
    rng = np.random.default_rng(2)
    flux = rng.normal(size=(ROWS, COLUMNS + 1)), rng.normal(size=(ROWS + 1, COLUMNS))
    flux_r, flux_z = flux_from_psi(fitted(open_cells(), bulk, flux, 0.04, 0.05), GRID)
    assert not flux_r[10:16, 12:].any()
    assert not flux_z[10:17, 12:].any()


@pytest.mark.parametrize("name", ["plug", "linear convergence", "shear"])
def test_smoothing_leaves_what_has_no_curvature_as_it_is_up_to_axis_and_ends(name):
    r, z = np.meshgrid(GRID.r_edges, GRID.z_edges)
    psi = {
        "plug": plug_psi(),
        "linear convergence": plug_psi() * (1 + 2 * z),  # w linear in z, u linear in r
        "shear": plug_psi() * (1 + 0.5 * r),  # w linear in r, but for the axis
    }[name]
    fit = NormalEquations(GRID, node_roles(open_cells(), open_cells() > 0), even_weights(), 0.0).fit(0.2)
    bend = sum(
        np.abs(bend @ flux.ravel()).reshape(flux.shape)[3:-3, 2:-2].max()
        for flux, mirror in zip(flux_from_psi(psi, GRID), (-1, 1), strict=True)
        for bend, _ in module_second_differences(flux.shape, mirror)
    )
    scale = np.abs(flux_from_psi(psi, GRID)[1]).max()
    assert bend < (1e-12 if name != "shear" else 3e-3) * scale
    if name == "plug":
        assert np.allclose(fit.solve(*flux_from_psi(psi, GRID), FLOW), psi, atol=1e-14)


def module_second_differences(shape, mirror):
    from granpipe.homogenize.psi_fit import _second_differences

    return _second_differences(np.ones(shape, dtype=bool), mirror)


@pytest.mark.parametrize(("wavelength", "passes"), [(0.4, 0.9), (0.25, 0.6)])
def test_long_waves_pass_and_short_ones_do_not(wavelength, passes):
    # ψ waves along z of amplitude independent of r away from axis and wall: the filter is 1/(1 + (ℓk)⁴)
    length = 0.03
    z = GRID.z_edges[:, None]
    wave = 1e-3 * np.sin(2 * np.pi * z / wavelength) * np.sin(np.pi * GRID.r_edges / 0.4) ** 2
    found = fitted(open_cells(), open_cells() > 0, flux_from_psi(plug_psi() + wave, GRID), length) - plug_psi()
    middle = slice(8, -8), slice(6, -6)
    kept = (found[middle] * wave[middle]).sum() / (wave[middle] ** 2).sum()
    assert kept > passes
    short = 1e-3 * np.sin(2 * np.pi * z / 0.06) * np.sin(np.pi * GRID.r_edges / 0.4) ** 2
    found = fitted(open_cells(), open_cells() > 0, flux_from_psi(plug_psi() + short, GRID), length) - plug_psi()
    assert (found[middle] * short[middle]).sum() < 0.1 * (short[middle] ** 2).sum()


def test_nothing_is_smoothed_within_the_clearance():
    # all faces lie within it: the fit is the plain least-squares one
    rng = np.random.default_rng(3)
    flux = rng.normal(size=(ROWS, COLUMNS + 1)), rng.normal(size=(ROWS + 1, COLUMNS))
    assert np.allclose(
        fitted(open_cells(), open_cells() > 0, flux, 0.1, 1.0), fitted(open_cells(), open_cells() > 0, flux), atol=1e-12
    )


def test_faces_of_low_weight_give_way():
    # two contradicting levels: the result follows the one that is known better
    psi = plug_psi()
    flux_r, flux_z = flux_from_psi(psi, GRID)
    rng = np.random.default_rng(4)
    noise = rng.normal(size=flux_z.shape) * np.abs(flux_z)
    noise[:, COLUMNS // 2 :] *= 0.01
    errors = []
    for weight in (
        np.ones_like(flux_z),
        np.where(np.arange(COLUMNS) < COLUMNS // 2, 1e-4, 1.0) * np.ones((ROWS + 1, 1)),
    ):
        even = even_weights()
        fit = NormalEquations(
            GRID, node_roles(open_cells(), open_cells() > 0), Weights(even.r, even.z * weight), 0
        ).fit(0)
        errors.append(np.linalg.norm(fit.solve(flux_r, flux_z + noise, FLOW) - psi))
    assert errors[1] < 0.7 * errors[0]
