"""Slabs, `outline.symmetry: plane`: the fluid, the geometry and dumps against what is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.cases import changed_data
from fakes.plane_flow import DEPTH, HEIGHT, NARROW, WIDE, PlaneFlow
from fakes.slab_mesh import slab_between

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.errors import CaseError, DataError
from granpipe.field import Array, Box, divergence, level_flow
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.fluid.stokes import StokesSolution, solve_stokes
from granpipe.fluid.stream import nearest_stream_function
from granpipe.fluid.wall_speed import BoundaryData, WallLaw, boundary_data
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.dumps import homogenize_files
from granpipe.planning.make import make_plan
from granpipe.rzmesh import RZMesh

Velocity = Callable[[Array, Array], tuple[Array, Array]]
Stream = Callable[[Array, Array], Array]
DEEP = 0.3
LEFT = [[-0.5, 2.0], [-0.5, 1.0], [-0.1, 0.3], [-0.1, 0.0]]
RIGHT = [[0.4, 2.0], [0.4, 1.4], [0.1, 0.3], [0.1, 0.0]]


def prescribed(mesh: RZMesh, velocity: Velocity, psi: Stream, order: int) -> BoundaryData:
    """Data that hold a known velocity everywhere."""
    along = np.arange(order + 1) / order
    (x0, z0), (x1, z1) = mesh.ends().transpose(1, 2, 0)[..., None]
    values = np.stack(velocity(x0 + (x1 - x0) * along, z0 + (z1 - z0) * along), axis=2)
    held = np.ones(len(mesh.edges), dtype=bool)
    return BoundaryData(along, values, held, held, mesh.measure.turn * (psi(x0, z0) - psi(x1, z1))[:, 0])


def errors(flow: StokesSolution, data: BoundaryData, velocity: Velocity) -> tuple[float, float]:
    """Relative error in L2 over the section: of the Taylor–Hood velocity, and of that from its stream function."""
    stream = nearest_stream_function(flow, data)
    basis, own = stream.space.basis, stream.space.of_order(flow.space.order).basis
    exact = np.stack(velocity(*np.asarray(basis.global_coordinates())))
    hood = np.stack([np.asarray(own.interpolate(flow.u)), np.asarray(own.interpolate(flow.w))])
    slope = basis.interpolate(stream.chi).grad
    clean = np.stack([-slope[1], slope[0]])

    def size(part: Array) -> float:
        return float(np.sqrt(np.sum(basis.dx * np.sum(part**2, axis=0))))

    return size(hood - exact) / size(exact), size(clean - exact) / size(exact)


def at(x: float) -> Callable[[Array], Array]:
    return lambda z: x + 0 * z


@pytest.mark.parametrize("order", [2, 3, 4])
def test_plug_flow_is_exact(order):
    mesh = slab_between(at(-0.2), at(0.5), 0.0, 2.0, 4, DEEP)
    data = boundary_data(mesh, WallLaw(), 3.0, np.arange(order + 1) / order)
    flow = solve_stokes(mesh, data)
    u, w, psi = nearest_stream_function(flow, data).at_points()
    speed = 3.0 / (0.7 * DEEP)
    assert max(np.abs(u).max(), np.abs(w + speed).max(), np.abs(psi + speed * (mesh.points[:, 0] + 0.2)).max()) < 1e-9


@pytest.mark.parametrize("order", [2, 3, 4])
def test_poiseuille_flow_is_exact_with_one_and_a_half_times_the_mean_in_the_middle(order):
    def velocity(x: Array, z: Array) -> tuple[Array, Array]:
        return 0 * x, -1.5 * (1 - ((x - 0.15) / 0.35) ** 2) + 0 * z

    def psi(x: Array, z: Array) -> Array:
        return -1.5 * (x - (x - 0.15) ** 3 / (3 * 0.35**2)) + 0 * z

    mesh = slab_between(at(-0.2), at(0.5), 0.0, 2.0, 4, DEEP)
    held, closed = prescribed(mesh, velocity, psi, order), ~mesh.named("outlet")
    data = replace(held, normal_held=held.normal_held & closed, tangent_held=held.tangent_held & closed)
    flow = solve_stokes(mesh, data)
    assert max(errors(flow, data, velocity)) < 1e-10
    mean = data.flow[mesh.named("outlet")].sum() / (0.7 * DEEP)
    assert -flow.w.min() / mean == pytest.approx(1.5, rel=1e-9)


def wedge(angle: float, factor: float) -> tuple[Velocity, Stream]:
    """Creeping Jeffery–Hamel flow of 1 m³/s to the tip of a wedge at 0: (a + b cos 2θ)/ρ, w = −f Φ/Ω on its walls."""
    equations = np.array([[1, np.cos(2 * angle)], [2 * angle, np.sin(2 * angle)]])
    a, b = np.linalg.solve(equations, [-factor / (DEEP * np.sin(2 * angle)), -1 / DEEP])

    def velocity(x: Array, z: Array) -> tuple[Array, Array]:
        radial = (a + b * (z**2 - x**2) / (x**2 + z**2)) / (x**2 + z**2)
        return radial * x, radial * z

    def psi(x: Array, z: Array) -> Array:
        turn = np.arctan2(x, z)
        return a * turn + 0.5 * b * np.sin(2 * turn)

    return velocity, psi


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("degrees", [10, 40])
def test_flow_to_the_tip_of_a_wedge_converges_at_its_order(order, degrees):
    slope = np.tan(np.deg2rad(degrees))
    velocity, psi = wedge(np.deg2rad(degrees), 2 / 3)
    found = []
    for cells in (4, 8, 16):
        mesh = slab_between(lambda z: -slope * z, lambda z: slope * z, 1.0, 2.0, cells, DEEP)
        data = prescribed(mesh, velocity, psi, order)
        found.append(errors(solve_stokes(mesh, data), data, velocity))
    rates = np.log2(np.array(found[-2]) / np.array(found[-1]))
    assert rates[0] > order + 0.6
    assert rates[1] > min(order + 1, 4) - 0.3


def test_moving_walls_of_a_wedge_carry_the_exact_flow_of_the_law():
    slope = np.tan(np.deg2rad(25))
    mesh = slab_between(lambda z: -slope * z, lambda z: slope * z, 1.0, 2.0, 8, DEEP)
    law = boundary_data(mesh, WallLaw(wall_factor=2 / 3), 1.0, np.arange(3) / 2)
    exact, wall = prescribed(mesh, *wedge(np.deg2rad(25), 2 / 3), 2), mesh.named("wall")
    np.testing.assert_allclose(law.velocity[wall], exact.velocity[wall], rtol=1e-7)


@pytest.mark.parametrize("order", [2, 3])
def test_flow_about_a_line_force_converges_at_its_order(order):
    def velocity(x: Array, z: Array) -> tuple[Array, Array]:
        square = x**2 + (z - 1.6) ** 2
        return x * (z - 1.6) / square, -0.5 * np.log(square) + (z - 1.6) ** 2 / square

    found = []
    for cells in (6, 12, 24):
        mesh = slab_between(lambda z: -0.4 - 0.2 * z, lambda z: 0.8 - 0.3 * np.sin(3 * z), 0.0, 1.0, cells, DEEP)
        data = prescribed(mesh, velocity, lambda x, z: x * (1 - 0.5 * np.log(x**2 + (z - 1.6) ** 2)), order)
        found.append(errors(solve_stokes(mesh, data), data, velocity))
    assert np.log2(np.array(found[-2]) / np.array(found[-1])).min() > order + 0.8


# --- vessels ----------------------------------------------------------------------------------------------------------


def slab(**changes: object) -> Case:
    """A case with walls of two slopes and lengths."""
    case: dict[str, Any] = {
        "name": "slab",
        "outline": {
            "symmetry": "plane",
            "left": LEFT,
            "right": RIGHT,
            "depth": DEEP,
            "sections": {"bin": [2.0, 1.4], "wedge": {"z": [1.4, 0.3], "regime": "mass_flow", "wall_factor": 0.7}},
        },
        "material": {"density": 2500, "bulk_density": 1500, "size": {"diameter": 0.005}},
        "flow_rate": "1 m^3/h",
    }
    case = changed_data(case, changes)
    case["outline"] = {key: value for key, value in case["outline"].items() if value is not None}
    return resolve(case, Places("slab.yaml"), {}).case


def test_area_and_volume_are_those_of_the_drawing():
    outline = Outline.from_case(slab())
    assert outline.area([1.9, 1.2, 0.3, 0.1]) == pytest.approx(
        DEEP * np.array([0.9, 0.5 + 0.1 + 0.3 * 0.9 / 1.1, 0.2, 0.2])
    )
    area = 0.2 * 0.3 + 0.5 * (0.1 + 0.4) * 1.1 + 0.4 * 0.6 + 0.5 * (0.1 + 0.5) * 0.7 + 0.5 * 1.0
    assert outline.volume() == pytest.approx(DEEP * area)
    grid = Box.within((-0.5, 0.4), (0, DEEP), (0, 2), 0.07, flat=True, cut=True)
    assert (outline.inside_fraction(grid) @ grid.cell_volume).sum() == pytest.approx(DEEP * area)
    (outlet,) = find_openings(outline)
    assert (outlet.gap, outlet.area, outlet.length) == pytest.approx((0.2, 0.2 * DEEP, DEEP))


def test_an_obstacle_leaves_two_slots_whose_areas_add_up():
    obstacles = {"bar": [[-0.1, 1.6], [0.1, 1.6], [0.1, 1.5], [-0.1, 1.5]]}
    outline = Outline.from_case(slab(outline__obstacles=obstacles))
    names = {one.name: one for one in find_openings(outline)}
    assert names["gap between bar and the wall"].gap == pytest.approx(0.3)
    assert names["gap between bar and the left wall"].gap == pytest.approx(0.4)
    assert not names["gap between bar and the wall"].required


def field_of(outline: Outline, case: Case) -> tuple[Array, Array]:
    """w and |u| in the middle of each cell, exactly conserving."""
    mesh = mesh_section(
        outline.wall, outline.obstacles, case.outline.levels, left=outline.left, measure=outline.measure
    )
    solution = solve_fluid(mesh, WallLaw(section_factors={"wedge": 0.7}), 2.0)
    grid = Box.within((outline.r_min, outline.r_max), (0, DEEP), (0.0, 2.0), 0.025, flat=True, cut=True)
    field = to_field(solution, grid, outline.inside_fraction(grid), 0.6)
    assert np.abs(level_flow(field.flux_z, grid) / 1.2 - 1).max() < 1e-12
    assert np.abs(divergence(field.flux_r, field.flux_z, grid)).max() < 1e-10
    field.check()
    return field.flux_z, field.flux_r


def test_a_vessel_and_its_mirror_image_have_mirrored_flows():
    case = slab()
    outline = Outline.from_case(case)
    (w, u), (mirrored_w, mirrored_u) = field_of(outline, case), field_of(outline.mirrored(), case)
    assert np.abs(w - mirrored_w[:, ::-1]).max() < 0.01 * np.abs(w).max()
    assert np.abs(u + mirrored_u[:, ::-1]).max() < 0.02 * np.abs(w).max()


def test_a_vessel_far_from_x_0_has_the_same_flow():
    case = slab()
    outline = Outline.from_case(case)
    east = np.array([1000.0, 0.0])
    away = Outline.of(east + outline.wall, {}, outline.sections, east + outline.left, DEEP)
    (w, _), (moved, _) = field_of(outline, case), field_of(away, case)
    assert np.abs(w - moved).max() < 0.01 * np.abs(w).max()


def test_a_slab_of_mass_flow_is_planned_as_a_fluid_with_the_flow_of_its_depth():
    plan = make_plan(slab())
    assert plan.model == "fluid"
    assert "whole depth of 0.3 m" in plan.notes[0]


def test_a_hopper_of_which_nothing_is_said_needs_particles():
    assert make_plan(slab(outline__sections={"wedge": [1.4, 0.3]})).model == "dem"


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"export": ["openfoam"]}, ("export",), "comsol"),
        ({"outline__sections": {"wedge": {"z": [1.4, 0.3], "regime": "mass_flow"}}}, ("outline", "sections"), "cones"),
        ({"outline__left": [[0.2, 2], [0.2, 0]]}, ("outline", "left"), "meets"),
        ({"outline__left": [[-0.2, 2], [-0.2, 0.1]]}, ("outline", "left"), "outlet"),
        ({"outline__left": [[-0.2, 2], [-0.3, 1], [-0.1, 1.2], [-0.1, 0]]}, ("outline", "left"), "overhang"),
        ({"outline__wall": RIGHT}, ("outline", "wall"), "symmetry: axis"),
        ({"outline__depth": None}, ("outline", "depth"), "missing"),
        ({"outline__depth": -1}, ("outline", "depth"), "above 0"),
        ({"flow_rate": "1 m^3/s"}, ("flow_rate",), "free discharge"),
    ],
)  # fmt: skip
def test_what_a_slab_cannot_have_is_refused_with_its_place(changes, key, words):
    with pytest.raises(CaseError, match=words) as told:
        make_plan(slab(**changes))
    assert told.value.key[: len(key)] == key


# --- dumps of others --------------------------------------------------------------------------------------------------

FLOW = PlaneFlow()


def channel(depth: float, front_and_back: str = "periodic") -> Case:
    """The vessel of `PlaneFlow`, whose right wall is a cosine."""
    z = np.linspace(HEIGHT, 0, 81)
    wall = [[float(x), float(height)] for x, height in zip(FLOW.wall(z)[0], z, strict=True)]
    rate = FLOW.flow / FLOW.packing * depth
    return resolve(
        {
            "name": "channel",
            "outline": {
                "symmetry": "plane", "left": [[0, HEIGHT], [0, 0]], "right": wall, "depth": depth,
                "front_and_back": front_and_back,
                "sections": {"top": [1.0, 0.75], "narrow": [0.75, 0.25], "bottom": [0.25, 0.0]},
            },
            "material": {"density": 1000, "size": {"diameter": 0.04}},
            "flow_rate": f"{rate!r} m^3/s",
        },
        Places("channel.yaml"), {},
    ).case  # fmt: skip


def test_dumps_in_a_slab_become_its_exact_flow_at_the_depth_of_the_case(tmp_path: Path):
    dumps = FLOW.dumps(tmp_path, interval=0.05, count=30)
    request = Request(dumps, Frame("xz", 0.01, y=(0.0, DEPTH)), time_step=5e-5)
    made = homogenize_files(request, channel(depth=2.0))
    field = made.field
    assert field.grid.measure.turn == 2.0
    assert field.flow_scale == pytest.approx(1, rel=0.03)
    assert np.ptp(level_flow(field.flux_z, field.grid)) < 1e-10
    z = field.grid.z_edges
    for height in (0.1, 0.9):
        row = int(np.abs(z - height).argmin())
        inside = field.grid.r_centres < FLOW.wall(z[row])[0] - 0.04
        speed = field.flux_z[row, inside & (field.grid.r_centres > 0.04)]
        assert -speed.mean() == pytest.approx(FLOW.flow / (WIDE if height > 0.5 else NARROW), rel=0.05)


def test_dumps_between_a_front_and_a_back_wall_are_averaged_over_the_depth_of_the_case_and_no_other(tmp_path: Path):
    dumps = FLOW.dumps(tmp_path, interval=0.05, count=30)
    request = Request(dumps, Frame("xz", 0.01, y=(0.0, DEPTH)), time_step=5e-5)
    made = homogenize_files(request, channel(DEPTH, "walls"))
    assert made.field.grid.measure.walled
    assert made.field.flow_scale == pytest.approx(1, rel=0.03)
    assert any("the mean over it" in note for note in made.notes)
    with pytest.raises(DataError, match="give the depth of the dumps"):
        homogenize_files(request, channel(2 * DEPTH, "walls"))


def test_a_case_and_the_plane_of_the_dumps_must_agree(tmp_path: Path):
    with pytest.raises(DataError, match="describes a slab"):
        homogenize_files(Request((tmp_path / "a",), Frame("rz", 0.01), time_step=1e-4), channel(1.0))
