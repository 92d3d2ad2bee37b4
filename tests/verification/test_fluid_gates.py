"""The gates of fluid and hybrid: silent on vessels that a fluid describes, and an alarm on those that it does not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.errors import CaseError, DataError
from granpipe.export.nodes import nodal_errors
from granpipe.field import Field, flux_from_psi
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.context import Context
from granpipe.pipeline.fluid_field import fluid_field
from granpipe.pipeline.hybrid_field import hybrid_field
from granpipe.pipeline.known_field import known_results
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.planning.submodel import Span
from granpipe.progress import Silent
from granpipe.system.manifest import write_manifest
from granpipe.system.store import Store

Points = list[list[float]]


def plan_of(
    folder: Path,
    wall: Points,
    obstacles: dict[str, Points] | None = None,
    sections: dict[str, object] | None = None,
    model: str = "fluid",
    diameter: str = "0.1 mm",
    **fluid: object,
) -> Plan:
    case = {
        "name": "vessel",
        "outline": {"unit": "m", "wall": wall, "obstacles": obstacles or {}}
        | ({"sections": sections} if sections else {}),
        "material": {"density": "2500 kg/m^3", "bulk_density": "1500 kg/m^3", "size": {"diameter": diameter}},
        "flow_rate": "1e-6 m^3/h",
        "model": model,
        "fluid": fluid,
    }
    path = folder / "vessel.yaml"
    path.write_text(json.dumps(case))
    return make_plan(read_case(path).case)


def failed(plan: Plan) -> list[str]:
    return [gate.name for gate in fluid_field(plan).gates if not gate.passed]


def cone(degrees: float, outlet: float = 0.5) -> tuple[Points, dict[str, object]]:
    height = (1 - outlet) / np.tan(np.deg2rad(degrees))
    wall = [[1, 2 + height], [1, 1 + height], [outlet, 1], [outlet, 0.5]]
    hopper = {"z": [1 + height, 1], "regime": "mass_flow", "wall_factor": 2 / 3}
    return wall, {"shaft": [2 + height, 1 + height], "hopper": hopper, "pipe": [1, 0.5]}


@pytest.mark.parametrize("size", [1e-2, 1.0, 1e2])
@pytest.mark.parametrize("degrees", [5, 26.6, 45])
def test_a_mass_flow_hopper_of_any_size_passes(tmp_path: Path, degrees: float, size: float) -> None:
    wall, sections = cone(degrees)
    scaled = (size * np.array(wall)).tolist()
    for name, section in sections.items():
        levels = section["z"] if isinstance(section, dict) else section
        sections[name] = {"z": [size * z for z in levels], "regime": "mass_flow", "wall_factor": 2 / 3}
    assert failed(plan_of(tmp_path, scaled, sections=sections)) == []


@pytest.mark.parametrize("wall", [[[1, 2], [1, 0]], [[0.1, 3], [0.1, 0]], [[10, 0.5], [10, 0]]])
def test_a_pipe_passes_however_flat_or_tall(tmp_path: Path, wall: Points) -> None:
    assert failed(plan_of(tmp_path, wall)) == []


@pytest.mark.parametrize(
    "profile", [{"outlet_profile": "uniform"}, {"outlet_profile": "annular", "annulus": [0.2, 0.4]}]
)
def test_an_outlet_profile_that_the_case_gives_passes(tmp_path: Path, profile: dict[str, object]) -> None:
    wall, sections = cone(26.6)
    assert failed(plan_of(tmp_path, wall, sections=sections, **profile)) == []


@pytest.fixture
def unseen_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    """The planner, which refuses a fluid above a floor, does not see any."""
    monkeypatch.setattr("granpipe.planning.sections._floors", lambda case, outline: [])


@pytest.mark.usefixtures("unseen_floors")
@pytest.mark.parametrize("degrees", [80, 85, 88])
def test_a_floor_that_is_nearly_level_turns_the_fluid_upwards(tmp_path: Path, degrees: float) -> None:
    wall, sections = cone(degrees)
    assert "upward flow through the worst level, relative to the whole flow" in failed(
        plan_of(tmp_path, wall, sections=sections)
    )


@pytest.mark.usefixtures("unseen_floors")
@pytest.mark.parametrize(
    "wall", [[[1, 2], [1, 1], [0.5, 1], [0.5, 0.5]], [[0.09, 0.11], [0.09, 0], [0.024, 0], [0.024, -0.006]]]
)
def test_a_flat_bottom_fails_by_its_eddies_and_its_fast_core(tmp_path: Path, wall: Points) -> None:
    names = failed(plan_of(tmp_path, wall))
    assert "upward flow through the worst level, relative to the whole flow" in names
    assert "fastest downward velocity over the mean of its level" in names


def test_a_fluid_where_an_obstacle_stands_is_marked_by_the_section(tmp_path: Path) -> None:
    ring = {"ring": [[0.6, 0.8], [1, 0.8], [1, 1], [0.6, 1]]}
    assert any("obstacle ring stands in it" in name for name in failed(plan_of(tmp_path, [[1, 2], [1, 0]], ring)))


def test_an_annulus_narrower_than_the_cells_is_marked(tmp_path: Path) -> None:
    wall, sections = cone(26.6)
    plan = plan_of(tmp_path, wall, sections=sections, outlet_profile="annular", annulus=[0.2, 0.23])
    assert "cells of the grid across the narrowest opening" in failed(plan)


def test_an_annulus_that_nothing_passes_is_refused(tmp_path: Path) -> None:
    wall, sections = cone(26.6)
    with pytest.raises(CaseError, match=r"annular outlet is 1e-10 m wide: no particle passes it"):
        plan_of(tmp_path, wall, sections=sections, outlet_profile="annular", annulus=[0.2, 0.2 + 1e-10])
    with pytest.raises(CaseError, match=r"reaches to 0.6 m, but the outlet has a radius of 0.5 m"):
        plan_of(tmp_path, wall, sections=sections, outlet_profile="annular", annulus=[0.2, 0.6])


def test_the_clean_up_is_large_where_an_outlet_is_far_too_narrow() -> None:
    """A slit of 1e-10 of the vessel: Taylor–Hood elements do not conserve there; solved without the case's checks."""
    wall = np.array(cone(26.6)[0])
    annulus = (0.2, 0.2 + 1e-6)
    mesh = mesh_section(wall, {}, {}, outlet_radii=annulus)
    assert solve_fluid(mesh, WallLaw(outlet_profile="annular", annulus=annulus), 1.0).correction > 0.01


