"""The fluid against flows that are known in closed form, on meshes made here (no gmsh)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fakes.vessel_mesh import mesh_below

from granpipe.field import Array
from granpipe.fluid.constraints import constrain
from granpipe.fluid.stokes import Forcing, StokesSolution, solve_stokes
from granpipe.fluid.stream import nearest_stream_function
from granpipe.fluid.wall_speed import BoundaryData, WallLaw, boundary_data
from granpipe.rzmesh import RZMesh

Velocity = Callable[[Array, Array], tuple[Array, Array]]
Stream = Callable[[Array, Array], Array]


def prescribed(mesh: RZMesh, velocity: Velocity, psi: Stream, order: int) -> BoundaryData:
    """Data that hold a known velocity everywhere but on the axis, where only u is held."""
    along = np.arange(order + 1) / order
    (r0, z0), (r1, z1) = mesh.ends().transpose(1, 2, 0)[..., None]
    values = np.stack(velocity(r0 + (r1 - r0) * along, z0 + (z1 - z0) * along), axis=2)
    out = 2 * np.pi * (psi(r0, z0) - psi(r1, z1))[:, 0]
    return BoundaryData(along, values, np.ones(len(out), dtype=bool), ~mesh.named("axis"), out)


def velocity_errors(flow: StokesSolution, data: BoundaryData, velocity: Velocity) -> tuple[float, float]:
    """Relative error in L2 over the volume: of the Taylor–Hood velocity and of that from its stream function."""
    stream = nearest_stream_function(flow, data)
    basis = stream.space.basis
    r, z = np.asarray(basis.global_coordinates())
    exact = np.stack(velocity(r, z))
    own = stream.space.of_order(flow.space.order).basis
    hood = np.stack([np.asarray(own.interpolate(flow.u)), np.asarray(own.interpolate(flow.w))])
    chi = basis.interpolate(stream.chi)
    clean = np.stack([-r * chi.grad[1], 2 * np.asarray(chi) + r * chi.grad[0]])

    def size(part: Array) -> float:
        return float(np.sqrt(np.sum(r * basis.dx * np.sum(part**2, axis=0))))

    return size(hood - exact) / size(exact), size(clean - exact) / size(exact)


def rates(errors: list[tuple[float, float]]) -> Array:
    """(2,) orders of convergence between the last two meshes, where the second is twice as fine."""
    return np.log2(np.array(errors[-2]) / np.array(errors[-1]))


def straight(z: Array) -> Array:
    return 0.7 + 0 * z


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("profile", ["developed", "uniform"])
@pytest.mark.parametrize("walls", ["moving", "slip"])
def test_plug_flow_is_exact(order, profile, walls):
    mesh = mesh_below(straight, 0.0, 2.0, 4)
    data = boundary_data(mesh, WallLaw(walls=walls, outlet_profile=profile), 3.0, np.arange(order + 1) / order)
    flow = solve_stokes(mesh, data)
    speed = 3.0 / (np.pi * 0.7**2)
    assert np.abs(flow.u).max() < 1e-10 * speed
    assert np.abs(flow.w + speed).max() < 1e-10 * speed
    u, w, psi = nearest_stream_function(flow, data).at_points()
    assert np.abs(u).max() < 1e-10 * speed
    assert np.abs(w + speed).max() < 1e-10 * speed
    assert np.abs(psi + speed * mesh.points[:, 0] ** 2 / 2).max() < 1e-10


@pytest.mark.parametrize("order", [2, 3, 4])
def test_poiseuille_flow_is_exact_and_leaves_an_open_outlet_unchanged(order):
    def velocity(r: Array, z: Array) -> tuple[Array, Array]:
        return 0 * r, -2 * (1 - (r / 0.7) ** 2) + 0 * z

    def psi(r: Array, z: Array) -> Array:
        return -(r**2) + r**4 / (2 * 0.7**2) + 0 * z

    mesh = mesh_below(straight, 0.0, 2.0, 4)
    held = prescribed(mesh, velocity, psi, order)
    closed = ~mesh.named("outlet")
    data = BoundaryData(held.along, held.velocity, held.normal_held & closed, held.tangent_held & closed, held.flow)
    assert max(velocity_errors(solve_stokes(mesh, data), data, velocity)) < 1e-10


def cone(half_angle: float, factor: float) -> tuple[Velocity, Stream, float]:
    """Creeping flow of 1 m³/s down a cone with its tip at 0: radial, F(θ)/ρ² with F = a + b cos²θ.

    a and b follow from the flow and the wall's speed, w = −f Φ/Ω. The last value is w on the axis over w at the wall.
    """
    c = np.cos(half_angle)
    wall = -factor / (np.pi * np.sin(half_angle) ** 2 * c)
    equations = np.array([[1, c**2], [2 * np.pi * (1 - c), 2 * np.pi * (1 - c**3) / 3]])
    a, b = np.linalg.solve(equations, [wall, -1.0])

    def velocity(r: Array, z: Array) -> tuple[Array, Array]:
        rho2 = r**2 + z**2
        radial = (a + b * z**2 / rho2) / rho2**1.5
        return radial * r, radial * z

    def psi(r: Array, z: Array) -> Array:
        cosine = z / np.hypot(r, z)
        return a * (1 - cosine) + b * (1 - cosine**3) / 3

    return velocity, psi, (a + b) / (wall * c**3)


def test_exact_cone_has_twice_the_wall_speed_on_its_axis_as_the_paper_wanted():
    ratios = [cone(np.deg2rad(angle), 2 / 3)[2] for angle in (1, 20, 30, 45)]
    np.testing.assert_allclose(ratios, [2.00, 2.10, 2.21, 2.26], atol=0.006)


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("degrees", [10, 40])
def test_conical_flow_converges_at_its_order(order, degrees):
    velocity, psi, _ = cone(np.deg2rad(degrees), 2 / 3)
    errors = []
    for cells in (4, 8, 16) if order < 4 else (4, 8):
        mesh = mesh_below(lambda z: z * np.tan(np.deg2rad(degrees)), 1.0, 2.0, cells)
        data = prescribed(mesh, velocity, psi, order)
        errors.append(velocity_errors(solve_stokes(mesh, data), data, velocity))
    assert rates(errors)[0] > order + 0.6
    assert rates(errors)[1] > min(order + 1, 4) - 0.3  # ψ has order 4 at most


def test_moving_walls_of_a_cone_carry_the_exact_flow_of_the_law():
    velocity, psi, _ = cone(np.deg2rad(25), 2 / 3)
    mesh = mesh_below(lambda z: z * np.tan(np.deg2rad(25)), 1.0, 2.0, 8)
    law, exact = (
        boundary_data(mesh, WallLaw(wall_factor=2 / 3), 1.0, np.arange(3) / 2),
        prescribed(mesh, velocity, psi, 2),
    )
    wall = mesh.named("wall")
    np.testing.assert_allclose(law.velocity[wall], exact.velocity[wall], rtol=1e-7)


@pytest.mark.parametrize("order", [2, 3])
def test_flow_about_a_point_force_converges_at_its_order(order):
    def velocity(r: Array, z: Array) -> tuple[Array, Array]:
        distance = np.hypot(r, z - 1.6)
        return r * (z - 1.6) / distance**3, 1 / distance + (z - 1.6) ** 2 / distance**3

    errors = []
    for cells in (6, 12, 24):
        mesh = mesh_below(lambda z: 0.8 - 0.3 * np.sin(3 * z), 0.0, 1.0, cells)
        data = prescribed(mesh, velocity, lambda r, z: r**2 / np.hypot(r, z - 1.6), order)
        errors.append(velocity_errors(solve_stokes(mesh, data), data, velocity))
    assert rates(errors).min() > order + 0.8


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("factor", [1.0, 1e4])
def test_manufactured_solution_with_a_volume_force_converges_at_its_order(order, factor):
    def velocity(r: Array, z: Array) -> tuple[Array, Array]:
        return 0.5 * r * np.sin(z), np.cos(z) + 0 * r

    def target(r: Array, z: Array) -> tuple[Array, Array]:
        """u* = u + (−∇²u + ∇p)/K with p = r² cos z."""
        u, w = velocity(r, z)
        return u + (0.5 * r * np.sin(z) + 2 * r * np.cos(z)) / factor, w + (np.cos(z) - r**2 * np.sin(z)) / factor

    errors = []
    for cells in (4, 8, 16):
        mesh = mesh_below(lambda z: 1 + 0.2 * np.cos(2 * z), 0.0, 1.5, cells)
        data = prescribed(mesh, velocity, lambda r, z: 0.5 * r**2 * np.cos(z), order)
        forcing = Forcing(lambda r, z: factor + 0 * r, target)
        errors.append(velocity_errors(solve_stokes(mesh, data, forcing), data, velocity))
    assert rates(errors).min() > order + 0.6


def hopper(z: Array) -> Array:
    return np.clip(0.5 * z, 0.5, 1.0)


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("law", [WallLaw(wall_factor=2 / 3), WallLaw(walls="slip"), WallLaw(outlet_profile="uniform")])
def test_no_wall_edge_leaks_and_the_inlet_has_the_whole_flow(order, law):
    mesh = mesh_below(hopper, 0.5, 2.5, 8)
    data = boundary_data(mesh, law, 1.0, np.arange(order + 1) / order)
    flow = solve_stokes(mesh, data)
    out = 2 * np.pi * constrain(flow.space, data).edge_flow @ np.concatenate([flow.u, flow.w])
    assert np.abs(out[mesh.named("wall")]).max() < 1e-14
    assert out[mesh.named("inlet")].sum() == pytest.approx(-1, abs=1e-14)
    assert out[mesh.named("outlet")].sum() == pytest.approx(1, abs=1e-12)
