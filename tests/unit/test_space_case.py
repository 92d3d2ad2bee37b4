"""A case with walls in space: how it is read, planned and refused, its decks, its health, and its conserving field."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.drawings import write_step
from fakes.space_walls import square_hopper, write_stl

from granpipe.case.reader import load_case, read_case, varied
from granpipe.case.schema import Case
from granpipe.dem.deck import make_deck, render
from granpipe.dem.health import ArchError, FlowHealth
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import CaseError, RunError
from granpipe.field import Box, Boxes
from granpipe.homogenize.average import Sums
from granpipe.homogenize.conserve import Plug
from granpipe.homogenize.space_field import Projection, space_field
from granpipe.homogenize.space_outlets import OutletFaces
from granpipe.pipeline.dem_stages import insertion_boxes
from granpipe.pipeline.gates import CONSERVING
from granpipe.pipeline.health_limits import space_limits
from granpipe.planning.make import make_plan, model_plans
from granpipe.planning.plan import Plan
from granpipe.system.gmsh_session import gmsh_session

CASES = Path(__file__).parents[2] / "cases"


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(CASES / "two_outlets.yaml")


@pytest.fixture(scope="module")
def plan(case: Case) -> Plan:
    return make_plan(case)


def case_with(vessel: str, folder: Path) -> Path:
    """The file of the two outlets' case with another vessel."""
    text = (CASES / "two_outlets.yaml").read_text()
    begin, end = text.index("vessel:"), text.index("material:")
    (folder / "case.yaml").write_text(f"{text[:begin]}vessel: {vessel}\n\n{text[end:]}")
    return folder / "case.yaml"


def test_the_resolved_case_is_read_again_as_the_same(case: Case, tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(case.to_yaml())
    assert load_case(tmp_path / "case.yaml") == case


def test_walls_that_were_changed_since_are_refused(tmp_path: Path) -> None:
    write_stl(tmp_path / "walls.stl", square_hopper())
    resolved = load_case(case_with("{file: walls.stl, unit: mm}", tmp_path)).to_yaml()
    write_stl(tmp_path / "walls.stl", 2 * square_hopper())
    (tmp_path / "resolved.yaml").write_text(resolved)
    with pytest.raises(CaseError, match="is not the file any more"):
        load_case(tmp_path / "resolved.yaml")


def test_a_pipe_in_place_of_the_walls_is_refused_and_blocks_nothing(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "two_outlets.stl")
    (tmp_path / "case.yaml").write_text((CASES / "two_outlets.yaml").read_text())
    with pytest.raises(CaseError, match="a pipe, not a regular file"):
        load_case(tmp_path / "case.yaml")


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"model": "fluid"}, ("model",), "by particles only"),
        ({"model": "hybrid"}, ("model",), "by particles only"),
        ({"fluid.rheology": "frictional"}, ("fluid",), "by particles only"),
        ({"dem.outlet": "open"}, ("dem", "outlet"), "have plates"),
        ({"dem.walls": "set_back"}, ("dem", "walls"), "stay where they are"),
        ({"dem.facets": "24"}, ("dem", "facets"), "those of its file"),
        ({"dem.thickness": "5 cm"}, ("dem", "thickness"), "only a slab"),
        ({"homogenize.method": "gaussian"}, ("homogenize", "method"), "nearest conserving flow"),
        ({"homogenize.fields": "[stress]"}, ("homogenize", "fields"), "on rings only"),
        ({"homogenize.cell": "0.1 mm"}, ("vessel",), "cells of 0.0001 m"),
        ({"export": "[openfoam]"}, ("export",), "choose of comsol, vtk"),
        ({"flow_rate": "50 t/h"}, ("flow_rate",), "outlet left"),
        ({"material.size": "{diameter: 8 mm}"}, ("vessel", "outlets", "left", "at"), "only 4 times"),
    ],
)
def test_what_a_vessel_in_space_cannot_have_is_refused(
    case: Case, changes: dict[str, str], key: tuple[str, ...], says: str
) -> None:
    with pytest.raises(CaseError) as error:
        make_plan(varied(case, changes))
    assert error.value.key == key
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("share: 60 %", "share: 50 %", "add up to 90 %"),
        ("unit: mm", "unit: kg", "unit"),
        ("two_outlets.stl ", "nowhere.stl ", "cannot be read"),
        ("vessel:", "outline: {wall: [[1, 1], [1, 0]]}\nvessel:", "stands beside `vessel`"),
        ("vessel:", "outline: {symmetry: space, sections: {a: [1, 0]}}\nvessel:", "stands beside `vessel`"),
        ("at: [-25, 0, 0]", "at: [-25, 0]", "three plain numbers"),
    ],
)
def test_a_case_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = (CASES / "two_outlets.yaml").read_text()
    assert old in text
    (tmp_path / "two_outlets.stl").write_bytes((CASES / "two_outlets.stl").read_bytes())
    (tmp_path / "case.yaml").write_text(text.replace(old, new, 1))
    with pytest.raises(CaseError, match=says):
        read_case(tmp_path / "case.yaml")