# --- the field that a hybrid follows ----------------------------------------------------------------------------------

VESSEL: Points = [[1, 4], [1, 2], [1.5, 2], [1.5, 0]]
SECTIONS: dict[str, object] = {"pipe": [4, 2], "chamber": [2, 0]}


def saved(folder: Path, wall: Points, name: str = "field.npz") -> Path:
    """The field of some vessel, a fluid's, as an earlier run might have left it."""
    plan = plan_of(folder, wall)
    solution = solve_fluid(mesh_section(plan.outline.wall, {}, {}), WallLaw(), 2.0)
    to_field(solution, plan.grid, plan.outline.inside_fraction(plan.grid), 0.6).save(folder / name)
    return folder / name


def followed(folder: Path, path: Path) -> list[tuple[object, object]]:
    return list(
        known_results(
            plan_of(folder, VESSEL, sections=SECTIONS, model="hybrid", diameter="8 cm", known_field=str(path))
        )
    )


def test_the_field_of_the_same_vessel_is_followed(tmp_path: Path) -> None:
    ((_, made),) = followed(tmp_path, saved(tmp_path, VESSEL))
    assert made.gates == ()
    assert "provenance.json" in made.notes[0]
    assert made.field.grid.z_edges[0] == 0


@pytest.mark.parametrize(
    "wall",
    [
        [[1, 4], [1, 2], [1.48, 2], [1.48, 0]],
        [[1, 4], [1, 1.5], [1.5, 1.5], [1.5, 0]],
        [[1.02, 4], [1.02, 2], [1.5, 2], [1.5, 0]],
        [[1.5, 4], [1.5, 0]],
    ],
)
def test_the_field_of_another_vessel_is_refused(tmp_path: Path, wall: Points) -> None:
    with pytest.raises(CaseError, match="is the field of another vessel: at z = "):
        followed(tmp_path, saved(tmp_path, wall))


def test_a_field_without_downward_flow_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, VESSEL)
    field = Field.load(path)
    assert field.psi is not None
    turned = replace(field, bulk_flow=-2.0, psi=-field.psi, flux_r=-field.flux_r, flux_z=-field.flux_z)
    turned.save(path)
    with pytest.raises(CaseError, match=r"has a flow of -2 m³/s"):
        followed(tmp_path, path)


@pytest.mark.parametrize("packing", [0.02, 0.95])
def test_a_field_whose_packing_no_bed_has_is_refused(tmp_path: Path, packing: float) -> None:
    path = saved(tmp_path, VESSEL)
    field = Field.load(path)
    replace(field, bulk_packing=packing, bulk_flow=field.bulk_flow * field.bulk_packing / packing).save(path)
    with pytest.raises(CaseError, match=f"has a reference packing of {packing:g}"):
        followed(tmp_path, path)


def test_a_field_without_stream_function_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, VESSEL)
    replace(Field.load(path), psi=None).save(path)
    with pytest.raises(CaseError, match="has no stream function"):
        followed(tmp_path, path)


def test_the_marks_of_the_run_that_is_followed_stay_with_the_hybrid(tmp_path: Path) -> None:
    path = saved(tmp_path, VESSEL)
    gates = [
        {"name": "packing in the plug", "value": 0.4, "limit": "0.5 to 0.68", "passed": False},
        {"name": "independent blocks", "value": 30, "limit": "at least 20", "passed": True},
    ]
    (tmp_path / "provenance.json").write_text(json.dumps({"quality": gates}))
    ((_, made),) = followed(tmp_path, path)
    assert [gate.name for gate in made.gates] == [f"{path}: packing in the plug"]
    assert made.notes == ()


