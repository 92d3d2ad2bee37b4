"""Slabs between a front and a back wall, `outline.front_and_back: walls`, short of LIGGGHTS."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from fakes.cases import case_of

from granpipe.analysis.residence_time import residence_time
from granpipe.analysis.streamlines import age
from granpipe.case.schema import Case
from granpipe.dem.contacts import Contacts
from granpipe.dem.deck import Deck, make_deck, render
from granpipe.dem.snapshot import Snapshot
from granpipe.dem.stress import bed_stress
from granpipe.dem.vessel import free_flow
from granpipe.errors import CaseError, DataError, MeshError
from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported
from granpipe.field import Array, Box, Field, Measure, flux_from_psi
from granpipe.geometry.insertion import insertion_frusta
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import SMALLEST_ANGLE, triangle_angles
from granpipe.geometry.walled import walled_slab
from granpipe.geometry.walls import build_walls
from granpipe.homogenize.average import Collector
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.particle_fields import contact_counts
from granpipe.pipeline.dump_grid import slab_grid
from granpipe.pipeline.dump_window import Frame
from granpipe.pipeline.field_vessel import check_vessel
from granpipe.pipeline.health_limits import flow_limits
from granpipe.planning.make import make_plan, model_plans
from granpipe.planning.plan import Plan
from granpipe.rzmesh import RZMesh
from granpipe.study import fluid as study_fluid
from granpipe.study.points import make_study

LEFT = [[-0.05, 0.2], [-0.05, 0.08], [-0.02, 0.03], [-0.02, 0.0]]
RIGHT = [[0.03, 0.2], [0.03, 0.1], [0.02, 0.05], [0.02, 0.0]]
TOP, BOTTOM = 0.25, -0.1
DIAMETER, DEPTH = 0.004, 0.06
BAR = [[-0.01, 0.14], [0.01, 0.14], [0.0, 0.15]]
LIP = [[-0.05, 0.15], [-0.05, 0.13], [-0.04, 0.135]]
TIP = [[-0.05, 0.11], [-0.03, 0.10], [-0.03, 0.12]]
"""It touches the left wall in one point."""

SECTION = shapely.Polygon(
    [[-0.05, TOP], *LEFT, [-0.02, BOTTOM], [0.02, BOTTOM], *RIGHT[::-1], [0.03, TOP]]
)  # with the straight ends


def outline_of(obstacles: dict[str, Any] | None = None, scale: float = 1.0, depth: float = DEPTH) -> Outline:
    def scaled(points: Any) -> Any:
        return (scale * np.array(points)).tolist()

    solids = {name: scaled(points) for name, points in (obstacles or {}).items()}
    return Outline.of(scaled(RIGHT), solids, {}, scaled(LEFT), scale * depth, walled=True)


def slab(**changes: object) -> Case:
    """A hopper whose walls are different, with particles between a front and a back wall."""
    case: dict[str, Any] = {
        "name": "slab",
        "outline": {
            "symmetry": "plane", "left": LEFT, "right": RIGHT, "depth": DEPTH, "front_and_back": "walls",
        },
        "material": {"density": 2500, "size": {"diameter": DIAMETER}},
        "flow_rate": "0.001 m^3/h",
        "model": "dem",
    }  # fmt: skip
    return case_of(case, **changes)


def planned(**changes: object) -> Plan:
    return make_plan(slab(**changes))


def deck_of(plan: Plan, margin: float = 0.5 * DIAMETER) -> Deck:
    dem, outline = plan.dem, plan.outline
    frusta = insertion_frusta(outline, dem.feed_top, dem.plate_z + DIAMETER, margin, np.radians(60), DIAMETER)
    return make_deck(plan.case, dem, frusta, outline.obstacles, ((outline.r_min, outline.r_max), (0.0, DEPTH)))


# --- the walls --------------------------------------------------------------------------------------------------------


def area(corners: Array) -> float:
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return float(0.5 * np.linalg.norm(np.cross(first, second), axis=1).sum())


def open_edges(meshes: dict[str, Array], step: float) -> tuple[Counter[int], Array]:
    """How many triangles share an edge → number of edges; the points (n, 3) of those that one triangle has alone."""
    places = [np.round(corner / step).astype(int) for mesh in meshes.values() for corner in mesh]
    shared = Counter(frozenset((tuple(t[i]), tuple(t[i - 1]))) for t in places for i in range(3))
    alone = [point for edge, count in shared.items() if count == 1 for point in edge]
    return Counter(shared.values()), step * np.array(alone)


@pytest.mark.parametrize("obstacles", [{}, {"bar": BAR}, {"bar": BAR, "lip": LIP}], ids=["none", "bar", "bar and lip"])
def test_the_surface_is_closed_but_for_inlet_and_outlet_and_has_the_area_and_volume_of_the_section(obstacles):
    meshes = walled_slab(outline_of(obstacles), TOP, BOTTOM)
    counts, alone = open_edges(meshes, 1e-7)
    assert set(counts) == {1, 2}
    assert set(np.round(alone[:, 2], 6)) == {TOP, BOTTOM}
    free = SECTION.difference(shapely.union_all([shapely.Polygon(one) for one in obstacles.values()]))
    corners = np.concatenate(list(meshes.values()))
    faces = np.ptp(corners[..., 1], axis=1) == 0
    assert area(corners[faces]) == pytest.approx(2 * free.area)
    border = sum(ring.length for part in shapely.get_parts(free) for ring in (part.exterior, *part.interiors))
    assert area(corners[~faces]) == pytest.approx(DEPTH * (border - 0.08 - 0.04))  # without inlet and outlet
    straight = 0.08 * (TOP - 0.2) - 0.04 * BOTTOM
    assert outline_of(obstacles).volume() == pytest.approx(DEPTH * (free.area - straight))


def test_an_obstacle_that_touches_a_wall_in_a_point_leaves_no_gap():
    counts, alone = open_edges(walled_slab(outline_of({"tip": TIP}), TOP, BOTTOM), 1e-7)
    assert set(counts) == {1, 2, 4}
    assert counts[4] == 1  # along y, where they touch
    assert set(np.round(alone[:, 2], 6)) == {TOP, BOTTOM}


def test_an_obstacle_a_hair_off_a_wall_stands_on_it():
    off = [[-0.05 + 1e-7, 0.15], [-0.05 + 1e-7, 0.13], [-0.04, 0.135]]
    meshes = walled_slab(outline_of({"lip": off}), TOP, BOTTOM)
    assert area(meshes["obstacle_lip"]) == pytest.approx(
        DEPTH * (np.hypot(0.01, 0.015) + np.hypot(0.01, 0.005)), rel=1e-4
    )
    assert triangle_angles(np.concatenate(list(meshes.values()))).min() > SMALLEST_ANGLE


@pytest.mark.parametrize(("scale", "depth"), [(1.0, 0.02), (1.0, 2.0), (0.01, DEPTH), (100.0, DEPTH)])
def test_no_triangle_is_thin_in_thin_and_deep_small_and_large_slabs(scale, depth):
    meshes = walled_slab(outline_of({"bar": BAR, "lip": LIP}, scale, depth), scale * TOP, scale * BOTTOM)
    corners = np.concatenate(list(meshes.values()))
    assert triangle_angles(corners).min() > SMALLEST_ANGLE
    assert set(open_edges(meshes, 1e-7 * scale)[0]) == {1, 2}


def test_an_edge_too_short_for_strips_is_refused():
    crooked = [[-0.05, 0.2], [-0.05, 0.08], [-0.05 + 1e-5, 0.08 - 1e-5], [-0.02, 0.03], [-0.02, 0.0]]
    with pytest.raises(MeshError, match="leave it out"):
        walled_slab(Outline.of(RIGHT, {}, {}, crooked, DEPTH, walled=True), TOP, BOTTOM)


def test_walls_and_plate_reach_from_the_front_to_the_back_wall(tmp_path: Path):
    walls = build_walls(
        outline_of(), top=TOP, bottom=BOTTOM, plate_z=-0.02, particle_diameter=DIAMETER, folder=tmp_path
    )
    assert walls.sides == ((-0.05, 0.03), (0.0, DEPTH))
    assert walls.box[1] == pytest.approx([0.0, DEPTH])
    assert walls.plate_area == pytest.approx(0.04 * DEPTH)
    assert {path.name for path in tmp_path.iterdir()} == {"vessel.stl", "plate.stl"}
    numbers = [line.split()[1:] for line in (tmp_path / "plate.stl").read_text().splitlines() if "vertex" in line]
    plate = np.array(numbers, dtype=float).reshape(-1, 3, 3)
    assert area(plate) == pytest.approx(0.04 * DEPTH)
    assert (plate[..., 1].min(), plate[..., 1].max()) == (0.0, DEPTH)


# --- the deck ---------------------------------------------------------------------------------------------------------


def test_no_face_of_the_box_is_periodic_and_the_walls_have_room_in_it():
    deck = deck_of(planned())
    text = render(deck, "fill.in")
    assert re.search(r"boundary +f f f", text)
    assert re.search(r"boundary +f f f", render(deck, "produce.in"))
    assert deck.box[2] < 0
    assert deck.box[3] > DEPTH
    assert "side out" not in text  # prisms of a slab have in common what they hold


def test_particles_are_inserted_clear_of_the_front_and_the_back_wall():
    margin = 0.0026
    deck = deck_of(planned(), margin)
    for piece in (deck.feed, *deck.slabs):
        for region in filter(None, (piece.outer, piece.inner)):
            front, back = map(float, region.split()[3:5])
            assert front == pytest.approx(margin)
            assert back == pytest.approx(DEPTH - margin)
    frusta = insertion_frusta(outline_of(), 0.2, 0.0, margin, np.radians(60), 0.0)
    assert all(piece.measure.turn == pytest.approx(DEPTH - 2 * margin) for piece in frusta)
    assert insertion_frusta(outline_of(depth=2 * margin), 0.2, 0.0, margin, np.radians(60), 0.0) == ()


def test_a_centre_beyond_the_front_or_the_back_wall_is_outside():
    plan = planned()
    centres = np.array([[0.0, y, 0.15] for y in (-1e-4, 1e-4, DEPTH - 1e-4, DEPTH + 1e-4)])
    assert flow_limits(plan.outline, plan.dem, 0.5, None).inside(centres).tolist() == [False, True, True, False]


# --- the plan ---------------------------------------------------------------------------------------------------------


def test_particles_fill_the_whole_depth_and_the_plan_says_so():
    plan = planned()
    assert plan.outline.measure == Measure(DEPTH, axial=False, walled=True)
    told = {one.name: one.value for one in plan.decisions}
    assert told["slab depth"] == "0.06 m"
    assert float(told["gap/d90 at the gap between the front and the back wall"]) == pytest.approx(15)
    assert "slab thickness" not in told
    assert any("the mean over it" in note for note in plan.warnings)
    deeper = planned(outline__depth=2 * DEPTH)
    assert deeper.dem.particles == pytest.approx(2 * plan.dem.particles, rel=1e-2)


def test_the_stress_far_down_is_janssens_by_the_hydraulic_diameter_of_the_rectangle():
    """σ = ρ g D/(4 μ K), D = 2 w L/(w + L), K = 0.4."""
    bed = bed_stress([(0.2, 10.0), (0.2, 0.0)], 1500, 0.5, Measure(0.3, axial=False, walled=True))
    assert bed.peak == pytest.approx(1500 * 9.81 * 0.24 / (4 * 0.5 * 0.4), rel=1e-4)
    levels = outline_of().hydraulic_diameter([0.15, 0.01])
    np.testing.assert_allclose(levels, [2 * 0.08 * 0.06 / 0.14, 2 * 0.04 * 0.06 / 0.10])


def test_free_discharge_is_that_of_a_rectangle():
    """1.03 √g (L − 1.4 d)(w − 1.4 d)^1.5: the slot is 40 mm wide and 60 mm long."""
    expected = 1.03 * np.sqrt(9.81) * (0.06 - 1.4 * DIAMETER) * (0.04 - 1.4 * DIAMETER) ** 1.5
    (outlet,) = find_openings(outline_of())
    assert free_flow(outlet, DIAMETER) == pytest.approx(expected)
    (flow,) = [one for one in planned(dem__outlet="open").decisions if one.name == "flow"]
    assert float(flow.value.split()[0]) == pytest.approx(expected, rel=5e-3)


def test_free_discharge_of_a_depth_below_the_width_narrows_along_the_depth():
    (outlet,) = find_openings(outline_of(depth=0.03))
    expected = 1.03 * np.sqrt(9.81) * (0.04 - 1.4 * DIAMETER) * (0.03 - 1.4 * DIAMETER) ** 1.5
    assert free_flow(outlet, DIAMETER) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"outline__depth": 3 * DIAMETER}, ("outline", "depth"), "front and the back wall is 0.012 m wide, only 3"),
        ({"outline__depth": 0.9 * DIAMETER}, ("outline", "depth"), "no particle passes it"),
        ({"dem__thickness": 0.03}, ("dem", "thickness"), "whole outline.depth"),
        ({"model": "fluid"}, ("model",), "no front and back walls"),
        ({"model": "hybrid"}, ("model",), "no front and back walls"),
        ({"model": "fluid", "fluid__rheology": "frictional"}, ("model",), "set model: dem"),
        ({"model": "auto", "total_error": 0.1}, ("total_error",), "leave this out"),
        (
            {"model": "auto", "outline__sections": {"bin": {"z": [0.2, 0.1], "model": "fluid"}}},
            ("outline", "sections", "bin", "model"),
            "leave this out",
        ),
        ({"homogenize__fields": ["age"]}, ("homogenize", "fields"), "mean over the depth"),
        ({"homogenize__fields": ["stress", "granular_temperature"]}, ("homogenize", "fields"), "granular_temperature"),
        ({"export": ["streamlines"]}, ("export",), "mean over the depth"),
        ({"outline__front_and_back": "glass"}, ("outline", "front_and_back"), "walls"),
    ],
)
def test_what_cannot_be_had_between_walls_is_refused(changes, key, words):
    with pytest.raises(CaseError, match=words) as told:
        planned(**changes)
    assert told.value.key == key


def test_only_a_slab_has_a_front_and_a_back():
    with pytest.raises(CaseError, match="only a slab") as told:
        planned(outline={"wall": RIGHT, "front_and_back": "walls"})
    assert told.value.key == ("outline", "front_and_back")


def test_a_depth_of_five_to_ten_particles_is_noted_and_enlarged_ones_are_marked():
    assert any("front and the back wall: 8 is below 10" in note for note in planned(outline__depth=0.032).warnings)
    coarse = planned(outline__depth=0.034, dem__coarse_grain_factor=2)
    assert any("front and the back wall" in one for one in coarse.breaches)


def test_auto_takes_particles_and_no_other_model_is_possible():
    assert planned(model="auto").model == "dem"
    plans = model_plans(slab())
    assert [isinstance(plans[name], CaseError) for name in ("fluid", "hybrid", "dem")] == [True, True, False]


def test_a_study_does_not_vary_the_thickness_between_walls():
    axes = {one.axis for one in make_study(slab(), hours=1000, cores=1).variants}
    assert {"", "coarse_grain_factor", "plate_speed", "youngs_modulus"} <= axes
    assert not {"thickness", "facets"} & axes


def test_the_finite_elements_of_a_study_fill_a_deep_slab_from_wall_to_wall_and_none_is_tried_between_end_walls(
    monkeypatch,
):
    meshes: list[RZMesh] = []

    def solved(mesh: RZMesh, *given: Any) -> Any:
        meshes.append(mesh)
        return solve(mesh, *given)

    solve = study_fluid.solve_fluid
    monkeypatch.setattr(study_fluid, "solve_fluid", solved)
    for name, value in (("ACROSS", (3,)), ("ORDERS", (2,)), ("FINEST", 4)):
        monkeypatch.setattr(study_fluid, name, value)
    deep = planned(outline__front_and_back="periodic")
    (one,) = study_fluid.fluid_refinement(deep.case, deep.grid)
    assert 0 < one.error < 0.1
    drawn = shapely.Polygon([*LEFT, *RIGHT[::-1]]).area
    for mesh in meshes:
        corners = mesh.points[mesh.triangles]
        assert area(np.concatenate([corners, 0 * corners[..., :1]], axis=2)) == pytest.approx(drawn)
    assert study_fluid.fluid_refinement(slab(), planned().grid) == ()


# --- sums and fields --------------------------------------------------------------------------------------------------

GRID = Box.within((-0.05, 0.03), (0.0, DEPTH), (0.0, 0.2), 0.002, flat=True, cut=True).of_slice(
    Measure(DEPTH, axial=False, walled=True)
)
NAMES = ("id", "x", "y", "z", "vx", "vy", "vz", "radius")


def snapshot(step: int, place: Array) -> Snapshot:
    count = len(place)
    values = np.column_stack([np.arange(count), place, np.zeros((count, 3)), np.full(count, 0.5 * DIAMETER)])
    return Snapshot(step, np.array([[-1.0, 1.0], [-0.01, DEPTH + 0.01], [-1.0, 1.0]]), NAMES, values)


def test_spheres_at_opposite_walls_do_not_touch():
    place = np.array([[0.0, 0.49 * DIAMETER, 0.1], [0.0, DEPTH - 0.49 * DIAMETER, 0.1]])
    counted = contact_counts(Bins.of(GRID, DIAMETER), snapshot(0, place))["contacts"]
    assert counted[0].sum() == 2
    assert counted[1].sum() == 0


def test_a_way_along_the_depth_is_no_shorter_than_it_is_and_spheres_at_walls_count_wholly():
    collector = Collector(GRID, "displacement")
    collector.add(0.0, snapshot(0, np.array([[0.0, 0.49 * DIAMETER, 0.1]])))
    collector.add(1.0, snapshot(1, np.array([[0.0, DEPTH - 0.49 * DIAMETER, 0.1]])))
    sums = collector.take()
    volume = np.pi / 6 * DIAMETER**3
    assert sums.volume.sum() / sums.weight == pytest.approx(volume)
    assert sums.kinetic[0] == pytest.approx(0.5 * volume * (DEPTH - 0.98 * DIAMETER) ** 2)


def test_dumps_between_walls_fill_the_depth_of_the_case_wherever_it_begins():
    def filled(low, high):
        found = SimpleNamespace(low=np.array([-0.05, low, 0.0]), high=np.array([0.03, high, 0.2]), diameter=DIAMETER)
        return slab_grid(found, Frame("xz", 0.002), outline_of()).measure

    assert filled(-0.5 * DEPTH, 0.5 * DEPTH) == Measure(pytest.approx(DEPTH), axial=False, walled=True)
    with pytest.raises(DataError, match=r"dumps are 0\.03 m deep .* the case 0\.06 m"):
        filled(0.0, 0.5 * DEPTH)


def plug() -> Field:
    psi = -0.6 * 0.01 * np.tile(GRID.r_edges + 0.05, (len(GRID.z_edges), 1))
    inside = np.ones(GRID.shape)
    flux = flux_from_psi(psi, GRID)
    return Field(GRID, inside, inside > 0, *flux, 0.01 * 0.08 * DEPTH, 0.6, 1.0, psi=psi)


def test_the_table_of_levels_for_comsol_has_the_divergence_of_a_slab(tmp_path: Path):
    write_comsol(Exported(plug(), "slab", 1500.0, datetime(2026, 1, 1, tzinfo=UTC)), tmp_path)
    assert "du/dx + dw/dz" in (tmp_path / "flow_levels.txt").read_text()


def test_a_field_keeps_its_walls_in_a_file_and_tells_no_times(tmp_path: Path):
    plug().of_depth(DEPTH).save(tmp_path / "field.npz")
    again = Field.load(tmp_path / "field.npz")
    assert again.grid.measure == Measure(DEPTH, axial=False, walled=True)
    for times in (residence_time, age):
        with pytest.raises(DataError, match="mean over the depth"):
            times(again)


def test_a_field_between_walls_is_none_of_a_slab_without_them():
    straight = [[[x, 0.2], [x, 0.0]] for x in (-0.05, 0.03)]
    with pytest.raises(DataError, match="mean between a front and a back wall"):
        check_vessel(plug(), Outline.of(straight[1], {}, {}, straight[0], DEPTH), Path("field.npz"))
    check_vessel(plug(), Outline.of(straight[1], {}, {}, straight[0], DEPTH, walled=True), Path("field.npz"))
    open_field = replace(plug(), grid=replace(GRID, walled=False))
    with pytest.raises(DataError, match="not the mean"):
        check_vessel(open_field, outline_of(), Path("field.npz"))


def test_contacts_with_the_front_and_the_back_wall_press_on_neither_side():
    """Their forces would be taken for those of the nearest side wall."""
    centre = np.array([[0.0, 0.002, 0.1], [0.028, 0.03, 0.1], [-0.03, 0.03, 0.0465]])
    end = np.array([[0.0, 0.0, 0.1], [0.03, 0.03, 0.1], [-0.0317, 0.03, 0.0455]])
    force = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(Contacts(centre, end, force).across_depth().force, force[1:])
