"""`Flow` between nodes: exact for plug and parabola, of second order in a cone, conserving, NaN outside the solids."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.synthetic import FLOW, PACKING, SCALE, field_of, hopper, pipe, ring_vessel

from granpipe import DataError, Flow, SpaceFlow
from granpipe.field import Box, Field, flux_from_psi
from granpipe.geometry.outline import Outline

RATE = FLOW * SCALE  # bulk flow rate of the process [m³/s]


def outline_of(vessel) -> Outline:
    return Outline.of(vessel.wall, vessel.obstacles, {})


@pytest.fixture(scope="module")
def points():
    rng = np.random.default_rng(1)
    return rng.uniform(0, 0.5, 4000), rng.uniform(0, 1, 4000)


@pytest.mark.parametrize(("curvature", "radius"), [(0.0, 0.5), (1.0, 0.5), (0.0, 0.47)])  # the last: between nodes
def test_plug_and_parabola_are_exact_at_every_point(curvature: float, radius: float, points) -> None:
    vessel = pipe(curvature, radius)
    r, z = points[0] * radius / 0.5, points[1]
    flow = Flow(field_of(vessel, 0.05), outline_of(vessel))
    for got, true in zip(flow.velocity(r, z), vessel.bulk_velocity(r, z), strict=True):
        np.testing.assert_allclose(got, true, atol=1e-12 * RATE / radius**2)
    np.testing.assert_allclose(flow.psi(r, z), SCALE / PACKING * vessel.psi(r, z), atol=1e-12 * RATE)


def test_in_a_cone_the_error_falls_with_the_square_of_the_cell(points) -> None:
    vessel = hopper(curvature=0.5)
    r, z = points[0] * (0.2 + 0.3 * points[1]) / 0.5, points[1]
    true = np.array(vessel.bulk_velocity(r, z))
    errors = []
    for cell in (0.04, 0.02, 0.01):
        got = np.array(Flow(field_of(vessel, cell), outline_of(vessel)).velocity(r, z))
        assert np.isfinite(got).all()
        errors.append(np.sqrt(np.mean((got - true) ** 2) / np.mean(true**2)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-3
    assert rates[-1] > 1.9, (errors, rates)


@pytest.mark.parametrize("vessel", [hopper(0.5), ring_vessel()], ids=["cone", "ring"])
def test_the_velocity_has_no_divergence_at_any_point(vessel) -> None:
    flow = Flow(field_of(vessel, 0.05), outline_of(vessel))
    rng = np.random.default_rng(2)
    r, z, step = rng.uniform(0.02, 0.3, 2000), rng.uniform(0.02, 0.98, 2000), 1e-5
    ru = [radius * flow.velocity(radius, z)[0] for radius in (r + step, r - step)]
    w = [flow.velocity(r, height)[1] for height in (z + step, z - step)]
    divergence = (ru[0] - ru[1]) / (2 * step * r) + (w[0] - w[1]) / (2 * step)
    smooth = np.isfinite(divergence)
    for places, at in ((flow.nodes.r, r), (flow.nodes.z, z)):  # u and w are continuous at edges, their slopes are not
        smooth &= np.abs(at[:, None] - places).min(axis=1) > 2 * step
    assert smooth.sum() > 500
    assert np.abs(divergence[smooth]).max() < 1e-5 * RATE / 0.2**3


def test_the_velocity_is_continuous_from_cell_to_cell() -> None:
    vessel = hopper(0.5)
    flow = Flow(field_of(vessel, 0.05))
    r, z = 0.10, np.linspace(0.01, 0.99, 300)
    for left, right in zip(flow.velocity(r - 1e-7, z), flow.velocity(r + 1e-7, z), strict=True):
        np.testing.assert_allclose(left, right, atol=1e-5 * RATE / 0.2**2)


def test_the_flow_through_every_level_of_a_cone_is_that_of_the_process() -> None:
    vessel = hopper(0.5)
    flow = Flow(field_of(vessel, 0.02), outline_of(vessel))
    share, weight = np.polynomial.legendre.leggauss(200)
    for z in (0.013, 0.37, 0.5, 0.881):
        wall = 0.2 + 0.3 * z
        r = 0.5 * wall * (1 + share)
        through = -np.sum(2 * np.pi * r * flow.velocity(r, z)[1] * 0.5 * wall * weight)
        assert through == pytest.approx(RATE, rel=2e-3)


def test_streamlines_of_a_cone_are_rays_that_divide_the_flow_equally() -> None:
    lines = Flow(field_of(hopper(0.0), 0.02)).streamlines(4)
    assert len(lines) == 4
    for number, line in enumerate(lines):
        ray = np.sqrt((number + 0.5) / 4) * (0.2 + 0.3 * line[:, 1])
        np.testing.assert_allclose(line[:, 0], ray, atol=2e-4)
        assert line[0, 1] == pytest.approx(1.0)
        assert line[-1, 1] == pytest.approx(0.0)


def test_nothing_flows_outside_walls_in_obstacles_in_voids_and_where_no_point_is() -> None:
    vessel = ring_vessel()
    flow = Flow(field_of(vessel, 0.05), outline_of(vessel))
    outside = [(-0.01, 1.5), (0.51, 1.5), (0.1, -0.1), (0.1, 2.1), (0.4, 0.95), (0.45, 0.7), (np.nan, 1.0), (np.inf, 1)]
    for values in (*flow.velocity(*np.transpose(outside)), flow.packing(*np.transpose(outside))):
        assert np.isnan(values).all()
    on_walls = [(0.5, 1.9), (0.0, 0.0), (0.0, 2.0), (0.3, 0.95), (0.4, 1.0)]
    assert np.isfinite(flow.velocity(*np.transpose(on_walls))).all()


def test_a_wall_between_nodes_ends_the_solids_where_it_stands() -> None:
    vessel = hopper()
    flow = Flow(field_of(vessel, 0.05), outline_of(vessel))
    z = np.linspace(0, 1, 50)
    assert np.isfinite(flow.velocity((0.2 + 0.3 * z) * (1 - 1e-9), z)[1]).all()
    assert np.isnan(flow.velocity(0.2 + 0.3 * z + 1e-5, z)[1]).all()


def test_values_have_the_shape_of_the_points() -> None:
    flow = Flow(field_of(pipe(), 0.1))
    assert np.shape(flow.velocity(0.1, 0.5)[1]) == ()
    assert np.shape(flow.velocity([], [])[1]) == (0,)
    assert np.shape(flow.velocity(np.zeros((3, 1)), np.zeros(4))[1]) == (3, 4)
    with pytest.raises(ValueError, match="broadcast"):
        flow.velocity([0.1, 0.2], [0.1, 0.2, 0.3])


def test_without_a_stream_function_the_velocity_is_that_of_the_exported_nodes() -> None:
    vessel = pipe(1.0)
    field = replace(field_of(vessel, 0.05), psi=None)
    flow = Flow(field)
    r, z = flow.nodes.r, flow.nodes.z
    np.testing.assert_allclose(
        flow.velocity(r[None], z[:, None])[1], vessel.bulk_velocity(r[None], z[:, None])[1], atol=1e-15
    )
    for call in (lambda: flow.psi(0, 0), flow.streamlines):
        with pytest.raises(DataError, match="no stream function"):
            call()


def test_what_a_field_does_not_know_is_refused_and_left_out_of_tables() -> None:
    flow = Flow(field_of(pipe(), 0.1, with_packing=False))
    with pytest.raises(DataError, match="no packing"):
        flow.packing(0.1, 0.1)
    with pytest.raises(DataError, match="not have standard errors"):
        flow.velocity_error(0.1, 0.1)
    profile = flow.profile(z=0.5)
    assert profile.packing is None
    assert profile.w_error is None
    assert set(flow.to_xarray()) == {"u", "w", "psi"}


def test_errors_are_those_of_the_faces_at_process_scale() -> None:
    field = field_of(pipe(), 0.05)
    se = replace(field, flux_r_se=np.full_like(field.flux_r, 0.003), flux_z_se=np.full_like(field.flux_z, 0.002))
    u, w = Flow(se).velocity_error([0.1, 0.33], [0.21, 0.77])
    np.testing.assert_allclose(u, 0.003 * SCALE / PACKING)
    np.testing.assert_allclose(w, 0.002 * SCALE / PACKING)


def test_a_profile_goes_along_a_level_or_a_vertical() -> None:
    vessel = hopper(0.5)
    flow = Flow(field_of(vessel, 0.02), outline_of(vessel))
    level, vertical = flow.profile(z=0.5), flow.profile(r=0.1, count=50)
    np.testing.assert_array_equal(level.z, 0.5)
    np.testing.assert_array_equal(np.isnan(level.w), level.r > 0.35 + 1e-12)
    np.testing.assert_allclose(vertical.w, vessel.bulk_velocity(0.1, vertical.z)[1], rtol=0.01)
    for wrong in ({}, {"z": 1.0, "r": 0.1}):
        with pytest.raises(ValueError, match="either z or r"):
            flow.profile(**wrong)


def test_tables_and_meshes_hold_the_same_velocity() -> None:
    vessel = pipe(1.0)
    flow = Flow(field_of(vessel, 0.05))
    table = flow.to_xarray()
    true = vessel.bulk_velocity(table.r.values[None], table.z.values[:, None])
    np.testing.assert_allclose(table.w, true[1])
    assert table.w.attrs["units"] == "m/s"
    mesh = flow.to_pyvista()
    np.testing.assert_allclose(mesh["bulk_velocity"][:, 2], vessel.bulk_velocity(mesh.points[:, 0], 0)[1], atol=1e-9)


@pytest.mark.parametrize("what", ["u", "w", "speed", "packing", "streamlines"])
def test_every_quantity_is_drawn_inside_its_vessel(what: str) -> None:
    from matplotlib.figure import Figure

    vessel = ring_vessel()
    axes = Flow(field_of(vessel, 0.05), outline_of(vessel)).plot(what, Figure().add_subplot())
    assert axes.get_xlim() == (0, 0.5)
    assert axes.get_ylim() == (0, 2)
    assert axes.collections


def test_a_notebook_gets_a_picture_and_an_unknown_quantity_a_list() -> None:
    flow = Flow(field_of(pipe(), 0.1))
    assert flow._repr_png_().startswith(b"\x89PNG")
    assert repr(flow) == "<Flow in r–z: velocity, packing, psi on 10 × 5 cells of 0.1 m, 0.0002 m³/s>"
    with pytest.raises(ValueError, match="packing, u, w, speed, streamlines"):
        flow.plot("temperature")


def plane_field() -> Field:
    """ψ = −q x/X per metre of depth in a straight channel X = 0.4 m wide, 0.3 m deep, from x = 0.1 m on."""
    grid = Box.within((0.1, 0.5), (0.0, 0.3), (0.0, 1.0), 0.05, flat=True, cut=True)
    psi = np.tile(-0.02 * (grid.r_edges - 0.1) / 0.4, (21, 1))
    flux_r, flux_z = flux_from_psi(psi, grid)
    full = np.ones(grid.shape)
    return Field(grid, full, full > 0, flux_r, flux_z, 0.006 / 0.6, 0.6, 1.0, packing_fraction=0.6 * full, psi=psi)


def test_in_a_plane_the_first_coordinate_is_x() -> None:
    flow = Flow(plane_field())
    u, w = flow.velocity([0.1, 0.237, 0.5, 0.05], [0.0, 0.512, 1.0, 0.5])
    np.testing.assert_allclose(w, [-0.05 / 0.6] * 3 + [np.nan])
    np.testing.assert_allclose(u[:3], 0, atol=1e-15)
    assert [line[0, 0] for line in flow.streamlines(4)] == pytest.approx([0.15, 0.25, 0.35, 0.45])
    assert set(flow.to_xarray().dims) == {"z", "x"}
    assert flow._repr_png_()


def space_field() -> Field:
    """Solids at packing 0.5 that sink at 0.2 + 0.1 x m/s, y counted for nothing; an empty cell in the corner."""
    grid = Box.within((0.0, 1.0), (0.0, 0.5), (0.0, 1.0), 0.1, flat=False, cut=True)
    full = np.ones(grid.shape)
    flux_z = np.broadcast_to(-0.5 * (0.2 + 0.1 * grid.r_centres), (11, 5, 10)).copy()
    bulk = full > 0
    bulk[0, 0, 0] = False
    zeros = np.zeros((10, 5, 11)), np.zeros((10, 6, 10))
    return Field(grid, full, bulk, zeros[0], flux_z, 0.1, 0.5, 1.0, packing_fraction=0.5 * full, flux_y=zeros[1])


def test_in_space_the_velocity_is_linear_between_the_middles_of_cells() -> None:
    flow = SpaceFlow(space_field())
    x = np.array([0.05, 0.31, 0.72, 0.05, 1.2])
    u, v, w = flow.velocity(x, [0.1, 0.25, 0.5, 0.05, 0.1], [0.5, 0.33, 1.0, 0.05, 0.5])
    np.testing.assert_allclose(w, [*-(0.2 + 0.1 * x[:3]), np.nan, np.nan])
    np.testing.assert_array_equal(u[:3], 0)
    np.testing.assert_array_equal(v[:3], 0)
    np.testing.assert_allclose(flow.packing(0.5, 0.2, 0.2), 0.5)
    assert flow.to_xarray().w.shape == (10, 5, 10)
    assert flow.to_pyvista().n_cells == 500
    with pytest.raises(DataError, match="no standard errors"):
        flow.velocity_error(0, 0, 0)
