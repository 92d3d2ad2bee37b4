"""Nodal values: exact where the flow is simple, one-sided at walls and voids, absent where the model knows nothing."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.synthetic import PACKING, SCALE, field_of, hopper, pipe, ring_vessel

from granpipe.errors import DataError
from granpipe.export.nodes import nodal_values, triangles
from granpipe.field import Field, Grid


def truth(vessel, nodes):
    return vessel.bulk_velocity(nodes.r[None, :], nodes.z[:, None])


def two_streams(between_inside: float) -> Field:
    """Five columns that sink at 1, 1, (nothing), 3, 3 m/s; the middle one is a void (1) or a wall (0)."""
    grid = Grid(0.1 * np.arange(6), 0.1 * np.arange(5))
    inside = np.ones((4, 5))
    inside[:, 2] = between_inside
    bulk = np.ones((4, 5), bool)
    bulk[:, 2] = False
    flux_z = np.tile([-1.0, -1.0, 0.0, -3.0, -3.0], (5, 1))
    return Field(
        grid=grid,
        inside_fraction=inside,
        bulk=bulk,
        flux_r=np.zeros((4, 6)),
        flux_z=flux_z,
        bulk_flow=1.0,
        bulk_packing=1.0,
        flow_scale=1.0,
    )


@pytest.mark.parametrize("curvature", [0.0, 1.0])
def test_plug_and_parabola_are_exact_from_the_axis_to_the_wall(curvature: float) -> None:
    vessel = pipe(curvature)
    nodes = nodal_values(field_of(vessel, 0.05))
    u, w = truth(vessel, nodes)
    assert nodes.solids.all()
    np.testing.assert_allclose(nodes.bulk_w, w, atol=1e-12 * np.abs(w).max())
    np.testing.assert_allclose(nodes.bulk_u, u, atol=1e-12 * np.abs(w).max())


def test_a_wall_inside_the_last_cells_changes_nothing_for_a_plug() -> None:
    vessel = pipe(radius=0.47)  # the grid of 0.05 ends at 0.5
    nodes = nodal_values(field_of(vessel, 0.05))
    assert nodes.r[-1] == pytest.approx(0.5)
    np.testing.assert_allclose(nodes.bulk_w, vessel.bulk_velocity(0.0, 0.5)[1], rtol=1e-12)


def test_radial_velocity_is_zero_on_the_axis() -> None:
    field = field_of(hopper(), 0.05)
    field.flux_r[:, 0] = 1.0  # of a face without area: means nothing
    nodes = nodal_values(field)
    assert (nodes.bulk_u[:, 0] == 0).all()
    assert (nodes.particle_u[:, 0] == 0).all()
    assert np.abs(nodes.bulk_u[:, 1]).max() > 0


@pytest.mark.parametrize("between", [1.0, 0.0], ids=["void", "wall"])
def test_nothing_is_averaged_across_a_void_or_a_wall(between: float) -> None:
    nodes = nodal_values(two_streams(between))
    np.testing.assert_allclose(nodes.bulk_w, np.tile([-1.0, -1.0, -1.0, -3.0, -3.0, -3.0], (5, 1)), rtol=1e-12)


def test_a_void_two_nodes_wide_is_at_rest() -> None:
    field = field_of(ring_vessel(), 0.05)
    nodes = nodal_values(field)
    in_void = ring_vessel().void(nodes.r[None, :], nodes.z[:, None]) & ~nodes.solids
    assert in_void.sum() > 10
    for values in (nodes.bulk_u, nodes.bulk_w, nodes.particle_u, nodes.particle_w, nodes.packing):
        assert (values[in_void] == 0).all()


def test_a_stagnant_heap_is_solid_and_at_rest() -> None:
    vessel = ring_vessel()
    nodes = nodal_values(field_of(vessel, 0.02))
    r, z = np.meshgrid(nodes.r, nodes.z)
    heap = (r > vessel.boundary(z) + 0.02) & (z > 1.05) & (z < 1.5) & (r < 0.5)
    assert nodes.solids[heap].all()
    assert (nodes.bulk_w[heap] == 0).all()
    assert nodes.packing[heap] == pytest.approx(PACKING)


def test_particle_velocity_divides_by_the_packing_at_the_place() -> None:
    field = field_of(pipe(), 0.05)
    packing = np.where(np.arange(len(field.grid.z_centres))[:, None] < 10, 0.4, 0.6) * np.ones(field.grid.shape)
    nodes = nodal_values(replace(field, packing_fraction=packing))
    flux = field.flux_z[0, 0] * SCALE
    np.testing.assert_allclose(nodes.particle_w[:10], flux / 0.4, rtol=1e-12)
    np.testing.assert_allclose(nodes.particle_w[10], flux / 0.5, rtol=1e-12)
    np.testing.assert_allclose(nodes.particle_w[11:], flux / 0.6, rtol=1e-12)
    np.testing.assert_allclose(nodes.packing[10], 0.5, rtol=1e-12)


def test_packing_at_the_edge_of_a_void_is_that_of_the_solids() -> None:
    field = field_of(ring_vessel(), 0.05)
    nodes = nodal_values(field)
    assert nodes.packing[nodes.solids] == pytest.approx(PACKING)


def test_what_the_field_does_not_know_is_absent() -> None:
    nodes = nodal_values(field_of(pipe(), 0.1, with_psi=False, with_packing=False))
    assert nodes.psi is None
    assert nodes.packing is None
    assert nodes.particle_u is None
    assert nodes.particle_w is None


def test_the_stream_function_is_that_of_the_bulk_velocity() -> None:
    vessel = pipe()
    nodes = nodal_values(field_of(vessel, 0.1))
    w = 2 * np.diff(nodes.psi, axis=1) / np.diff(nodes.r**2)
    np.testing.assert_allclose(w, vessel.bulk_velocity(0.0, 0.5)[1], rtol=1e-12)


@pytest.mark.parametrize("least", [0.0, 0.5], ids=["every cell inside is bulk", "half a cell inside is bulk"])
def test_sloping_walls_leave_no_gap(least: float) -> None:
    vessel = hopper()
    field = field_of(vessel, 0.05)
    nodes = nodal_values(replace(field, bulk=field.bulk & (field.inside_fraction >= least)))
    r, z = np.random.default_rng(1).uniform([0, 0], [0.5, 1], (4000, 2)).T
    inside = r < vessel.boundary(z) - 0.002
    ir, iz = np.searchsorted(nodes.r, r) - 1, np.searchsorted(nodes.z, z) - 1
    assert nodes.cells[iz[inside], ir[inside]].all()


def test_a_passage_of_one_and_a_half_cells_still_flows() -> None:
    vessel = pipe(radius=0.075)  # cells of 0.1, none wholly inside
    nodes = nodal_values(field_of(vessel, 0.1))
    np.testing.assert_allclose(nodes.bulk_w, vessel.bulk_velocity(0.0, 0.5)[1], rtol=0.03)


def test_triangles_cover_the_solid_cells_once() -> None:
    nodes = nodal_values(field_of(ring_vessel(), 0.05))
    r, z = (axis.ravel()[triangles(nodes)] for axis in np.meshgrid(nodes.r, nodes.z))
    area = 0.5 * ((r[:, 1] - r[:, 0]) * (z[:, 2] - z[:, 0]) - (r[:, 2] - r[:, 0]) * (z[:, 1] - z[:, 0]))
    np.testing.assert_allclose(area, 0.05**2 / 2, rtol=1e-9)  # positive: anticlockwise
    assert len(area) == 2 * nodes.cells.sum()


def test_a_field_with_nan_in_the_solids_is_refused() -> None:
    field = field_of(pipe(), 0.1)
    field.flux_z[3, 2] = np.nan
    with pytest.raises(DataError, match=r"bulk_w is not a number at r = 0.2 m, z = 0.3 m"):
        nodal_values(field)


def test_nan_packing_outside_the_vessel_does_no_harm() -> None:
    field = field_of(ring_vessel(), 0.05)
    packing = np.where(field.inside_fraction > 0, field.packing_fraction, np.nan)
    nodes = nodal_values(replace(field, packing_fraction=packing))
    assert np.isfinite(nodes.packing).all()