def test_a_written_case_is_read_again_though_the_outline_has_new_keys(tmp_path: Path) -> None:
    text = (CASES / "two_outlets.yaml").read_text()
    (tmp_path / "two_outlets.stl").write_bytes((CASES / "two_outlets.stl").read_bytes())
    written = "outline: {unit: m, symmetry: space, obstacles: {}, sections: {}}"  # front_and_back came later
    (tmp_path / "case.yaml").write_text(f"{written}\n{text}")
    assert read_case(tmp_path / "case.yaml").case.vessel is not None


def test_space_without_a_vessel_is_refused() -> None:
    with pytest.raises(CaseError, match="stands beside a `vessel`"):
        load_case(CASES / "smoke.yaml", {"outline": "{symmetry: space}"})


def test_models_side_by_side_say_why_there_is_one(case: Case) -> None:
    plans = model_plans(case)
    assert isinstance(plans["dem"], Plan)
    assert isinstance(plans["fluid"], CaseError)
    assert isinstance(plans["hybrid"], CaseError)


def deck_text(plan: Plan, template: str) -> str:
    assert plan.space is not None
    boxes = insertion_boxes(plan.space, plan.dem, plan.dem.plate_z + 4e-3, 4e-3, plan.dem.feed_top)
    sides = (-0.05, 0.05), (-0.02, 0.02)
    return render(make_deck(plan.case, plan.dem, boxes, (), sides, ["plate_left", "plate_right"]), template)


def test_each_plate_sinks_with_its_part_of_the_flow(plan: Plan) -> None:
    text = deck_text(plan, "produce.in")
    for fix, mean in (("sinking", plan.dem.plate_speed), ("starting", plan.dem.start_speed)):
        left, right = (
            -float(re.findall(rf"fix {fix}_{side} all move/mesh mesh plate_{side} linear 0.0 0.0 (\S+?)\"", text)[0])
            for side in ("left", "right")
        )
        assert left / right == pytest.approx(1.5)
        assert 0.5 * (left + right) == pytest.approx(mean)
    left = 1.2 * plan.dem.plate_speed
    assert plan.dem.bottom < plan.dem.plate_z - left * plan.dem.length.room


def test_particles_are_put_in_by_blocks(plan: Plan) -> None:
    text = deck_text(plan, "fill.in")
    unions = [line.split() for line in text.splitlines() if " union " in line]
    assert unions
    for words in unions:
        names = words[4 : 4 + int(words[3])]
        assert all(f"region          {name} block" in text for name in names)


def test_blocks_are_cut_at_a_level() -> None:
    boxes = Boxes(((0, 1, 0, 1, 0, 2), (1, 2, 0, 1, 1, 3)))
    assert (boxes.z_low, boxes.z_high, boxes.volume) == (0, 3, 4)
    upper = boxes.cut(1.5, 3)
    assert upper.volume == pytest.approx(0.5 + 1.5)
    assert boxes.cut(2.5, 3).blocks == ((1, 2, 0, 1, 2.5, 3),)


def particles(step: int, position: np.ndarray) -> Snapshot:
    """Particles of 6 mm at rest."""
    count = len(position)
    columns = ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")
    still = np.zeros((count, 3))
    values = np.column_stack([np.arange(count), np.ones(count), position, still, np.full(count, 3e-3)])
    return Snapshot(step, np.array([[-1.0, 1.0]] * 3), columns, values)


