"""The fluid in whole vessels: against exact cone flow, a fine solution, and in extreme scenes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping

import numpy as np
import pytest

from granpipe.errors import MeshError
from granpipe.field import Array, Field, Grid, divergence, level_flow
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section

HOPPER = np.array([[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4]])
SECTIONS = {"a": (5.9, 4.9), "b": (4.9, 3.9), "c": (3.9, 3.4)}
PIPE = np.array([[1.0, 2.0], [1.0, 0.0]])


def box(r0: float, r1: float, z0: float, z1: float) -> Array:
    return np.array([[r0, z0], [r1, z0], [r1, z1], [r0, z1]])


def as_field(solution: FluidSolution, cells: int = 120, packing: float = 0.6) -> Field:
    r, z = solution.mesh.points.T
    grid = Grid.covering(r.max(), z.min(), z.max(), (z.max() - z.min()) / cells)
    return to_field(solution, grid, np.ones(grid.shape), packing)


def sound(solution: FluidSolution) -> FluidSolution:
    """The same solution, if it is one: finite, solved, conserving."""
    field = as_field(solution)
    assert solution.residual < 1e-10
    assert solution.correction < 0.1
    assert np.isfinite([solution.u, solution.w, solution.psi]).all()
    np.testing.assert_allclose(level_flow(field.flux_z, field.grid), 0.6 * solution.flow, rtol=1e-12)
    fastest = np.abs(field.flux_z).max() / field.grid.cell
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-10 * fastest
    return solution


@pytest.mark.parametrize(
    ("degrees", "top", "bottom", "ratio"),
    [(1, 1.6, 1.2, 2.0003), (20, 16, 0.125, 2.0991), (30, 16, 0.125, 2.2085), (45, 16, 0.125, 2.2604)],
)
def test_hopper_axis_is_about_twice_as_fast_as_its_wall(degrees, top, bottom, ratio):
    """The figures are those of the exact cone flow, which develops half-way down a long cone."""
    slope = np.tan(np.deg2rad(degrees))
    wall = np.array([[top, top / slope], [bottom, bottom / slope]])  # the tip would be at z = 0
    solution = solve_fluid(mesh_section(wall, {}, {}), WallLaw(wall_factor=2 / 3), 1.0)
    axis = solution.mesh.points[:, 0] == 0
    z, w = solution.mesh.points[axis, 1], solution.w[axis]
    middle = np.abs(z - np.sqrt(top * bottom) / slope).argmin()
    wall_speed = 2 / 3 / (np.pi * (z[middle] * slope) ** 2)
    assert -w[middle] / wall_speed == pytest.approx(ratio, rel=1e-3)


def cell_velocity(field: Field) -> Array:
    """(2, nz, nr) mean of the fluxes through opposite faces of each cell."""
    return np.stack([field.flux_r[:, 1:] + field.flux_r[:, :-1], field.flux_z[1:] + field.flux_z[:-1]]) / 2


def test_hopper_agrees_with_a_fine_solution_to_two_per_mille_away_from_its_corners():
    coarse = as_field(solve_fluid(mesh_section(HOPPER, {}, SECTIONS), WallLaw(), 1.0))
    fine_mesh = mesh_section(HOPPER, {}, SECTIONS, cells_across=16, corner_refinement=100)
    fine = cell_velocity(as_field(solve_fluid(fine_mesh, WallLaw(), 1.0, order=4)))
    r, z = np.meshgrid(coarse.grid.r_centres, coarse.grid.z_centres)
    far = r < np.interp(z, HOPPER[::-1, 1], HOPPER[::-1, 0]) - 2 * coarse.grid.cell
    for corner_r, corner_z in HOPPER[1:3]:
        far &= np.hypot(r - corner_r, z - corner_z) > 0.1
    error = np.linalg.norm(cell_velocity(coarse) - fine, axis=0) / np.linalg.norm(np.where(far, fine, 1), axis=0)
    assert far.sum() > 2000
    assert error[far].max() < 2e-3


def test_hopper_from_outline_to_field_takes_under_four_seconds_of_one_core_from_a_cold_start():
    code = f"""
