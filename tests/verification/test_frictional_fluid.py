"""The frictional fluid: its terms against exact ones, Janssen's pressure, rate independence, convergence, extremes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.optimize import brentq
from scipy.special import i0, i1

from granpipe.errors import SolveError
from granpipe.field import Array
from granpipe.fluid import frictional
from granpipe.fluid.elements import Space
from granpipe.fluid.fictitious import FluidSolution
from granpipe.fluid.fixed_point import Anderson
from granpipe.fluid.friction_forms import FrictionForms
from granpipe.fluid.friction_law import FrictionLaw
from granpipe.fluid.frictional import QUADRATURE, FrictionSolution, solve_friction
from granpipe.fluid.frictional_vessel import Outlet, friction_boundary, solve_frictional
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

LAW = FrictionLaw(internal=0.45, wall=0.3, length=0.1)


@cache
def pipe(height: float = 2.0, cells: float = 10.0) -> RZMesh:
    wall = np.array([[1.0, height], [1.0, 0.0]])
    return mesh_section(wall, {}, {}, cells_across=cells, corner_refinement=1.0)


def silo(half_angle: float, outlet: float = 0.5) -> RZMesh:
    """A cone below a bin of radius 1, with a pipe below it; 90°: flat-bottomed."""
    height = (1 - outlet) / np.tan(np.radians(half_angle)) if half_angle < 90 else 0.0
    corners = [[1.0, height + 2], [1.0, height], [outlet, 0.0], [outlet, -outlet]]
    return mesh_section(np.array(corners), {}, {}, cells_across=12, corner_refinement=3)


def forms(mesh: RZMesh) -> FrictionForms:
    space = Space.on(mesh, 2, QUADRATURE)
    return FrictionForms(space, space.of_order(1), mesh.named("wall"))


def solved(mesh: RZMesh, law: FrictionLaw = LAW, flow: float = 1.0) -> tuple[FluidSolution, FrictionSolution]:
    return solve_frictional(mesh, law, flow, Outlet())


def test_shear_rate_of_known_flows_is_exact() -> None:
    made = forms(pipe())
    r, z = made.space.points.T
    sheared = made.shear_rate(np.concatenate([np.zeros_like(r), 3 * r]))
    stretched = made.shear_rate(np.concatenate([r, -2 * z]))
    np.testing.assert_allclose(sheared, 3.0, rtol=1e-9)
    np.testing.assert_allclose(stretched, np.sqrt(12), rtol=1e-9)


def test_in_simple_shear_the_stress_is_the_friction_times_the_pressure() -> None:
    law = FrictionLaw(0.45, 0.3, 0.0, regularization=1e-6)
    rate, pressure, one = np.array([1e-2, 1.0, 50.0]), np.array([1.0, 3.0, 7.0]), np.ones(3)
    np.testing.assert_allclose(law.viscosity(pressure, rate, one, one) * rate, 0.45 * pressure, rtol=1e-6)


def slip_layer(cells: float, length: float = 0.3) -> float:
    """Error of γ̃ of a plug that slides down a pipe: γ̃ = u I₀(r/ℓ)/(ℓ I₁(R/ℓ)), relative to its value at the wall."""
    made = forms(pipe(1.0, cells))
    plug = np.concatenate([np.zeros(made.space.size), -2 * np.ones(made.space.size)])
    found = made.spread_rate(made.spreading(length), plug)
    exact = 2 * i0(made.pressure.points[:, 0] / length) / (length * i1(1 / length))
    return float(np.abs(found - exact).max() / exact.max())


def test_the_layer_that_sliding_makes_converges_to_bessel_functions_at_first_order() -> None:
    coarse, fine = slip_layer(10), slip_layer(20)  # first order: the mass is lumped, at the wall, too
    assert fine < 0.01
    assert np.log2(coarse / fine) > 0.9


def test_pressure_in_a_long_pipe_tends_to_that_of_janssen() -> None:
    # a plug that slides carries its weight by the wall: 2 μ_w p/R = ρ g, whatever is above
    mesh = pipe(12.0, 8.0)
    law = FrictionLaw(0.5, 0.3, 0.1)
    _, found = solve_frictional(mesh, law, 1.0, Outlet())
    z = found.stokes.space.of_order(1).points[:, 1]
    deep = (z > 2) & (z < 3)
    expected = 1 / (2 * 0.3) * (1 - np.exp(-2 * 0.3 * 9.5))
    assert found.stokes.pressure[deep].mean() == pytest.approx(expected, rel=0.02)


def profile(found: FluidSolution, size: float = 1.0) -> Array:
    """ψ on a coarse grid over the flow, with lengths in units of `size`."""
    r, z = np.linspace(0, 0.95, 12) * size, np.linspace(0.1, 1.5, 12) * size
    psi = found.stream.psi_at(r / found.length, z / found.length)
    return np.asarray(2 * np.pi * psi)


def test_the_field_depends_on_no_rate_and_no_size() -> None:
    mesh = silo(40.0)
    large = RZMesh(mesh.points * 1e3, mesh.triangles, mesh.edges, mesh.names)
    one, _ = solved(mesh)
    other, _ = solved(large, FrictionLaw(0.45, 0.3, 0.1e3), flow=1e-7)
    np.testing.assert_allclose(profile(other, 1e3), profile(one), atol=1e-6)
    np.testing.assert_allclose(other.w / 1e-7 * 1e6, one.w, atol=1e-6 * np.abs(one.w).max())


def test_the_corner_of_a_flat_bottom_stands_still_and_its_core_flows() -> None:
    found, _ = solved(silo(90.0, outlet=0.4), FrictionLaw(0.45, 0.35, 0.05))
    r, z = found.mesh.points.T
    mean = 1 / np.pi
    corner, core = (r > 0.8) & (z < 0.2) & (z > 0), (r < 0.1) & (np.abs(z - 0.5) < 0.1)
    assert np.abs(found.w[corner]).max() < 0.05 * mean
    assert -found.w[core].mean() > 2 * mean


def test_half_the_regularization_hardly_changes_the_field() -> None:
    mesh = silo(30.0)
    one, half = (solved(mesh, FrictionLaw(0.45, 0.3, 0.1, e))[0] for e in (0.03, 0.015))
    assert np.linalg.norm(profile(one) - profile(half)) < 0.01 * np.linalg.norm(profile(one))


def test_a_tighter_tolerance_changes_the_field_no_more_than_the_looser_one() -> None:
    mesh = silo(30.0)
    data, rubbing = friction_boundary(mesh, Outlet())
    loose, tight = (solve_friction(mesh, data, rubbing, LAW, t).stokes.w for t in (1e-4, 1e-8))
    assert 0 < np.linalg.norm(loose - tight) < 1e-3 * np.linalg.norm(tight)


@pytest.mark.parametrize(
    ("angle", "outlet", "internal", "wall"),
    [(1.0, 0.9, 0.45, 0.3), (89.0, 0.3, 0.45, 0.3), (45.0, 0.05, 0.45, 0.3), (30.0, 0.5, 0.05, 0.05)],
)
def test_extreme_vessels_converge_with_all_the_flow_through_the_outlet(
    angle: float, outlet: float, internal: float, wall: float
) -> None:
    found, steps = solved(silo(angle, outlet), FrictionLaw(internal, wall, 0.03))
    assert steps.change < 1e-4
    assert found.correction < 0.03
    assert np.isfinite(found.w).all()


def test_what_does_not_converge_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frictional, "MOST_STEPS", 2)
    with pytest.raises(SolveError, match="did not converge"):
        solved(silo(30.0), FrictionLaw(1.2, 1.2, 0.06))


def test_an_open_outlet_lets_the_whole_flow_out_fastest_in_the_middle() -> None:
    mesh = silo(90.0, outlet=0.4)
    data, _ = friction_boundary(mesh, Outlet("open"))
    edges = np.flatnonzero(mesh.named("outlet"))
    assert data.flow.sum() == pytest.approx(1.0)
    radius = mesh.ends()[edges][:, [0, 0, 1], 0]
    radius[:, 1] = mesh.ends()[edges][..., 0].mean(axis=1)
    shape = (1 - (radius / 0.4) ** 2) ** 0.7
    np.testing.assert_allclose(data.velocity[edges, :, 1] / data.velocity[edges, :, 1].min(), shape, atol=1e-9)


def test_anderson_solves_a_linear_problem_in_as_many_steps_as_it_has_unknowns() -> None:
    matrix = np.array([[0.9, 0.3, 0.0], [0.0, -0.8, 0.2], [0.1, 0.0, 0.95]])
    exact = np.linalg.solve(np.eye(3) - matrix, np.ones(3))
    x, anderson = np.zeros(3), Anderson(np.ones(3), damping=0.7)
    for _ in range(5):
        x = anderson.next(x, matrix @ x + 1)
    np.testing.assert_allclose(x, exact, rtol=1e-6)


def test_the_part_of_a_mesh_between_two_heights_keeps_its_points_and_walls_and_has_ends() -> None:
    mesh = silo(30.0)
    part, kept = mesh.between(0.0, 1.0)
    np.testing.assert_array_equal(part.points, mesh.points[kept])
    a, b, c = part.points[part.triangles].transpose(1, 2, 0)
    area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    volume = 2 * np.pi * (area * part.points[part.triangles, 0].mean(axis=1)).sum()
    height = 0.5 / np.tan(np.radians(30))
    cone = np.pi * height / 3 * (1 + 0.5 + 0.25)
    assert volume == pytest.approx(cone + np.pi * (1 - height), rel=0.03)  # its ends are uneven
    flow = part.ends()[part.named("outlet")]
    assert flow[..., 1] == pytest.approx(0.0, abs=0.1)
    assert {"inlet", "outlet", "axis"} < set(part.names.tolist())


def sliding_pipe(internal: float, wall: float, length: float) -> tuple[Array, Array]:
    """Radii, and the speed over its mean of solids that slide down a long pipe of radius 1.

    Where the walls carry the weight, τ = μ_w p r: the rate of shear is (μ_w/μ_i) r γ̃, γ̃ − ℓ² ∇²γ̃ equals it, and the
    wall feeds the sliding in, ℓ² γ̃′ = u_slip.
    """
    r = np.linspace(1e-6, 1, 2001)
    part = wall / internal

    def slope(x: float, y: Array) -> list[float]:
        return [y[1], (1 - part * x) * y[0] / length**2 - y[1] / x]

    spread, grown = solve_ivp(slope, (r[0], 1.0), [1.0, 0.0], t_eval=r, rtol=1e-9, atol=1e-12).y
    sheared = cumulative_trapezoid(part * r * spread, r, initial=0)
    speed = length**2 * grown[-1] + sheared[-1] - sheared
    return r, speed / (2 * cumulative_trapezoid(speed * r, r)[-1])


def test_solids_that_slide_down_a_long_pipe_have_the_profile_of_the_ordinary_differential_equation() -> None:
    law = FrictionLaw(0.5, 0.3, 0.2, regularization=1e-3)
    r, speed = sliding_pipe(law.internal, law.wall, law.length)
    errors = []
    for cells in (6.0, 12.0):
        _, found = solve_frictional(pipe(12.0, cells), law, 1.0, Outlet())
        space = found.stokes.space
        at = np.abs(space.points[:, 1] - 4.0) < 0.5
        mine, exact = -np.pi * found.stokes.w[at], np.interp(space.points[at, 0], r, speed)
        errors.append(float(np.abs(mine - exact).max()))
    assert speed[0] > 1.05  # not a plug
    assert errors[1] < 0.02
    assert errors[1] < 0.7 * errors[0]


def radial_cone(internal: float, wall: float, half_angle: float) -> tuple[Array, Array]:
    """Angles from the axis, and ψ over the flow, of Jenike's radial field in a cone, for a stress along the shear.

    p = r q(θ), u_r = −f(θ)/r²: with s = 2 μ p D/γ̇ and c = s_rθ/p both balances of force are ordinary differential
    equations of q and c. c rises from 0 on the axis to μ_w (1 − s_θθ/p): the wall rubs with its normal stress, which is
    the pressure in the layer of sliding, however thin.
    """
    root = np.sqrt(12.0)
    angles = np.linspace(1e-4, half_angle, 400)

    def outward(c: float) -> float:
        """s_rr/p; s_θθ and s_φφ are half of it, with the other sign."""
        return float(4 * internal / root * np.sqrt(max(1 - (c / internal) ** 2, 1e-9)))

    def slope(angle: float, y: Array) -> Array:
        q, c, _ = y
        along = outward(c)
        rest = along * root / (4 * internal)
        across, bend = -0.5 * along, 2 * c / (internal * root * rest)
        right = [np.cos(angle) - q * c / np.tan(angle) - q * (4 * along - 1), -4 * q * c - np.sin(angle)]
        dc, dq = np.linalg.solve([[q, c], [q * bend, across - 1]], right)
        return np.array([dq, dc, -root * c / internal / rest])

    def solution(q: float) -> Array:
        first = (1 - q * (16 * internal / root - 1)) / (2 * q)
        start = [q, 1e-4 * first, 0.0]
        return np.asarray(solve_ivp(slope, (1e-4, half_angle), start, t_eval=angles, rtol=1e-8, atol=1e-10).y)

    def missing(q: float) -> float:
        c = solution(q)[1, -1]
        return float(c - wall * (1 + 0.5 * outward(c)))

    q = brentq(missing, 0.3, 0.7)
    flow = cumulative_trapezoid(np.exp(solution(q)[2]) * np.sin(angles), angles, initial=0)
    return angles, flow / flow[-1]


def test_in_a_long_cone_the_field_is_that_of_jenike() -> None:
    half_angle = np.radians(20)
    angles, flow = radial_cone(0.45, 0.15, half_angle)
    some = np.linspace(0, 0.97 * half_angle, 12)
    exact = np.interp(some, angles, flow)
    assert np.abs(exact - (1 - np.cos(some)) / (1 - np.cos(half_angle))).max() > 0.03  # not a plug
    steep, errors = np.tan(half_angle), []
    for cells in (6, 24):
        wall = np.array([[3.0, 3.0 / steep], [0.5, 0.5 / steep]])
        mesh = mesh_section(wall, {}, {}, cells_across=cells, corner_refinement=1)
        found, _ = solve_frictional(mesh, FrictionLaw(0.45, 0.15, 0.0, regularization=0.01), 1.0, Outlet())
        r, z = 4 * np.sin(some) / found.length, 4 * np.cos(some) / found.length
        psi = [found.stream.psi_at(np.array([a]), np.array([b]))[0, 0] for a, b in zip(r, z, strict=True)]
        errors.append(float(np.abs(2 * np.pi * np.abs(psi) - exact).max()))
    assert errors[1] < 0.007
    assert errors[1] < 0.6 * errors[0]