def health_of(plan: Plan, present: int) -> FlowHealth:
    assert plan.space is not None
    return FlowHealth(plan.dem, plan.case, space_limits(plan.space, plan.dem, 0.5), present)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.03), (0.0, 0.0, -0.01), (0.051, 0.0, 0.07), (-0.025, 0.0, -5.0)])
def test_a_particle_outside_the_walls_ends_the_run(plan: Plan, place: tuple[float, float, float]) -> None:
    inside = np.array([[-0.025, 0.0, 0.0], [0.025, 0.0, -0.01], [0.0, 0.0, 0.06], [0.0, 0.0, 0.1]])
    health_of(plan, 4).snapshot(particles(0, inside))
    with pytest.raises(RunError, match="1 particle outside the walls"):
        health_of(plan, 5).snapshot(particles(0, np.vstack([inside, place])))


def falling(plan: Plan, moving: tuple[float, float]) -> None:
    """Columns of particles above both outlets sink, each at its part of the plates' speed."""
    health = health_of(plan, 1000)
    height, side, depth = np.meshgrid(np.arange(-20, 120, 2) / 1e3, [-0.025, 0.025], np.linspace(-0.012, 0.012, 5))
    columns = np.column_stack([side.ravel(), depth.ravel(), height.ravel()])
    for number in range(90):
        step = number * plan.dem.dump_every
        travel = plan.dem.plate_speed * plan.dem.time_step * step
        sunk = columns - travel * np.where(columns[:, :1] < 0, moving[0], moving[1]) * [0, 0, 1]
        health.passing.add(particles(step, sunk))


def test_an_arch_above_one_of_two_outlets_is_seen(plan: Plan) -> None:
    """The other outlet alone carries 60 % of the flow: over both of them nothing would be missing."""
    with pytest.raises(ArchError, match="outlet right"):
        falling(plan, (1.2, 0.0))


def test_flow_through_both_outlets_is_no_arch(plan: Plan) -> None:
    falling(plan, (1.2, 0.8))


def balanced(cells: np.ndarray, outlets: list[np.ndarray], leaving: list[float]) -> tuple[Any, ...]:
    shape = cells.shape
    random = np.random.default_rng(1)
    sizes = [tuple(n + (axis == k) for axis, n in enumerate(shape)) for k in (2, 1, 0)]
    faces = []
    for k, axis in enumerate((2, 1, 0)):
        mask = np.ones(sizes[k], bool)
        if axis:  # sides are closed
            for end in (0, -1):
                index: list[Any] = [slice(None)] * 3
                index[axis] = end
                mask[tuple(index)] = False
        faces.append(mask)
    flow = tuple(random.normal(-1.0 if k == 2 else 0.0, 0.3, size) for k, size in enumerate(sizes))
    variance = tuple(random.uniform(0.5, 2.0, size) for size in sizes)
    still = np.zeros(sizes[0], np.int8), np.zeros(sizes[1], np.int8)
    below = [np.concatenate([[-one.astype(np.int8)], np.zeros(shape, np.int8)]) for one in outlets]
    given = [OutletFaces((*still, one), None) for one in below]
    return Projection(cells, faces, variance, given).of(flow, sum(leaving), leaving)


def test_each_outlet_has_the_flow_that_is_asked_for() -> None:
    cells = np.ones((6, 5, 8), bool)
    left = np.zeros((5, 8), bool)
    left[:, :4] = True
    x, y, z = balanced(cells, [left, ~left], [24.0, 16.0])
    assert -z[0][left].sum() == pytest.approx(24.0, rel=1e-10)
    assert -z[0][~left].sum() == pytest.approx(16.0, rel=1e-10)
    np.testing.assert_allclose(-z.sum(axis=(1, 2)), 40.0, rtol=1e-10)
    out = np.diff(x, axis=2) + np.diff(y, axis=1) + np.diff(z, axis=0)
    assert np.abs(out).max() <= 1e-12 * 40