import json, resource
import numpy as np
from granpipe.field import Grid
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section
mesh = mesh_section(np.array({HOPPER.tolist()}), {{}}, {SECTIONS})
grid = Grid.covering(1.0, 3.4, 5.9, 0.02)
to_field(solve_fluid(mesh, WallLaw(), 1 / 3600), grid, np.ones(grid.shape), 1.0)
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps(used.ru_utime + used.ru_stime))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=True, text=True)
    assert json.loads(done.stdout) < 4


def test_velocity_on_points_agrees_with_the_field():
    solution = solve_fluid(mesh_section(HOPPER, {}, SECTIONS), WallLaw(), 2.0)
    axis = solution.mesh.points[:, 0] == 0
    field = as_field(solution, 250, 1.0)
    w = np.interp(solution.mesh.points[axis, 1], field.grid.z_edges, field.flux_z[:, 0])
    np.testing.assert_allclose(solution.w[axis], w, rtol=0.01)
    assert not solution.u[axis].any()
    assert not solution.psi[axis].any()


def test_psi_beyond_walls_is_that_of_the_nearest_solid():
    obstacles = {"on_axis": box(0, 0.2, 0.3, 0.5), "on_wall": box(0.8, 1, 1.2, 1.4), "ring": box(0.5, 0.6, 0.6, 1.0)}
    solution = sound(solve_fluid(mesh_section(PIPE, obstacles, {}), WallLaw(), 1.0))
    grid = Grid(np.array([0, 0.1, 0.52, 0.58, 0.9, 1.1]), np.array([0.4, 0.8, 1.3]))
    psi = solution.psi_at(grid)
    assert psi[0, 1] == 0
    assert psi[2, 4] == pytest.approx(-1 / (2 * np.pi), rel=1e-14)
    np.testing.assert_allclose(psi[:, 5], -1 / (2 * np.pi), rtol=1e-14)
    assert psi[1, 2] == psi[1, 3]
    assert -1 / (2 * np.pi) < psi[1, 2] < 0


def test_flow_through_a_sloping_wall_vanishes_on_the_grid():
    field = as_field(solve_fluid(mesh_section(HOPPER, {}, SECTIONS), WallLaw(), 1.0))
    r, z = np.meshgrid(field.grid.r_edges[:-1], field.grid.z_edges)
    outside = r > np.interp(z, HOPPER[::-1, 1], HOPPER[::-1, 0])
    assert outside.sum() > 1000
    assert np.abs(field.flux_z[outside]).max() < 1e-13
    assert np.abs(field.flux_r[:, -1]).max() < 1e-13


def test_one_solution_serves_every_flow_rate():
    mesh = mesh_section(HOPPER, {}, SECTIONS)
    unit = solve_fluid(mesh, WallLaw(), 1.0)
    for flow in (1e-12, 1e6):
        scaled = sound(solve_fluid(mesh, WallLaw(), flow))
        np.testing.assert_allclose(scaled.w, unit.w * flow, rtol=1e-15)


def test_field_of_a_fluid_knows_no_packing_of_its_own():
    field = as_field(solve_fluid(mesh_section(HOPPER, {}, SECTIONS), WallLaw(), 1.0), packing=0.58)
    assert field.packing_fraction is None
    assert field.bulk_packing == 0.58
    assert field.psi is not None
    assert field.psi[:, -1] == pytest.approx(-0.58 / (2 * np.pi))


# --- extreme scenes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [1, 5, 45, 80, 85])
def test_hopper_half_angles_from_1_to_85_degrees(degrees):
    height = 0.5 / np.tan(np.deg2rad(degrees))
    wall = np.array([[1, 3], [1, 2], [0.5, 2 - height], [0.5, 1.5 - height]])
    sound(solve_fluid(mesh_section(wall, {}, {}), WallLaw(wall_factor=2 / 3), 1.0))


@pytest.mark.parametrize("wall", [[[1, 3], [1, 2], [0.01, 1], [0.01, 0.9]], [[0.01, 3], [0.01, 2.9], [1, 1], [1, 0]]])
def test_area_ratio_of_1e4_between_inlet_and_outlet(wall):
    sound(solve_fluid(mesh_section(np.array(wall), {}, {}), WallLaw(), 1.0))


