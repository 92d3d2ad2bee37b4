"""What the boundary asks of the fluid: the moving-wall law, inlet, outlet and the balance of flows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granpipe.errors import CaseError, SolveError
from granpipe.fluid.stokes import solve_stokes
from granpipe.fluid.wall_speed import WallLaw, boundary_data, edge_roles
from granpipe.rzmesh import RZMesh

ENDS = np.array([0.0, 1.0])


def silo() -> RZMesh:
    """Section by hand, inside on the left: r 1 for 2 < z < 3, cone to r 0.5 at z 1, ledge to r 0.25, tube down to 0."""
    corners = [[0, 0], [0.25, 0], [0.25, 1], [0.5, 1], [1, 2], [1, 3], [0, 3]]
    names = ["outlet", "wall:tube", "wall:ledge", "wall:cone", "wall:shaft", "inlet", "axis"]
    edges = np.stack([np.arange(7), np.roll(np.arange(7), -1)], axis=1)
    return RZMesh(np.array(corners, dtype=float), np.empty((0, 3), dtype=np.int64), edges, np.array(names))


def on(name: str) -> int:
    return int(np.flatnonzero(silo().names == name)[0])


def test_free_area_is_that_of_the_circle_at_each_height():
    z = np.array([0.5, 1.0, 1.5, 2.0, 2.5])
    np.testing.assert_allclose(silo().free_area(z), np.pi * np.array([0.25, 0.5, 0.75, 1, 1]) ** 2, rtol=1e-14)


def test_free_area_leaves_out_what_an_obstacle_takes():
    mesh = silo()
    ring = np.array([[0.3, 2.2], [0.3, 2.6], [0.6, 2.6], [0.6, 2.2]])  # inside of the vessel on the left of each side
    edges = np.concatenate([mesh.edges, 7 + np.array([[0, 1], [1, 2], [2, 3], [3, 0]])])
    mesh = RZMesh(np.concatenate([mesh.points, ring]), mesh.triangles, edges, np.append(mesh.names, ["obstacle:o"] * 4))
    expected = np.pi * (1 - 0.6**2 + 0.3**2)
    np.testing.assert_allclose(mesh.free_area(np.array([2.1, 2.4])), [np.pi, expected], rtol=1e-14)


def test_upright_wall_moves_down_at_the_mean_speed():
    data = boundary_data(silo(), WallLaw(), 2.0, ENDS)
    np.testing.assert_allclose(data.velocity[on("wall:shaft")], [[0, -2 / np.pi]] * 2, atol=1e-8)
    np.testing.assert_allclose(data.velocity[on("wall:tube")], [[0, -2 / (np.pi * 0.25**2)]] * 2, atol=1e-6)


def test_hopper_wall_moves_down_and_inwards_along_itself_at_two_thirds_of_the_mean_speed():
    data = boundary_data(silo(), WallLaw(wall_factor=2 / 3), 2.0, ENDS)
    low, high = data.velocity[on("wall:cone")]
    for (u, w), radius in ((low, 0.5), (high, 1.0)):
        assert w == pytest.approx(-2 / 3 * 2 / (np.pi * radius**2), rel=1e-7)
        assert u == pytest.approx(w * 0.5, rel=1e-12)  # dr/dz = 0.5: towards the axis as it sinks
        assert u < 0


def test_wall_factor_of_a_section_replaces_the_common_one():
    law = WallLaw(wall_factor=0.9, section_factors={"cone": 0.5, "shaft": 0.1})
    data = boundary_data(silo(), law, 1.0, ENDS)
    assert data.velocity[on("wall:cone"), 1, 1] == pytest.approx(-0.5 / np.pi, rel=1e-7)
    assert data.velocity[on("wall:shaft"), 1, 1] == pytest.approx(-1 / np.pi, rel=1e-7)  # upright: plug flow


@pytest.mark.parametrize("solids", ["rest", "slip"])
def test_ledges_are_at_rest_or_slip(solids):
    data = boundary_data(silo(), WallLaw(solids=solids), 1.0, ENDS)
    ledge = on("wall:ledge")
    assert data.normal_held[ledge]
    assert data.tangent_held[ledge] == (solids == "rest")
    assert not data.velocity[ledge].any()


def test_slip_walls_hold_only_the_normal_velocity_and_leave_ledges_alone():
    roles = edge_roles(silo(), WallLaw(walls="slip"))
    assert list(roles) == ["open", "slip", "rest", "slip", "slip", "inlet", "axis"]


def test_inlet_and_plate_have_one_speed_and_the_whole_flow():
    data = boundary_data(silo(), WallLaw(outlet_profile="uniform"), 2.0, ENDS)
    np.testing.assert_allclose(data.velocity[on("inlet")], [[0, -2 / np.pi]] * 2)
    np.testing.assert_allclose(data.velocity[on("outlet")], [[0, -2 / (np.pi * 0.25**2)]] * 2)
    assert data.flow[on("inlet")] == pytest.approx(-2)
    assert data.flow[on("outlet")] == pytest.approx(2)


def test_annular_outlet_lets_the_flow_out_between_its_radii():
    along = np.array([0.0, 0.5, 1.0])
    data = boundary_data(silo(), WallLaw(outlet_profile="annular", annulus=(0.1, 0.2)), 2.0, along)
    speed = 2 / (np.pi * (0.2**2 - 0.1**2))
    np.testing.assert_allclose(data.velocity[on("outlet"), :, 1], [0, -speed, 0])
    assert data.flow[on("outlet")] == pytest.approx(2)


def test_annulus_beside_the_outlet_is_refused():
    with pytest.raises(SolveError, match=r"no part of the outlet lies between the radii 0.3 and 0.4 m"):
        boundary_data(silo(), WallLaw(outlet_profile="annular", annulus=(0.3, 0.4)), 1.0, ENDS)


def test_annular_outlet_without_radii_is_refused():
    with pytest.raises(CaseError, match="inner and outer radius"):
        boundary_data(silo(), WallLaw(outlet_profile="annular"), 1.0, ENDS)


def test_a_percent_more_out_than_in_is_found_and_not_absorbed():
    data = boundary_data(silo(), WallLaw(outlet_profile="uniform"), 1.0, ENDS)
    with pytest.raises(SolveError, match="do not balance"):
        solve_stokes(silo(), replace(data, flow=np.where(data.flow > 0, 1.01, 1.0) * data.flow))


def test_balanced_flows_pass():
    boundary_data(silo(), WallLaw(outlet_profile="uniform"), 1.0, ENDS).check_balance()
