"""The frictional fluid of a slab: exact terms, Janssen's slot, Jenike's wedge, mirror images, far rings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.slab_mesh import slab_between
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.optimize import brentq

from granpipe.field import ROUND, Array, Measure
from granpipe.fluid.elements import Space
from granpipe.fluid.friction_forms import FrictionForms
from granpipe.fluid.friction_law import FrictionLaw
from granpipe.fluid.frictional import QUADRATURE, solve_friction
from granpipe.fluid.frictional_vessel import Outlet, friction_boundary, solve_frictional
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

DEPTH = 0.3
LAW = FrictionLaw(internal=0.45, wall=0.3, length=0.1)


def slot(height: float, cells: float, middle: float = 0.0) -> RZMesh:
    """A straight slot of half width 1."""
    right, left = ([[middle + side, height], [middle + side, 0.0]] for side in (1.0, -1.0))
    return mesh_section(
        np.array(right), {}, {}, cells_across=cells, corner_refinement=1.0, left=np.array(left),
        measure=Measure(DEPTH, axial=False),
    )  # fmt: skip


def wedge(cells: int = 10) -> RZMesh:
    """Upright on its left, sloping on its right; the same triangles wherever it is moved."""
    return slab_between(lambda z: 0 * z, lambda z: 0.5 + 0.25 * z, 0.0, 4.0, cells, DEPTH)


def forms(mesh: RZMesh) -> FrictionForms:
    space = Space.on(mesh, 2, QUADRATURE)
    return FrictionForms(space, space.of_order(1), mesh.named("wall"))


def test_shear_rates_are_exact_and_nothing_is_strained_along_y() -> None:
    made = forms(slot(2.0, 6.0, middle=5.0))
    x, z = made.space.points.T
    sheared = made.shear_rate(np.concatenate([np.zeros_like(x), 3 * x]))
    stretched = made.shear_rate(np.concatenate([x, -z]))
    np.testing.assert_allclose(sheared, 3.0, rtol=1e-9)
    np.testing.assert_allclose(stretched, 2.0, rtol=1e-9)
    assert made.volume.sum() == pytest.approx(4.0)
    assert -made.gravity.sum() == pytest.approx(4.0)


def slip_layer(cells: float, length: float = 0.3) -> float:
    """Error of γ̃ = u cosh(x/ℓ)/(ℓ sinh(a/ℓ)) of a plug that slides down a slot, relative to its value at the wall."""
    made = forms(slot(1.0, cells))
    plug = np.concatenate([np.zeros(made.space.size), -2 * np.ones(made.space.size)])
    found = made.spread_rate(made.spreading(length), plug)
    exact = 2 * np.cosh(made.pressure.points[:, 0] / length) / (length * np.sinh(1 / length))
    return float(np.abs(found - exact).max() / exact.max())


def test_the_layer_that_sliding_makes_converges_at_first_order() -> None:
    coarse, fine = slip_layer(6), slip_layer(12)
    assert fine < 0.02
    assert np.log2(coarse / fine) > 0.9


def test_pressure_in_a_long_slot_tends_to_that_of_janssen() -> None:
    # a plug that slides carries its weight by both walls: μ_w p/a = ρ g
    _, found = solve_frictional(slot(14.0, 4.0), FrictionLaw(0.5, 0.3, 0.1), 1.0, Outlet())
    z = found.stokes.space.of_order(1).points[:, 1]
    for low, high in ((3, 4), (7, 8)):
        expected = (1 - np.exp(-0.3 * (14 - 0.5 * (low + high)))) / 0.3
        assert found.stokes.pressure[(z > low) & (z < high)].mean() == pytest.approx(expected, rel=0.03)


def sliding_slot(internal: float, wall: float, length: float) -> tuple[Array, Array]:
    """x, and the speed over its mean of solids that slide down a long slot of half width 1.

    Where the walls carry the weight, τ = μ_w p x: the rate of shear is (μ_w/μ_i) x γ̃, γ̃ − ℓ² γ̃″ equals it, and the
    wall feeds the sliding in, ℓ² γ̃′ = u_slip.
    """
    x, part = np.linspace(0, 1, 2001), wall / internal

    def slope(at: float, y: Array) -> list[float]:
        return [y[1], (1 - part * at) * y[0] / length**2]

    spread, grown = solve_ivp(slope, (0.0, 1.0), [1.0, 0.0], t_eval=x, rtol=1e-9, atol=1e-12).y
    sheared = cumulative_trapezoid(part * x * spread, x, initial=0)
    speed = length**2 * grown[-1] + sheared[-1] - sheared
    return x, speed / cumulative_trapezoid(speed, x)[-1]


def test_solids_that_slide_down_a_long_slot_have_the_profile_of_the_ordinary_differential_equation() -> None:
    law = FrictionLaw(0.5, 0.3, 0.2, regularization=1e-3)
    x, speed = sliding_slot(law.internal, law.wall, law.length)
    assert speed[0] > 1.05  # not a plug
    errors = []
    for cells in (2.5, 5.0):
        _, found = solve_frictional(slot(24.0, cells), law, 1.0, Outlet())
        space = found.stokes.space
        at = np.abs(space.points[:, 1] - 5.0) < 0.5
        mine, exact = -2 * DEPTH * found.stokes.w[at], np.interp(np.abs(space.points[at, 0]), x, speed)
        errors.append(float(np.abs(mine - exact).max()))
    assert errors[1] < 0.02
    assert errors[1] < 0.7 * errors[0]


def radial_wedge(internal: float, wall: float, half_angle: float) -> tuple[Array, Array]:
    """Angles from the middle, and ψ over the flow, of Jenike's radial field in a wedge, for a stress along the shear.

    p = r q(θ), u_r = −f(θ)/r: with s = 2 μ p D/γ̇, c = s_rθ/p and a = s_rr/p = −s_θθ/p = √(μ² − c²) the balances are
    (q c)′ + q (3 a − 1) = cos θ and (q (1 + a))′ = 3 q c + sin θ, and f′/f = −2 c/a. c rises from 0 to μ_w (1 + a): the
    wall rubs with its normal stress, which is the pressure in the layer of sliding, however thin.
    """
    angles = np.linspace(0, half_angle, 400)

    def along(c: float) -> float:
        return float(np.sqrt(max(internal**2 - c**2, 1e-9)))

    def slope(angle: float, y: Array) -> Array:
        q, c, _ = y
        a = along(c)
        right = [np.cos(angle) - q * (3 * a - 1), 3 * q * c + np.sin(angle)]
        dc, dq = np.linalg.solve([[q, c], [-q * c / a, 1 + a]], right)
        return np.array([dq, dc, -2 * c / a])

    def solution(q: float) -> Array:
        return np.asarray(solve_ivp(slope, (0, half_angle), [q, 0, 0], t_eval=angles, rtol=1e-8, atol=1e-10).y)

    def missing(q: float) -> float:
        c = solution(q)[1, -1]
        return float(c - wall * (1 + along(c)))

    flow = cumulative_trapezoid(np.exp(solution(brentq(missing, 0.55, 2.5))[2]), angles, initial=0)
    return angles, flow / flow[-1]


def long_wedge(half_angle: float, cells: int) -> RZMesh:
    """A wedge from 1 to 12 above its tip, with triangles that shrink towards it and towards its walls."""
    square = slab_between(lambda z: 0 * z - 1, lambda z: 0 * z + 1, 0.0, 1.0, cells, DEPTH)
    across, along = square.points.T
    z = 12**along
    return replace(square, points=np.stack([np.sin(0.5 * np.pi * across) * np.tan(half_angle) * z, z], axis=1))


def test_in_a_long_wedge_the_field_is_that_of_jenike() -> None:
    half_angle, wall = np.radians(20), 0.3
    angles, flow = radial_wedge(0.45, wall, half_angle)
    some = np.linspace(-0.97, 0.97, 16) * half_angle
    exact = 0.5 + 0.5 * np.sign(some) * np.interp(np.abs(some), angles, flow)
    assert np.abs(exact - 0.5 - 0.5 * some / half_angle).max() > 0.02  # not a plug
    law, errors = FrictionLaw(0.45, wall, 0.0, regularization=0.003), []
    for cells in (6, 24):
        found, _ = solve_frictional(long_wedge(half_angle, cells), law, 1.0, Outlet())
        x, z = 4 * np.sin(some) / found.length, 4 * np.cos(some) / found.length
        psi = [found.stream.psi_at(np.array([a]), np.array([b]))[0, 0] for a, b in zip(x, z, strict=True)]
        errors.append(float(np.abs(-DEPTH * np.array(psi) - exact).max()))
    assert errors[1] < 0.002
    assert errors[1] < 0.5 * errors[0]


def test_a_slab_and_its_mirror_image_have_mirrored_flows() -> None:
    mesh = wedge()
    turned = replace(mesh, points=mesh.points * [-1, 1], triangles=mesh.triangles[:, ::-1], edges=mesh.edges[:, ::-1])
    one, _ = solve_frictional(mesh, LAW, 1.0, Outlet())
    other, _ = solve_frictional(turned, LAW, 1.0, Outlet())
    size = np.abs(one.w).max()
    np.testing.assert_allclose(other.w, one.w, atol=1e-6 * size)
    np.testing.assert_allclose(other.u, -one.u, atol=1e-6 * size)
    assert np.abs(one.u).max() > 0.05 * size


def test_a_slab_far_from_x_0_at_another_size_and_rate_has_the_same_flow() -> None:
    mesh = wedge()
    far = replace(mesh, points=1e3 * (mesh.points + np.array([50.0, 0.0])))
    one, _ = solve_frictional(mesh, LAW, 1.0, Outlet())
    other, _ = solve_frictional(far, replace(LAW, length=1e3 * LAW.length), 1e-4, Outlet())
    np.testing.assert_allclose(other.w * 1e3 / 1e-4, one.w, atol=1e-5 * np.abs(one.w).max())
    flow = one.stream.psi_at(np.array([0.0, 0.6]) / one.length, np.array([1.0]) / one.length)
    assert -DEPTH * flow == pytest.approx(np.array([[0.0, 1.0]]), abs=0.5)  # 0 on the left, less to the right


def test_a_ring_far_from_its_axis_has_the_flow_of_a_slab() -> None:
    away = 400.0
    slab = wedge()
    ring = replace(slab, points=slab.points + np.array([away, 0.0]), measure=ROUND)
    radius = np.sqrt(2 * away * 0.75)  # √(Ω/π) there: what ε and the least pressure of the law are in units of
    weak = FrictionLaw(0.45, 0.3, 0.1, regularization=1e-3)
    strong = replace(weak, regularization=1e-3 * radius / 0.375, least_pressure=weak.least_pressure * 0.375 / radius)
    speeds = []
    for mesh, law, turn in ((slab, weak, DEPTH), (ring, strong, 2 * np.pi * away)):
        data, rubbing = friction_boundary(mesh, Outlet())
        speeds.append(turn * solve_friction(mesh, data, rubbing, law).stokes.w)
    assert np.ptp(speeds[0]) > 0.5 * np.abs(speeds[0]).max()  # not a plug
    assert np.linalg.norm(speeds[1] - speeds[0]) < 0.01 * np.linalg.norm(speeds[0])


def test_an_open_slot_lets_the_whole_flow_out_fastest_in_its_middle() -> None:
    mesh = slot(2.0, 5.0, middle=-3.0)
    data, _ = friction_boundary(mesh, Outlet("open"))
    edges = np.flatnonzero(mesh.named("outlet"))
    assert data.flow.sum() == pytest.approx(1.0)
    x = mesh.ends()[edges][:, [0, 0, 1], 0]
    x[:, 1] = mesh.ends()[edges][..., 0].mean(axis=1)
    shape = np.maximum(1 - (x + 3) ** 2, 0) ** 0.7
    np.testing.assert_allclose(data.velocity[edges, :, 1] / data.velocity[edges, :, 1].min(), shape, atol=0.01)
