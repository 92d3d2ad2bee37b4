"""The hybrid's force: it makes the fluid follow a known flow where it should, and leaves it alone elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, level_flow
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.forcing import KnownFlow
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

GRID = Grid.covering(1.0, 0.0, 6.0, 0.05)


@pytest.fixture(scope="module")
def pipe() -> RZMesh:
    return mesh_section(np.array([[1.0, 6.0], [1.0, 0.0]]), {}, {}, bands=[(1.0, 5.0, 0.1)])


def blunt(r: Array) -> Array:
    """(…) ψ of a flow of 1 m³/s that no fluid has of its own accord: w = −3/(2π) (1 − r⁴)."""
    return -3 / (2 * np.pi) * (r**2 / 2 - r**6 / 6)


PROFILE = 2 * np.diff(blunt(GRID.r_edges)) / np.diff(GRID.r_edges**2)
PSI = 7.0 * np.tile(blunt(GRID.r_edges), (len(GRID.z_edges), 1))


def known(factor: float = 1e5, intervals: tuple = ((2.0, 4.0),)) -> KnownFlow:
    return KnownFlow(GRID.r_edges, GRID.z_edges, PSI, intervals, 0.5, factor)


def errors(solution: FluidSolution) -> tuple[float, float]:
    """Largest error in w over the mean speed: to the known flow at z = 3, and to a plug at z = 5.7."""
    field = to_field(solution, GRID, np.ones(GRID.shape), 1.0)
    inside, above = (field.flux_z[np.abs(GRID.z_edges - z).argmin()] for z in (3.0, 5.7))
    return np.pi * np.abs(inside - PROFILE).max(), np.pi * np.abs(above + 1 / np.pi).max()


def conserving(field: Field) -> None:
    np.testing.assert_allclose(level_flow(field.flux_z, field.grid), field.bulk_flow, rtol=1e-12)


def test_force_has_full_strength_in_its_intervals_and_fades_by_a_quintic():
    flow = known(intervals=((2.0, 3.0), (3.0, 4.0)))
    z = np.array([1.0, 1.5, 1.75, 2.0, 3.0, 4.0, 4.25, 4.5])
    np.testing.assert_allclose(flow.strength(z), [0, 0, 0.5, 1, 1, 1, 0.5, 0], atol=1e-15)
    slope = np.diff(flow.strength(np.array([1.5, 1.5 + 1e-4, 2.0 - 1e-4, 2.0])))[[0, 2]]
    assert np.abs(slope).max() < 1e-10


def test_known_flow_is_scaled_by_the_flow_measured_on_it():
    flow = known()
    assert flow.flow == pytest.approx(7.0)
    r, z = np.array([0.0, 0.33, 0.7]), np.array([1.2, 3.03, 4.4])
    u, w = flow.velocity()(r, z)
    np.testing.assert_allclose(u, 0, atol=1e-10)
    np.testing.assert_allclose(w, -1.5 / np.pi * (1 - r**4), rtol=1e-10)


def test_fluid_follows_the_known_flow_and_is_a_plug_elsewhere(pipe):
    solution = solve_fluid(pipe, WallLaw(), 1.0, known=known())
    inside, outside = errors(solution)
    assert inside < 2e-3
    assert outside < 2e-2
    conserving(to_field(solution, GRID, np.ones(GRID.shape), 1.0))


@pytest.mark.parametrize("factor", [1e4, 1e6])
def test_the_default_force_lies_on_a_plateau(pipe, factor):
    default, other = (errors(solve_fluid(pipe, WallLaw(), 1.0, known=known(K))) for K in (1e5, factor))
    assert np.abs(np.array(default) - other).max() < 0.01


def test_a_weak_force_does_not_suffice(pipe):
    assert errors(solve_fluid(pipe, WallLaw(), 1.0, known=known(1.0)))[0] > 0.05


@pytest.mark.parametrize("factor", [1.0, 1e10, 1e14])
def test_any_force_is_solved_and_conserves(pipe, factor):
    solution = solve_fluid(pipe, WallLaw(), 3.0, known=known(factor))
    assert solution.residual < 1e-12
    conserving(to_field(solution, GRID, np.ones(GRID.shape), 1.0))


def test_walls_move_as_the_known_flow_does_where_it_is_followed(pipe):
    solution = solve_fluid(pipe, WallLaw(), 1.0, known=known())
    r, z = pipe.points.T
    forced, free = (np.flatnonzero((r == 1) & (z > low) & (z < high)) for low, high in ((2.5, 3.5), (5.2, 5.9)))
    np.testing.assert_allclose(np.pi * solution.w[forced], 0, atol=0.02)  # known to be at rest
    np.testing.assert_allclose(np.pi * solution.w[free], -1, atol=0.02)


def test_force_reaches_the_outlet_where_an_interval_does(pipe):
    flow = known(intervals=((0.0, 4.0),))
    field = to_field(solve_fluid(pipe, WallLaw(), 1.0, known=flow), GRID, np.ones(GRID.shape), 1.0)
    np.testing.assert_allclose(np.pi * field.flux_z[1], np.pi * PROFILE, atol=0.02)


def test_known_flow_that_ends_too_early_is_refused(pipe):
    half = KnownFlow(GRID.r_edges, GRID.z_edges[:61], PSI[:61], ((0.0, 3.0),), 0.5)
    with pytest.raises(DataError, match=r"covers z 0 to 3 m, but with its ramps .* from 0 to 3.5 m"):
        solve_fluid(pipe, WallLaw(), 1.0, known=half)


def test_the_size_of_the_vessel_changes_nothing(pipe):
    size = 2.0**-6
    small_mesh = RZMesh(pipe.points * size, pipe.triangles, pipe.edges, pipe.names)
    flow = KnownFlow(GRID.r_edges * size, GRID.z_edges * size, PSI, ((2 * size, 4 * size),), 0.5 * size)
    large = solve_fluid(pipe, WallLaw(), 1.0, known=known())
    small = solve_fluid(small_mesh, WallLaw(), 1.0, known=flow)
    np.testing.assert_allclose(small.w * size**2, large.w, rtol=1e-9)