@pytest.mark.parametrize("name", ["field.npz", "provenance.json", "manifest.json"])
def test_a_field_whose_folder_has_changed_since_it_was_written_is_refused(tmp_path: Path, name: str) -> None:
    earlier = tmp_path / "earlier"
    earlier.mkdir()
    path = saved(earlier, VESSEL)
    (earlier / "provenance.json").write_text(json.dumps({"quality": []}))
    write_manifest(earlier)
    ((_, made),) = followed(tmp_path, path)
    assert made.notes == ()
    (earlier / name).write_bytes((earlier / name).read_bytes() + b" " if name != "manifest.json" else b"{}")
    with pytest.raises(DataError, match="damaged"):
        followed(tmp_path, path)


@pytest.mark.parametrize("text", ["{}", '{"quality": [{"name": "x"}]}', "[]", "no JSON"])
def test_a_field_whose_gates_cannot_be_read_is_refused(tmp_path: Path, text: str) -> None:
    path = saved(tmp_path, VESSEL)
    (tmp_path / "provenance.json").write_text(text)
    with pytest.raises(DataError, match=r"provenance\.json: damaged"):
        followed(tmp_path, path)


# --- seams ------------------------------------------------------------------------------------------------------------


def hybrid(folder: Path, core: float, factor: float = 1e5) -> ModelResult:
    """A hybrid where the known flow's core is so many times as fast as its mean; without eddies, walls slip."""
    wall: Points = [[0.5, 4], [0.5, 2], [1, 2], [1, 0]]
    path, sections = str(folder / "field.npz"), {"pipe": [4, 2], "chamber": [2, 0]}
    plan = plan_of(
        folder, wall, sections=sections, model="hybrid", diameter="8 cm", known_field=path, force_factor=factor
    )
    solution = solve_fluid(mesh_section(plan.outline.wall, {}, {}), WallLaw(walls="slip", solids="slip"), 1.0)
    field = to_field(solution, plan.grid, plan.outline.inside_fraction(plan.grid), 0.6)
    assert field.psi is not None
    psi = field.psi[:, -1:] * (1 - (1 - field.psi / field.psi[:, -1:]) ** core)
    flux_r, flux_z = flux_from_psi(psi, field.grid)
    replace(field, psi=psi, flux_r=flux_r, flux_z=flux_z).save(folder / "field.npz")
    store = Store(folder / "store")
    return hybrid_field(plan, Context(store, {}, Silent(), 1))


def hybrid_failures(folder: Path, core: float, factor: float = 1e5) -> list[str]:
    return [gate.name for gate in hybrid(folder, core, factor).gates if not gate.passed]


def test_a_hybrid_that_follows_a_plug_passes(tmp_path: Path) -> None:
    assert hybrid_failures(tmp_path, core=1.0) == []


@pytest.mark.parametrize("core", [2.0, 4.0])
def test_a_fast_core_that_the_fluid_beyond_the_seam_cannot_have_is_marked(tmp_path: Path, core: float) -> None:
    """Over the area x the core has w = core (1 − x)^(core − 1), the plug w = 1: E² = 1 − 1 / ∫w²."""
    (gate,) = (gate for gate in hybrid(tmp_path, core).gates if "upper seam of chamber" in gate.name)
    assert not gate.passed
    assert gate.value == pytest.approx(np.sqrt(1 - (2 * core - 1) / core**2), abs=0.06)


def test_where_the_fluid_is_alone_its_error_is_not_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was 0, as if the fluid were right there."""

    def with_errors(plan: Plan) -> list[tuple[Span, ModelResult]]:
        ((span, made),) = known_results(plan)
        errors = {"flux_r_se": np.zeros_like(made.field.flux_r), "flux_z_se": np.full_like(made.field.flux_z, 1e-3)}
        return [(span, replace(made, field=replace(made.field, **errors)))]

    monkeypatch.setattr("granpipe.pipeline.hybrid_field.known_results", with_errors)
    field = hybrid(tmp_path, core=1.0).field
    assert field.flux_z_se is not None
    z = field.grid.z_edges
    assert np.isnan(field.flux_z_se[z > 3.5]).all()
    assert np.isfinite(field.flux_z_se[z < 1.99]).all()
    share = field.flux_z_se[z < 0.5, 0] / -field.flux_z[z < 0.5, 0]
    assert share == pytest.approx(1e-3 / (0.6 / np.pi), rel=0.1)  # a plug of 1 m³/s of bulk in a radius of 1 m
    field.save(tmp_path / "hybrid.npz")
    assert nodal_errors(Field.load(tmp_path / "hybrid.npz")) is None
    (whole,) = compare(field, replace(field, flux_z=1.1 * field.flux_z, flux_r=1.1 * field.flux_r), {}, 0.08)
    assert whole.observed == pytest.approx(0.1)
    assert 0 < whole.noise < 0.1


def test_a_force_that_is_too_weak_is_marked(tmp_path: Path) -> None:
    names = hybrid_failures(tmp_path, core=2.0, factor=1.0)
    assert "difference of the fluid from the flow that it follows, sections of chamber" in names
