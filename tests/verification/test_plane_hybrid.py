"""The hybrid of a slab: the fluid follows a known flow between walls that are not mirror images, seam and all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.errors import CaseError
from granpipe.field import Array, Box, Field, Grid, Measure, divergence, flux_from_psi, level_flow
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.forcing import KnownFlow
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.outline import Outline
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.context import Context
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.hybrid_field import hybrid_field
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.planning.submodel import sub_case
from granpipe.progress import Silent
from granpipe.rzmesh import RZMesh
from granpipe.system.store import Store

DEEP, LEFT, RIGHT = 0.3, -0.2, 0.5
WIDE = RIGHT - LEFT
GRID = Box.within((LEFT, RIGHT), (0.0, DEEP), (0.0, 4.2), 0.035, flat=True, cut=True)


def lopsided(x: Array) -> Array:
    """ψ of 1 m³/s that no fluid has of its own accord, faster on the right: w = −2 s/(W L), s from 0 to 1."""
    return -(((x - LEFT) / WIDE) ** 2) / DEEP


def known(factor: float = 1e5) -> KnownFlow:
    psi = 7.0 * np.tile(lopsided(GRID.r_edges), (len(GRID.z_edges), 1))
    return KnownFlow(GRID.r_edges, GRID.z_edges, psi, ((1.4, 2.8),), 0.35, factor, GRID.measure)


@pytest.fixture(scope="module")
def channel() -> RZMesh:
    wall, left = np.array([[RIGHT, 4.2], [RIGHT, 0.0]]), np.array([[LEFT, 4.2], [LEFT, 0.0]])
    return mesh_section(wall, {}, {}, bands=[(0.7, 3.5, 0.07)], left=left, measure=Measure(DEEP, axial=False))


def field_of(solution: FluidSolution) -> Field:
    return to_field(solution, GRID, np.ones(GRID.shape), 1.0)


def test_known_flow_is_scaled_by_the_flow_measured_on_it() -> None:
    assert known().flow == pytest.approx(7.0)
    x, z = np.array([LEFT, 0.1, 0.4]), np.array([1.5, 2.0, 2.7])
    u, w = known().velocity()(x, z)
    np.testing.assert_allclose(u, 0, atol=1e-10)
    np.testing.assert_allclose(w, -2 * (x - LEFT) / (WIDE**2 * DEEP), atol=1e-10)


def test_the_fluid_follows_what_is_known_and_is_a_plug_far_away(channel: RZMesh) -> None:
    field = field_of(solve_fluid(channel, WallLaw(), 1.0, known=known()))
    followed, away = (int(np.abs(GRID.z_edges - z).argmin()) for z in (2.1, 3.99))
    exact = np.diff(lopsided(GRID.r_edges)) / np.diff(GRID.r_edges)
    mean = 1 / (WIDE * DEEP)
    assert np.abs(field.flux_z[followed] - exact).max() < 5e-3 * mean
    assert np.abs(field.flux_z[away] + mean).max() < 0.02 * mean
    np.testing.assert_allclose(level_flow(field.flux_z, GRID), 1.0, rtol=1e-12)


def test_size_and_depth_of_the_slab_change_nothing(channel: RZMesh) -> None:
    """Depth and size are powers of two times others: what is computed is the same to rounding."""
    size = 2.0**-6
    large = solve_fluid(channel, WallLaw(), 1.0, known=known())
    small_mesh = replace(channel, points=channel.points * size, measure=Measure(2 * DEEP, axial=False))
    flow = replace(known(), r_edges=GRID.r_edges * size, z_edges=GRID.z_edges * size, measure=small_mesh.measure)
    flow = replace(flow, intervals=((1.4 * size, 2.8 * size),), ramp=0.35 * size)
    small = solve_fluid(small_mesh, WallLaw(), 1.0, known=flow)
    np.testing.assert_allclose(2 * small.w * size, large.w, rtol=1e-9, atol=1e-9)


# --- vessels ----------------------------------------------------------------------------------------------------------

VESSEL: dict[str, Any] = {
    "left": [[-0.3, 4], [-0.3, 2], [-0.9, 2], [-0.9, 0]],
    "right": [[0.7, 4], [0.7, 2], [0.9, 2], [0.9, 0]],
    "sections": {"shaft": [4, 2], "chamber": [2, 0]},
}
MIRRORED = VESSEL | {
    "left": [[-x, z] for x, z in VESSEL["right"]],
    "right": [[-x, z] for x, z in VESSEL["left"]],
}


def case_of(depth: float = 0.5, outline: dict[str, Any] = VESSEL, **fluid: object) -> Case:
    case: dict[str, Any] = {
        "name": "furnace",
        "outline": {"symmetry": "plane", "depth": depth} | outline,
        "material": {"density": 2500, "bulk_density": 1500, "size": {"diameter": 0.08}},
        "flow_rate": f"{depth!r} m^3/h",
        "model": "hybrid",
        "homogenize": {"cell": 0.05},
        "fluid": fluid,
    }
    return resolve(case, Places("furnace.yaml"), {}).case


def plug_of(plan: Plan, core: float = 1.0, depth: float = 0.5) -> Field:
    """Downward flow of 1 m³/s per metre of depth of a fluid that slips along all walls.

    Where `core` is above 1 it is faster on the left: w ~ core (1 − s)^(core − 1), s being the part of a plug that
    flows to the left of a point.
    """
    outline = plan.outline
    mesh = mesh_section(outline.wall, {}, {}, left=outline.left, measure=outline.measure)
    law = WallLaw(walls="slip", solids="slip")
    inside = outline.inside_fraction(plan.grid)
    field = to_field(solve_fluid(mesh, law, outline.measure.turn), plan.grid, inside, 0.6)
    assert field.psi is not None
    psi = -0.6 * (1 - (1 + field.psi / 0.6) ** core)
    flux_r, flux_z = flux_from_psi(psi, plan.grid)
    return replace(field, flux_r=flux_r, flux_z=flux_z, psi=psi).of_depth(depth)


def followed(folder: Path, core: float, depth: float = 0.5, **fluid: object) -> ModelResult:
    """The hybrid of the vessel that follows such a flow in its chamber."""
    path = folder / "field.npz"
    plan = make_plan(case_of(known_field=str(path), **fluid))
    plug_of(plan, core, depth).save(path)
    return hybrid_field(plan, Context(Store(folder / "store"), {}, Silent(), 1))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> ModelResult:
    return followed(tmp_path_factory.mktemp("hybrid"), core=2.0)


def test_a_slab_of_which_a_part_needs_particles_is_planned_as_a_hybrid() -> None:
    plan = make_plan(case_of().model_copy(update={"model": "auto"}))
    assert plan.model == "hybrid"
    ((span, part),) = plan.submodels
    assert span.top == 2
    assert 3.0 <= span.cut_top < 3.1  # half of the hydraulic diameter: the width
    assert part.outline.measure.turn == pytest.approx(8 * 0.08)  # a slice
    assert part.case.outline.depth == 0.5


def test_the_grid_of_a_sub_model_is_a_part_of_that_of_the_vessel() -> None:
    narrow = {
        "left": [[-0.9, 4], [-0.9, 2.5], [-0.2, 1.5], [-0.2, 0]],
        "right": [[0.9, 4], [0.9, 3], [0.4, 2], [0.4, 0]],
    }
    hopper = {"z": [3, 1.5], "regime": "mass_flow", "wall_factor": 0.7}
    sections = {"bin": [4, 3], "hopper": hopper, "slot": {"z": [1.5, 0], "model": "dem"}}
    plan = make_plan(case_of(outline=narrow | {"sections": sections}))
    ((span, part),) = plan.submodels
    rows, columns = plan.grid.where(part.grid)
    np.testing.assert_array_equal(plan.grid.r_edges[columns], part.grid.r_edges[:-1])
    np.testing.assert_array_equal(plan.grid.z_edges[rows], part.grid.z_edges[:-1])
    assert part.grid.r_edges[0] <= part.outline.r_min < part.grid.r_edges[1]
    assert part.grid.r_edges[-2] < part.outline.r_max <= part.grid.r_edges[-1]
    assert columns.start > 0
    assert part.outline.r_max == pytest.approx(0.4 + 0.5 * (span.cut_top - 2))


def test_the_cut_keeps_both_walls() -> None:
    case = case_of()
    ((span, _),) = make_plan(case).submodels
    whole, part = Outline.from_case(case), Outline.from_case(sub_case(case, span))
    for z in (2.9, 2.001, 1.999, 0.1):
        assert (part.left_end(z), part.wall_radius(z)) == (whole.left_end(z), whole.wall_radius(z))
    assert list(sub_case(case, span).outline.sections) == ["shaft", "chamber"]


def test_a_hybrid_carries_its_flow_and_conserves_in_each_cell(made: ModelResult) -> None:
    field = made.field
    carried = level_flow(field.flux_z, field.grid) * field.velocity_scale
    np.testing.assert_allclose(carried, 0.5 / 3600, rtol=1e-12)
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-12


@pytest.mark.slow
def test_a_frictional_fluid_is_joined_to_what_is_known_and_the_whole_conserves(
    made: ModelResult, tmp_path: Path
) -> None:
    joined = followed(tmp_path, core=2.0, rheology="frictional").field
    carried = level_flow(joined.flux_z, joined.grid) * joined.velocity_scale
    np.testing.assert_allclose(carried, 0.5 / 3600, rtol=1e-12)
    assert np.abs(divergence(joined.flux_r, joined.flux_z, joined.grid)).max() < 1e-12
    known_flow, unit = plug_of(make_plan(case_of()), 2.0), joined.velocity_scale / (0.5 / 3600)
    chamber = joined.grid.z_edges < 2 - 1e-9
    np.testing.assert_allclose(joined.flux_z[chamber] * unit, known_flow.flux_z[chamber] / 0.6 / 0.5, atol=1e-9)
    shaft = np.flatnonzero(joined.grid.z_edges > 3.7)[0]
    across = joined.flux_z[shaft, joined.inside_fraction[shaft] > 0.99] * unit
    assert np.abs(across - across[::-1]).max() < 0.1 * np.abs(across).max()  # that of the fluid, not of what is known


def seam(made: ModelResult) -> Gate:
    (gate,) = (gate for gate in made.gates if "upper seam of chamber" in gate.name)
    return gate


def test_a_flow_to_one_side_that_the_fluid_beyond_the_seam_cannot_have_is_marked(made: ModelResult) -> None:
    """w = 2 (1 − s) below the seam, the plug w = 1 above it: E² = 1 − 1 / ∫w² ds."""
    assert not seam(made).passed
    assert seam(made).value == pytest.approx(np.sqrt(1 - 3 / 4), abs=0.06)
    assert made.figures["difference_from_what_is_followed"]["chamber"]["sections"] < 0.05


def test_at_the_seam_a_plug_is_little_difference(tmp_path: Path) -> None:
    assert seam(followed(tmp_path, core=1.0)).value < 0.1


def test_a_vessel_and_its_mirror_image_have_mirrored_flows(made: ModelResult, tmp_path: Path) -> None:
    path = tmp_path / "field.npz"
    field = plug_of(make_plan(case_of()), 2.0)
    assert field.psi is not None
    replace(
        field,
        grid=replace(field.grid, r_edges=-field.grid.r_edges[::-1]),
        inside_fraction=field.inside_fraction[:, ::-1],
        bulk=field.bulk[:, ::-1],
        flux_r=-field.flux_r[:, ::-1],
        flux_z=field.flux_z[:, ::-1],
        psi=-0.6 - field.psi[:, ::-1],
    ).save(path)
    plan = make_plan(case_of(outline=MIRRORED, known_field=str(path)))
    mirrored = hybrid_field(plan, Context(Store(tmp_path / "store"), {}, Silent(), 1)).field.flux_z[:, ::-1]
    assert np.abs(mirrored - made.field.flux_z).max() < 0.05 * np.abs(mirrored).max()


def test_an_earlier_field_of_another_depth_has_the_same_velocities(made: ModelResult, tmp_path: Path) -> None:
    again = followed(tmp_path, core=2.0, depth=4.0).field
    own = made.field
    np.testing.assert_allclose(own.flux_z * own.velocity_scale, again.flux_z * again.velocity_scale, atol=1e-12)


@pytest.mark.parametrize("wall", [[[0.8, 4], [0.8, 2], [0.9, 2], [0.9, 0]], [[0.7, 4], [0.7, 2], [1.2, 2], [1.2, 0]]])
def test_the_field_of_another_slab_is_refused(tmp_path: Path, wall: list[list[float]]) -> None:
    path = tmp_path / "field.npz"
    other = case_of(outline=VESSEL | {"right": wall})
    plug_of(make_plan(other)).save(path)
    with pytest.raises(CaseError, match="is the field of another vessel: at z = "):
        hybrid_field(make_plan(case_of(known_field=str(path))), Context(Store(tmp_path), {}, Silent(), 1))


def test_the_field_of_a_round_vessel_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "field.npz"
    plan = make_plan(case_of(known_field=str(path)))
    grid = Grid.covering(0.9, 0.0, 4.0, 0.05)
    shape = np.ones(grid.shape)
    psi = np.tile(-0.3 * (grid.r_edges / grid.r_edges[-1]) ** 2 / np.pi, (len(grid.z_edges), 1))
    Field(grid, shape, shape > 0, *flux_from_psi(psi, grid), 1.0, 0.6, 1.0, psi=psi).save(path)
    with pytest.raises(CaseError, match="a field in r and z; this vessel needs one in x and z"):
        hybrid_field(plan, Context(Store(tmp_path), {}, Silent(), 1))


def test_a_mass_flow_hopper_without_wall_factor_stays_with_the_particles() -> None:
    """No law tells the wall's speed in a slab: `auto` takes DEM of the whole, a hybrid is refused with the place."""
    sections = {"wedge": {"z": [4, 2.5], "regime": "mass_flow"}, "shaft": [2.5, 2], "chamber": [2, 0]}
    left = [[-0.6, 4], [-0.3, 2.5], *VESSEL["left"][1:]]
    case = case_of(outline=VESSEL | {"left": left, "sections": sections})
    assert make_plan(case.model_copy(update={"model": "auto"})).model == "dem"
    with pytest.raises(CaseError, match="none for a slab") as told:
        make_plan(case)
    assert told.value.key == ("outline", "sections", "wedge", "wall_factor")
