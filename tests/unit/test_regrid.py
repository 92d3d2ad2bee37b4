"""A field on other cells of its vessel: conserving, exact where it can be, and no less noisy for being joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.converging_scene import FLOW, RADIUS
from fakes.synthetic import field_of, hopper, ring_vessel

from granpipe.analysis.compare import compare
from granpipe.analysis.regrid import on_grid
from granpipe.errors import DataError
from granpipe.field import Field, Grid, divergence, flux_from_psi


def cone(cell: float) -> Field:
    """ψ of a flow that narrows, linear in r² and z."""
    grid = Grid.covering(0.5, 0.0, 1.0, cell)
    psi = -0.1 * grid.r_edges**2 * (1 + grid.z_edges[:, None])
    flux_r, flux_z = flux_from_psi(psi, grid)
    ones, (r_se, z_se) = np.ones(grid.shape), (np.full_like(flux_r, 0.1), np.full_like(flux_z, 0.2))
    return Field(grid, ones, ones > 0, flux_r, flux_z, 1.0, 1.0, 1.0, psi=psi, flux_r_se=r_se, flux_z_se=z_se)


def smeared(cell: float) -> Field:
    """The converging flow as spheres of 6 cm show it: its truth on any cells."""
    grid = Grid.covering(FLOW.upper_radius + RADIUS, 0.0, FLOW.height, cell)
    _, flux_z = FLOW.smeared_flux(grid.r_edges, grid.z_edges, RADIUS, 256)
    psi = np.pad(np.cumsum(flux_z * grid.ring_area, axis=1), ((0, 0), (1, 0))) / (2 * np.pi)
    ones = np.ones(grid.shape)
    return Field(grid, ones, ones > 0, *flux_from_psi(psi, grid), 1.0, 1.0, 1.0, psi=psi)


@pytest.mark.parametrize("cell", [0.05, 0.0125, 0.0171])
def test_a_flow_linear_in_r_squared_and_z_stays_what_it_is_and_conserves(cell: float) -> None:
    grid = cone(cell).grid
    made = on_grid(cone(0.025), grid, np.ones(grid.shape))
    inner = made.flux_z[:, :-1]  # the last cell may reach beyond the field
    assert np.allclose(inner, -0.2 * (1 + grid.z_edges[:, None]))
    assert np.abs(divergence(made.flux_r, made.flux_z, grid)[:, :-1]).max() < 1e-12


def test_an_error_stays_as_large_on_smaller_and_on_larger_cells() -> None:
    for cell in (0.0125, 0.05):
        grid = cone(cell).grid
        made = on_grid(cone(0.025), grid, np.ones(grid.shape))
        assert made.flux_r_se is not None
        assert made.flux_z_se is not None
        assert np.allclose(made.flux_r_se, 0.1)
        assert np.allclose(made.flux_z_se, 0.2)


def test_where_no_error_is_known_none_is_made_up() -> None:
    known = cone(0.025)
    errors = np.where(np.arange(known.grid.shape[1]) < 10, 0.2, np.nan) * np.ones_like(known.flux_z)
    coarse = cone(0.05)
    made = on_grid(replace(known, flux_z_se=errors), coarse.grid, coarse.inside_fraction)
    assert made.flux_z_se is not None
    assert np.allclose(made.flux_z_se[:, :5], 0.2)
    assert np.isnan(made.flux_z_se[:, 5:]).all()


def test_joined_cells_hold_the_means_of_what_they_join() -> None:
    fine, coarse = field_of(ring_vessel(), 0.0125), field_of(ring_vessel(), 0.025)
    made = on_grid(fine, coarse.grid, coarse.inside_fraction)
    assert np.allclose(made.flux_z, coarse.flux_z)
    assert np.allclose(made.flux_r, coarse.flux_r)
    assert (made.bulk != coarse.bulk).sum() <= 2  # at the void's edge


@pytest.mark.parametrize(("cell", "most"), [(0.01, 0.006), (0.015, 0.01), (0.0171, 0.0125)])
def test_from_smaller_cells_a_smeared_flow_is_within_a_hundredth(cell: float, most: float) -> None:
    """As of particles two thirds as large with four cells each, and of cells that are smaller and larger than those."""
    coarse = smeared(0.0219)
    made = on_grid(smeared(cell), coarse.grid, coarse.inside_fraction)
    assert compare(coarse, made, {}, 0.06)[0].observed < most


def test_own_cells_leave_the_field_as_it_is() -> None:
    field = cone(0.025)
    assert on_grid(field, cone(0.025).grid, field.inside_fraction) is field


def test_without_a_stream_function_the_remedy_is_told() -> None:
    field = field_of(hopper(), 0.05, with_psi=False)
    grid = field_of(hopper(), 0.025).grid
    with pytest.raises(DataError, match=r"homogenize\.method: psi"):
        on_grid(field, grid, np.ones(grid.shape))