@pytest.mark.parametrize("inner", [0.8, 0.0])
def test_gap_of_1_mm_beside_an_obstacle_in_a_vessel_of_2_m(inner):
    obstacle = {"o": box(inner, 0.999, 1.0, 1.05)}
    sound(solve_fluid(mesh_section(PIPE, obstacle, {}), WallLaw(), 1.0))


def test_gap_of_1_mm_and_2_m_length_is_refused_with_the_reason():
    with pytest.raises(MeshError, match="too long and narrow"):
        mesh_section(PIPE, {"o": box(0.8, 0.999, 0.05, 1.95)}, {})


@pytest.mark.parametrize("factors", [{}, {f"s{i}": 0.5 + 0.02 * i for i in range(20)}])
def test_twenty_sections(factors: Mapping[str, float]):
    wall, sections, radius, z = [[1.0, 5.0]], {}, 1.0, 5.0
    for i in range(20):
        radius -= 0.08 * (i % 2)
        sections[f"s{i}"] = (z, z - 0.25)
        z -= 0.25
        wall.append([radius, z])
    sound(solve_fluid(mesh_section(np.array(wall), {}, sections), WallLaw(section_factors=factors), 1.0))


@pytest.mark.parametrize("solids", ["rest", "slip"])
def test_obstacle_that_touches_the_wall_in_one_point(solids):
    obstacle = {"o": np.array([[0.8, 1.2], [1.0, 1.0], [0.8, 0.8], [0.6, 1.0]])}
    solution = sound(solve_fluid(mesh_section(PIPE, obstacle, {}), WallLaw(solids=solids), 1.0))
    at = Grid(np.array([0, 0.8]), np.array([0.9, 1.0]))
    assert solution.psi_at(at)[1, 1] == pytest.approx(-1 / (2 * np.pi), rel=1e-14)  # the wall's own


def test_free_area_that_jumps_every_5_cm():
    wall = [[1.0, 3.0]]
    for i in range(20):
        wall += [[wall[-1][0], 2.95 - 0.05 * i], [1.0 if i % 2 else 0.8, 2.95 - 0.05 * i]]
    sound(solve_fluid(mesh_section(np.array([*wall, [1.0, 1.8]]), {}, {}), WallLaw(), 1.0))


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_vessels_of_a_millimetre_and_a_kilometre(size):
    sound(solve_fluid(mesh_section(HOPPER * size, {}, {}), WallLaw(), 1.0))


@pytest.mark.parametrize("profile", ["uniform", "annular"])
@pytest.mark.parametrize("walls", ["moving", "slip"])
def test_other_outlet_profiles(profile, walls):
    law = WallLaw(walls=walls, outlet_profile=profile, annulus=(0.2, 0.4))
    mesh = mesh_section(HOPPER, {}, SECTIONS, outlet_radii=(0.2, 0.4))
    solution = sound(solve_fluid(mesh, law, 1.0))
    field = as_field(solution)
    out = field.flux_z[0] * np.pi * 0.5**2 / 0.6
    beside = field.grid.r_edges[:-1] > 0.42
    assert np.abs(out[beside]).max() < (1.3 if profile == "uniform" else 0.02)


def test_polygon_of_many_sides_slips_like_the_round_it_stands_for():
    """At rest a ring blocks its own width and more; slipping it must not: bends of a smooth outline are no corners."""
    angle = np.linspace(0, 2 * np.pi, 61)[:-1]
    ring = {"o": np.stack([0.5 + 0.2 * np.cos(angle), 1 + 0.2 * np.sin(angle)], axis=1)}
    mesh = mesh_section(PIPE, ring, {})
    slip, rest = (sound(solve_fluid(mesh, WallLaw(solids=solids), 1.0)) for solids in ("slip", "rest"))
    touching = np.unique(mesh.edges[mesh.named("obstacle")])
    assert np.abs(rest.w[touching]).max() < 0.1 * np.abs(slip.w[touching]).max()
