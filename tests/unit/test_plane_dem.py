"""DEM of slabs, `outline.symmetry: plane`, short of LIGGGHTS: walls, insertion, decks, settings, sums."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.cases import case_of

from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.dem.deck import Deck, make_deck, render
from granpipe.dem.snapshot import Snapshot
from granpipe.dem.stress import bed_stress
from granpipe.errors import CaseError, MeshError
from granpipe.field import Array, Box, Measure
from granpipe.geometry.extrude import extruded
from granpipe.geometry.insertion import insertion_frusta
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import SMALLEST_ANGLE, triangle_angles
from granpipe.geometry.walls import build_walls
from granpipe.homogenize.average import Collector
from granpipe.homogenize.conserve import measure_plug
from granpipe.pipeline.discharge import Discharge
from granpipe.pipeline.health_limits import flow_limits
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.planning.planner import THICKNESS
from granpipe.study.points import make_study

LEFT = [[-0.05, 0.2], [-0.05, 0.08], [-0.02, 0.03], [-0.02, 0.0]]
RIGHT = [[0.03, 0.2], [0.03, 0.1], [0.02, 0.05], [0.02, 0.0]]
DIAMETER = 0.004
OBSTACLES = {
    "bar": [[-0.01, 0.14], [0.01, 0.14], [0.0, 0.15]],
    "lip on the left wall": [[-0.05, 0.15], [-0.05, 0.13], [-0.04, 0.135]],
    "lip on the right wall": [[0.03, 0.15], [0.015, 0.14], [0.03, 0.13]],
    "baffle on the left slope": [[-0.05, 0.08], [-0.02, 0.07], [-0.035, 0.055]],
}


def slab(**changes: object) -> Case:
    """A hopper whose walls are different, with particles."""
    case: dict[str, Any] = {
        "name": "slab",
        "outline": {"symmetry": "plane", "left": LEFT, "right": RIGHT, "depth": 0.5},
        "material": {"density": 2500, "size": {"diameter": DIAMETER}},
        "flow_rate": "0.01 m^3/h",
        "model": "dem",
    }
    return case_of(case, **changes)


def planned(**changes: object) -> Plan:
    return make_plan(slab(**changes))


def deck_of(plan: Plan) -> Deck:
    dem, outline = plan.dem, plan.outline
    frusta = insertion_frusta(outline, dem.feed_top, dem.plate_z + DIAMETER, DIAMETER, np.radians(60), DIAMETER)
    sides = ((outline.r_min, outline.r_max), (0.0, outline.measure.turn))
    return make_deck(plan.case, dem, frusta, outline.obstacles, sides)


# --- settings ---------------------------------------------------------------------------------------------------------


def test_a_slice_of_eight_particles_stands_for_the_whole_depth():
    shallow, deep = planned(outline__depth=0.5), planned(outline__depth=5)
    assert shallow.outline.measure.turn == pytest.approx(THICKNESS * DIAMETER)
    assert shallow.dem.particles == deep.dem.particles
    assert deck_of(shallow) == deck_of(deep)


def test_twice_the_thickness_holds_twice_the_particles_and_moves_alike():
    thin, thick = planned(dem__thickness=0.032).dem, planned(dem__thickness=0.064).dem
    assert thick.particles == pytest.approx(2 * thin.particles, rel=1e-3)
    assert (thick.plate_speed, thick.time_step, thick.youngs_modulus) == (
        thin.plate_speed,
        thin.time_step,
        thin.youngs_modulus,
    )


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"dem__thickness": 0.012}, ("dem", "thickness"), "touch their own images"),
        ({"dem__facets": 24}, ("dem", "facets"), "flat"),
        ({"figures": ["animation"]}, ("figures",), "animation"),
        ({"homogenize__method": "gaussian"}, ("homogenize", "method"), "psi"),
        ({"outline__left": [[0.01, 0.2], [0.01, 0]]}, ("outline", "right"), "gap|d90"),
    ],
)
def test_what_particles_in_a_slab_cannot_have_is_refused(changes, key, words):
    with pytest.raises(CaseError, match=words) as told:
        planned(**changes)
    assert told.value.key[: len(key)] == key


def test_a_round_vessel_has_no_thickness():
    round_one: Any = {"wall": RIGHT, "symmetry": "axis"}
    with pytest.raises(CaseError, match="only a slab") as told:
        planned(outline=round_one, dem__thickness=0.03)
    assert told.value.key == ("dem", "thickness")


def test_a_study_of_a_slab_varies_the_thickness_of_its_slice_and_no_facets():
    study = make_study(slab(), hours=100, cores=1)
    axes = {one.axis for one in study.variants}
    assert {"", "thickness", "coarse_grain_factor", "plate_speed", "youngs_modulus", "seed"} <= axes
    assert "facets" not in axes
    slices = [one.variant.changes["dem.thickness"] for one in study.variants if one.axis == "thickness"]
    assert [float(one) for one in slices] == pytest.approx([4 * DIAMETER, 12 * DIAMETER])
    grids = [make_plan(varied(study.case, one.variant.changes)).grid for one in study.variants]
    assert {grid.shape for grid in grids} == {grids[0].shape}  # compared cell by cell


def test_a_thin_slice_and_a_shallow_vessel_are_marked():
    assert planned().breaches == ()
    assert any("the thickness may show" in one for one in planned(dem__thickness=0.02).breaches)
    assert any("front and back walls" in one for one in planned(outline__depth=0.02, flow_rate="1 l/h").breaches)


def test_the_stress_in_a_deep_slot_is_janssens():
    """σ = ρ g w / (2 μ K) far down a slot of width w between two rough walls, K = 0.4."""
    bed = bed_stress([(0.2, 10.0), (0.2, 0.0)], 1500, 0.5, Measure(0.1, axial=False))
    assert bed.peak == pytest.approx(1500 * 9.81 * 0.2 / (2 * 0.5 * 0.4), rel=1e-4)
    assert bed.volume.sum() == pytest.approx(0.2 * 10 * 0.1)


def test_free_discharge_of_a_slot_is_the_slot_form_of_beverloo():
    """1.03 √g L (w − 1.4 d)^1.5 over the area of the slot, whatever the depth."""
    plan = planned(dem__outlet="open")
    (flow,) = [one for one in plan.decisions if one.name == "flow"]
    expected = 1.03 * np.sqrt(9.81) * plan.outline.measure.turn * (0.04 - 1.4 * DIAMETER) ** 1.5
    assert float(flow.value.split()[0]) == pytest.approx(expected, rel=5e-3)


# --- walls and insertion ----------------------------------------------------------------------------------------------


def area(corners: Array) -> float:
    return float(
        0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    )


def test_walls_reach_exactly_from_face_to_face(tmp_path: Path):
    outline = Outline.from_case(slab()).of_depth(0.03)
    walls = build_walls(outline, top=0.25, bottom=-0.1, plate_z=-0.02, particle_diameter=DIAMETER, folder=tmp_path)
    assert walls.sides == ((-0.05, 0.03), (0.0, 0.03))
    assert walls.box[1] == pytest.approx([0.0, 0.03])
    assert walls.plate_area == pytest.approx(0.04 * 0.03)
    assert {path.name for path in tmp_path.iterdir()} == {"vessel.stl", "plate.stl"}
    numbers = [line.split()[1:] for line in (tmp_path / "vessel.stl").read_text().splitlines() if "vertex" in line]
    corners = np.array(numbers, dtype=float).reshape(-1, 3, 3)
    length = sum(np.hypot(*np.diff(np.array(wall), axis=0).T).sum() for wall in (LEFT, RIGHT)) + 2 * (0.05 + 0.1)
    assert area(corners) == pytest.approx(0.03 * length)


@pytest.mark.parametrize(
    ("name", "length"),
    [
        ("bar", 0.02 + 2 * np.hypot(0.01, 0.01)),
        ("lip on the left wall", np.hypot(0.01, 0.015) + np.hypot(0.01, 0.005)),
        ("lip on the right wall", 2 * np.hypot(0.015, 0.01)),
    ],
)
def test_obstacles_are_walls_but_where_they_lie_on_one(name, length, tmp_path: Path):
    outline = Outline.from_case(slab(outline__obstacles={"it": OBSTACLES[name]})).of_depth(0.03)
    walls = build_walls(outline, top=0.25, bottom=-0.1, plate_z=None, particle_diameter=DIAMETER, folder=tmp_path)
    numbers = [line.split()[1:] for line in walls.files["obstacle_it"].read_text().splitlines() if "vertex" in line]
    assert area(np.array(numbers, dtype=float).reshape(-1, 3, 3)) == pytest.approx(0.03 * length)


def test_no_triangle_of_a_thin_slice_is_many_times_as_long_as_its_period() -> None:
    """LIGGGHTS stops at the first insertion where one is nine times as long; here the wall is fifty times."""
    corners = extruded([np.array([[0.0, 1.5], [0.0, 0.0]])], 0.03, "vessel")
    assert np.ptp(corners[..., 2], axis=1).max() <= 0.121
    assert len(corners) == 2 * 13


def test_short_edges_make_more_strips_and_no_thin_triangle():
    line = np.array([[0.0, 1.0], [0.0, 0.5], [0.0005, 0.4995], [0.1, 0.3]])
    corners = extruded([line], 0.2, "vessel")
    assert triangle_angles(corners).min() > SMALLEST_ANGLE
    assert area(corners) == pytest.approx(0.2 * np.hypot(*np.diff(line, axis=0).T).sum())
    with pytest.raises(MeshError, match="leave it out"):
        extruded([np.array([[0.0, 1.0], [0.0, 0.5], [1e-6, 0.499999], [0.1, 0.3]])], 0.2, "vessel")


def points_in(outline: Outline, margin: float, random: np.random.Generator) -> Array:
    frusta = insertion_frusta(outline, 0.22, -0.02, margin, np.radians(60), 0.0)
    made = []
    for f in frusta:
        part, across = random.uniform(size=(2, 400))
        left = f.inner_low + part * (f.inner_high - f.inner_low)
        right = f.outer_low + part * (f.outer_high - f.outer_low)
        made.append(np.stack([left + across * (right - left), f.z_low + part * f.height], axis=1))
    return np.concatenate(made)


def test_particles_are_inserted_clear_of_both_walls_and_fill_most_of_the_vessel():
    import shapely

    outline, margin = Outline.from_case(slab()), 0.003
    points = points_in(outline, margin, np.random.default_rng(1))
    ends = [[x, z] for (x, _), z in ((LEFT[0], 0.3), (RIGHT[0], 0.3))]
    vessel = shapely.Polygon([ends[0], *LEFT, [-0.02, -0.1], [0.02, -0.1], *RIGHT[::-1], ends[1]])
    assert shapely.distance(vessel.exterior, shapely.points(points)).min() > margin * (1 - 1e-9)
    assert shapely.contains_xy(vessel, *points.T).all()
    frusta = insertion_frusta(outline, 0.2, 0.0, 0.0, np.radians(60), 0.0)
    volume = sum(f.volume for f in frusta)
    assert 0.75 * outline.volume() < volume <= outline.volume() * (1 + 1e-9)


@pytest.mark.parametrize("name", OBSTACLES)
def test_a_mirrored_vessel_is_filled_as_its_mirror_image(name):
    outline = Outline.from_case(slab(outline__obstacles={"it": OBSTACLES[name]}))

    def filled(vessel: Outline, turn: int) -> set[tuple[float, ...]]:
        frusta = insertion_frusta(vessel, 0.22, -0.02, 0.003, np.radians(60), 0.001)
        ends = [
            [(turn * f.inner_low, turn * f.inner_high), (turn * f.outer_low, turn * f.outer_high)][::turn]
            for f in frusta
        ]
        return {(f.z_low, f.z_high, *low, *high) for f, (low, high) in zip(frusta, ends, strict=True)}

    one, other = (np.array(sorted(filled(*args))) for args in ((outline, 1), (outline.mirrored(), -1)))
    np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("name", OBSTACLES)
def test_a_particle_is_never_inserted_near_an_obstacle(name):
    import shapely

    outline, margin = Outline.from_case(slab(outline__obstacles={"it": OBSTACLES[name]})), 0.003
    points = points_in(outline, margin, np.random.default_rng(2))
    assert shapely.distance(shapely.Polygon(OBSTACLES[name]), shapely.points(points)).min() > margin * (1 - 1e-9)


def test_the_box_is_periodic_in_y_alone_and_regions_have_the_slabs_volume():
    plan = planned()
    deck = deck_of(plan)
    text = render(deck, "fill.in")
    assert "boundary        f p f" in text
    assert deck.box[2:4] == (0.0, plan.outline.measure.turn)
    assert "cylinder" not in text
    assert "cone" not in text
    assert any(piece.outer.startswith("prism") and piece.inner.startswith("prism") for piece in deck.slabs)
    assert deck.feed.outer.startswith("block")
    assert deck.feed.inner == ""


def test_a_particle_behind_the_left_wall_is_outside():
    plan = planned()
    limits = flow_limits(plan.outline, plan.dem, 0.5, None)
    x, z = np.array([-0.049, -0.051, -0.03, 0.029, 0.031, 0.0]), np.array([0.15, 0.15, 0.01, 0.15, 0.15, 0.01])
    centres = np.column_stack([x, np.zeros(6), z])
    assert limits.inside(centres).tolist() == [True, False, False, True, False, True]


def test_the_discharge_of_a_slice_becomes_that_of_the_depth():
    made = Discharge(0.2, 0.01, None).times(1 / Measure(0.04, axial=False).share(1.0))
    assert (made.kg_per_s, made.standard_error, made.counted_kg_per_s) == (
        pytest.approx(5.0),
        pytest.approx(0.25),
        None,
    )
    assert Measure().share(None) == 1.0


# --- sums -------------------------------------------------------------------------------------------------------------

NAMES = ("id", "x", "y", "z", "vx", "vy", "vz", "radius")


def snapshot(step: int, place: Array) -> Snapshot:
    count = len(place)
    still = np.zeros((count, 3))
    values = np.column_stack([np.arange(count), place, still, np.full(count, 0.5 * DIAMETER)])
    return Snapshot(step, np.array([[-1.0, 1.0], [0.0, 0.03], [-1.0, 1.0]]), NAMES, values)


def test_a_particle_that_leaves_through_one_face_and_comes_in_at_the_other_has_not_moved_far():
    grid = Box.within((-0.05, 0.05), (0, 0.5), (0, 0.1), 0.002, flat=True, cut=True).of_slice(
        Measure(0.03, axial=False)
    )
    inside, across = np.array([[0.0, 0.010, 0.05]]), np.array([[0.0, 0.0295, 0.05]])
    way = np.array([0.0003, 0.001, -0.001])
    sums = []
    for start in (inside, across):
        collector = Collector(grid, "displacement")
        collector.add(0.0, snapshot(0, start))
        collector.add(0.1, snapshot(1, (start + way) % [np.inf, 0.03, np.inf]))
        sums.append(collector.take())
    assert sums[1].kinetic == pytest.approx(sums[0].kinetic)
    assert sums[1].flow_z == pytest.approx(sums[0].flow_z)
    assert sums[0].volume.sum() / sums[0].weight == pytest.approx(np.pi / 6 * DIAMETER**3)


def test_the_packing_of_a_plug_leaves_out_the_layers_at_both_walls():
    grid = Box.within((0.0, 0.04), (0, 0.03), (0, 0.02), 0.001, flat=True, cut=False)
    x = grid.r_centres
    packing = np.where((x < DIAMETER) | (x > 0.04 - DIAMETER), 0.4, 0.6) * np.ones((20, 1))
    collector = Collector(grid, "displacement")
    collector.add(0.0, snapshot(0, np.array([[0.02, 0.01, 0.01]])))
    collector.add(0.1, snapshot(1, np.array([[0.02, 0.01, 0.009]])))
    sums = collector.take()
    sums = replace(sums, volume=sums.weight * packing * grid.cell_volume, flow_z=-sums.weight * np.ones((21, 40)))
    assert measure_plug(sums, np.ones((20, 40)), (0, 0.02), DIAMETER).packing == pytest.approx(0.6)