def test_a_step_file_of_the_inside_is_opened_at_top_and_bottom(tmp_path: Path) -> None:
    """A round hopper, drawn in mm: its areas are those of 48 chords, its case one whose unit is that of `at` alone."""
    wall = [(30.0, 80.0), (30.0, 50.0), (18.0, 0.0)]
    write_step(tmp_path / "walls.step", [(r / 1000, z / 1000) for r, z in wall], {}, turned=True)
    vessel = "{file: walls.step, unit: mm, outlets: {out: {at: [5, 0, 0], share: 1}}}"
    made = make_plan(load_case(case_with(vessel, tmp_path))).space
    assert made is not None
    assert made.outlets[0].opening.area == pytest.approx(np.pi * 0.018**2, rel=0.01)
    assert made.inlet.area == pytest.approx(np.pi * 0.030**2, rel=0.01)
    cone = np.pi * 0.05 / 3 * (0.030**2 + 0.030 * 0.018 + 0.018**2)
    assert made.outline.volume() == pytest.approx(cone + np.pi * 0.030**2 * 0.03, rel=0.01)


@pytest.mark.parametrize(
    ("boxes", "cut", "says"),
    [
        ([(66, 100), (60, 100)], True, r"face about \(0, 0, 0.*1?\) m, where its body is opened, has a hole"),
        ([(60, 100), (20, 100)], True, "give the space inside the vessel as the body, not its walls"),
        ([(60, 100), (40, -50)], False, "holds 2 bodies: join them to one"),
    ],
    ids=["walls with a thickness", "a post through inlet and outlet", "two bodies on top of each other"],
)
def test_a_step_file_of_anything_but_the_inside_is_refused(
    tmp_path: Path, boxes: list[tuple[float, float]], cut: bool, says: str
) -> None:
    """Square boxes of these widths and heights [mm]; the second is cut from the first, or stands beside it."""
    with gmsh_session("boxes") as gmsh:
        one, other = (
            gmsh.model.occ.addBox(-w / 2000, -w / 2000, min(0, h) / 1000, w / 1000, w / 1000, abs(h) / 1000)
            for w, h in boxes
        )
        if cut:
            gmsh.model.occ.cut([(3, one)], [(3, other)])
        gmsh.model.occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.write(str(tmp_path / "walls.step"))
    with pytest.raises(CaseError, match=says) as error:
        make_plan(load_case(case_with("{file: walls.step}", tmp_path)))
    assert error.value.key == ("vessel", "file")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("walls.step", b"ISO-10303-21; nonsense", "not a STEP or BREP file"),
        ("walls.stl", b"solid nothing\nendsolid nothing\n", "no triangles"),
        ("walls.stl", b"\x00" * 10, "no triangles"),
        ("walls.iges", b"IGES", "is not read"),
    ],
)
def test_files_that_are_no_walls_are_refused(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CaseError, match=says) as error:
        make_plan(load_case(case_with(f"{{file: {name}, unit: mm}}", tmp_path)))
    assert error.value.key == ("vessel", "file")


def changed_by_conserving(tilt: float, noise: float) -> float:
    """Of a plug flow whose segments have noise; `tilt` is a sidewise flow, the same in all, that walls do not allow."""
    random, grid = np.random.default_rng(4), Box.within((0, 0.1), (0, 0.1), (0, 0.1), 0.01, flat=False, cut=True)
    cell, faces = 1e-6, (10, 10, 10)
    segments = []
    for number in range(12):
        x, y, z = (random.normal(0.0, noise, [n + (axis == k) for axis, n in enumerate(faces)]) for k in (2, 1, 0))
        z -= 1.0
        x += tilt * np.linspace(0, 1, 11)  # more and more: solids would have to come from nowhere
        empty = {name: np.zeros(1) for name in ("time", "solids", "kinetic", "count")}
        volume, still = np.full(faces, 0.58 * cell), np.zeros(faces)
        empty |= {"level_flow": np.zeros((1, 11)), "flow_y": 1e-4 * y}
        times = float(number), number + 1.0, 1.0, 1.0
        segments.append(Sums(grid, "displacement", *times, volume, 1e-4 * x, 1e-4 * z, still, **empty))
    plug = Plug(0.58, 1e-2, 0.0, (0.0, 0.1))
    return space_field(segments, np.ones(faces), plug, 0.02).change


def test_what_conserving_changes_is_told_beyond_noise() -> None:
    """Noise of 20 % goes without a mark, a flow that no walls allow does not, with noise or without."""
    assert changed_by_conserving(0.0, 0.2) < 0.02
    assert changed_by_conserving(0.5, 0.01) == pytest.approx(changed_by_conserving(0.5, 0.2), rel=0.15)
    assert changed_by_conserving(0.5, 0.01) > CONSERVING.high
