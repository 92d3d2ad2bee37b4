"""Outlets of a vessel in space at several heights and in side walls: spouts, ways, arches, and the conserving field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fakes.space_walls import Triangles, blocks, circle, two_levels, two_taps, write_stl

from granpipe.case.reader import load_case
from granpipe.case.vessel import OutletSpec
from granpipe.dem.health import ArchError, FlowHealth
from granpipe.dem.snapshot import Snapshot
from granpipe.drawings.surface import read_triangles
from granpipe.errors import CaseError, DataError, RunError
from granpipe.field import Box, level_flow
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.space_walls import build_space_walls
from granpipe.geometry.spout import Spout
from granpipe.geometry.wall_mesh import WallMesh, WallOpening
from granpipe.homogenize.average import Sums
from granpipe.homogenize.conserve import Plug
from granpipe.homogenize.space_field import space_field
from granpipe.homogenize.space_outlets import OutletCells, face_areas, left_above, within_vessel
from granpipe.pipeline.dem_stages import insertion_boxes
from granpipe.pipeline.health_limits import space_limits
from granpipe.pipeline.plan_picture import draw_plan, planned_in_space
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.gmsh_session import gmsh_session

LEVELS = {"low": OutletSpec(at=(24, 24, 0), share=0.6), "high": OutletSpec(at=(72, 24, 32), share=0.4)}
TAPS = {"low": OutletSpec(at=(0, 24, 16), share=0.6), "high": OutletSpec(at=(64, 24, 48), share=0.4)}


def vessel(triangles: Triangles, outlets: dict[str, OutletSpec]) -> SpaceVessel:
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    return SpaceVessel.of(1e-3 * triangles.reshape(-1, 3), corners, outlets, 1e-3)


def planned(folder: Path, triangles: Triangles, outlets: dict[str, OutletSpec]) -> Plan:
    write_stl(folder / "walls.stl", triangles)
    named = ", ".join(f"{name}: {{at: {list(one.at)}, share: {one.share}}}" for name, one in outlets.items())
    (folder / "case.yaml").write_text(
        f"name: case\nvessel: {{file: walls.stl, unit: mm, outlets: {{{named}}}}}\n"
        "material: {density: 2500, size: {diameter: 6 mm}}\ncontact: {friction: 0.5}\nflow_rate: 50 kg/h\nmodel: dem\n"
    )
    return make_plan(load_case(folder / "case.yaml"))


@pytest.fixture(scope="module")
def taps(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return planned(tmp_path_factory.mktemp("taps"), two_taps(), TAPS)


@pytest.fixture(scope="module")
def levels(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return planned(tmp_path_factory.mktemp("levels"), two_levels(), LEVELS)


def test_an_outlet_in_a_step_has_its_plate_as_much_higher_as_the_step(levels: Plan, tmp_path: Path) -> None:
    made, settings = levels.space, levels.dem
    assert made is not None
    assert made.rises == pytest.approx((0.0, 0.032))
    low, high = settings.plate_levels(1000)
    sunk = settings.plate_speed * settings.paced(1000)
    assert (low, high) == pytest.approx((settings.plate_z - 1.2 * sunk, settings.plate_z + 0.032 - 0.8 * sunk))
    walls = build_space_walls(made, top=0.1, bottom=-0.1, plate_z=-0.02, particle_diameter=6e-3, folder=tmp_path)
    for name, level in (("plate_low", -0.020), ("plate_high", 0.012)):
        points, _ = read_triangles(walls.files[name])
        assert points[:, 2] == pytest.approx(level)
    assert walls.box[2] == pytest.approx([-0.1, 0.1])


def test_a_side_outlet_leads_below_a_hood_as_deep_as_it_is_high() -> None:
    made = vessel(two_taps(), TAPS)
    low, high = made.outlets
    np.testing.assert_allclose(low.opening.normal, [-1, 0, 0])
    np.testing.assert_allclose(high.opening.normal, [1, 0, 0])
    assert [one.opening.area for one in made.outlets] == pytest.approx([32e-3**2] * 2)
    assert [one.spout.area for one in made.outlets] == pytest.approx([32e-3**2] * 2)
    assert made.rises == pytest.approx((0.0, 0.032))
    places = {  # mm, beyond the higher one: its sill, the hood, the tube
        (66, 24, 48): True, (66, 24, 30): False, (66, 24, 66): False, (66, 6, 48): False,
        (90, 24, 62): True, (90, 24, 66): False, (90, 24, -50): True, (105, 24, 48): False, (60, 24, 48): False,
    }  # fmt: skip
    found = high.spout.within(1e-3 * np.array(list(places), dtype=float))
    assert found.tolist() == list(places.values())


def test_walls_with_hoods_and_tubes_are_closed_but_for_the_ends() -> None:
    """The volume that rays see in them is that of the vessel, sills, hoods and tubes."""
    made = vessel(two_taps(), TAPS)
    surface = made.surface(0.120, -0.040)
    walls = WallMesh.of(surface.reshape(-1, 3), np.arange(3 * len(surface)).reshape(-1, 3))
    assert len(walls.outlets) == 2
    assert all(one.z == pytest.approx(-0.040) and one.normal[2] == -1 for one in walls.outlets)
    grid = Box.within(*((float(a), float(b)) for a, b in walls.ends), 2e-3, flat=False, cut=True)
    volume = float((walls.inside_fraction(grid) @ grid.ring_area).sum() * (grid.z_edges[1] - grid.z_edges[0]))
    body, sills = 0.064 * 0.048 * 0.120, 2 * 0.032**2 * 0.008
    hoods = 0.032**2 * ((0.032 + 0.040) + (0.064 + 0.040))
    assert volume == pytest.approx(body + sills + hoods, rel=5e-3)
    points = np.random.default_rng(1).uniform((-0.06, -0.01, -0.03), (0.12, 0.06, 0.11), (20000, 3))
    np.testing.assert_array_equal(walls.contains(points), made.contains(points))


def test_a_round_opening_in_a_sloping_wall_leads_straight_down_or_below_a_hood() -> None:
    ring = circle(20, 0, 32)
    steep = np.column_stack([0.5 * ring[:, 0], ring[:, 1], 60 + np.sqrt(0.75) * ring[:, 0]])  # 60° from the horizontal
    normal = np.array([np.sqrt(0.75), 0, -0.5])
    with pytest.raises(DataError, match="faces upwards"):
        Spout.of(WallOpening(1e-3 * steep, -normal))
    spout = Spout.of(WallOpening(1e-3 * steep, normal))
    assert spout.fall == pytest.approx(1e-3 * np.sqrt(0.75) * np.ptp(ring[:, 0]))
    assert spout.within(spout.ring.mean(axis=0)[None] - [0, 0, 0.5]).all()
    flat = np.column_stack([np.sqrt(0.75) * ring[:, 0], ring[:, 1], 60 + 0.5 * ring[:, 0]])
    spout = Spout.of(WallOpening(1e-3 * flat, np.array([0.5, 0, -np.sqrt(0.75)])))
    assert spout.fall == 0
    assert spout.area == pytest.approx(np.sqrt(0.75) * np.pi * 0.020**2, rel=1e-3)


def test_a_tube_that_would_meet_the_walls_is_refused() -> None:
    """An outlet in the roof of a wider lower part, and one below another."""
    solid = np.ones((8, 6, 12), bool)
    solid[:4, :, 4:] = False  # the lower part reaches farther to the left than the upper one

    def opened(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / 8
        return (axis == 2 and z > 11.9) or (axis == 0 and abs(x - 4) < 0.1 and 4 < z < 8 and 1 < y < 5)

    with pytest.raises(CaseError, match="would meet the walls"):
        vessel(blocks(solid, 8, opened), {"tap": OutletSpec(at=(32, 24, 48), share=1)})

    def above(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / 8
        return (axis == 2 and z > 11.9) or (axis == 0 and x > 7.9 and (0 < z < 4 or 6 < z < 10) and 1 < y < 5)

    outlets = {"a": OutletSpec(at=(64, 24, 16), share=0.5), "b": OutletSpec(at=(64, 24, 64), share=0.5)}
    with pytest.raises(CaseError, match="would meet"):
        vessel(blocks(np.ones((8, 6, 12), bool), 8, above), outlets)


def test_an_opening_that_is_not_flat_is_refused() -> None:
    """A window round the corner of a bin."""

    def opened(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / 8
        corner = (axis == 0 and x > 5.9 and y > 4) or (axis == 1 and y > 5.9 and x > 4)
        return (axis == 2 and z > 5.9) or (corner and 1 < z < 4)

    with pytest.raises(CaseError, match="is not flat"):
        vessel(blocks(np.ones((6, 6, 6), bool), 8, opened), {})


def test_ways_lead_to_side_outlets_and_nothing_is_put_in_below_plates(taps: Plan, levels: Plan) -> None:
    """Below a hood nothing is put in: its tube fills by itself."""
    assert taps.space is not None
    assert levels.space is not None
    assert all(one.gap == pytest.approx(0.032, rel=0.02) for one in taps.space.outlets)
    settings = levels.dem
    boxes = insertion_boxes(levels.space, settings, settings.plate_z + 4e-3, 4e-3, settings.feed_top)
    filled = np.array([block for one in boxes for block in one.blocks])
    left, right = filled[filled[:, 1] < 0.048], filled[filled[:, 0] > 0.048]
    assert settings.plate_z + 4e-3 <= left[:, 4].min() < 0
    assert settings.plate_z + 0.032 + 4e-3 <= right[:, 4].min() < 0.032


def snapshot(step: int, position: np.ndarray) -> Snapshot:
    count, columns = len(position), ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")
    values = np.column_stack([np.arange(count), np.ones(count), position, np.zeros((count, 3)), np.full(count, 3e-3)])
    return Snapshot(step, np.array([[-1.0, 1.0]] * 3), columns, values)


def test_a_particle_below_the_plate_of_a_higher_outlet_has_got_through_it(taps: Plan) -> None:
    assert taps.space is not None
    health = FlowHealth(taps.dem, taps.case, space_limits(taps.space, taps.dem, 0.5), 1)
    level = taps.dem.plate_z + 0.032
    health.snapshot(snapshot(0, np.array([[0.09, 0.024, level + 1e-3]])))
    with pytest.raises(RunError, match="1 particle outside the walls"):
        health.snapshot(snapshot(1, np.array([[0.09, 0.024, level - 1e-3]])))


def leaving(plan: Plan, through: tuple[float, float]) -> None:
    """Rows of particles move sidewise below both hoods, not to their ends, each at its part of the mean speed there."""
    assert plan.space is not None
    health = FlowHealth(plan.dem, plan.case, space_limits(plan.space, plan.dem, 0.5), 1)
    along, y, z = np.meshgrid(np.arange(-90, 0, 2) / 1e3, np.linspace(0.010, 0.038, 5), np.arange(3, 31, 5) / 1e3)
    rows = np.column_stack([along.ravel(), y.ravel(), z.ravel()])
    for number in range(70):
        travel = plan.dem.plate_speed * plan.dem.time_step * number * plan.dem.dump_every
        low = rows * np.array([-1, 1, 1]) - np.array([travel * through[0], 0, 0])
        high = rows + np.array([0.064 + travel * through[1], 0, 0.032])
        health.passing.add(snapshot(number * plan.dem.dump_every, np.concatenate([low, high])))


def test_an_arch_in_one_of_two_side_outlets_is_seen(taps: Plan) -> None:
    leaving(taps, (1.2, 0.8))
    with pytest.raises(ArchError, match="outlet high"):
        leaving(taps, (1.2, 0.0))


def noisy(grid: Box, mean: tuple[float, float, float], noise: float, count: int = 10) -> list[Sums]:
    random, areas, segments = np.random.default_rng(2), face_areas(grid), []
    for number in range(count):
        x, y, z = (
            area * (v + random.normal(0.0, noise, [n + (axis == k) for axis, n in enumerate(grid.shape)]))
            for v, area, k in zip(mean, areas, (2, 1, 0), strict=True)
        )
        empty = {name: np.zeros(1) for name in ("time", "solids", "kinetic", "count")}
        empty |= {"level_flow": np.zeros((1, grid.shape[0] + 1)), "flow_y": y}
        volume = np.full(grid.shape, 0.58 * grid.cell_volume[0])
        times = float(number), number + 1.0, 1.0, 1.0
        segments.append(Sums(grid, "displacement", *times, volume, x, z, np.zeros(grid.shape), **empty))
    return segments


@pytest.mark.parametrize(("triangles", "outlets"), [(two_taps(), TAPS), (two_levels(), LEVELS)], ids=["taps", "levels"])
def test_all_solids_pass_each_level_or_have_left_above_it(triangles: Triangles, outlets: dict[str, OutletSpec]) -> None:
    """Of noise round a plug flow, which no wall allows: what is exact is made so by conserving."""
    made = vessel(triangles, outlets)
    x, y, z = ((float(low), float(high)) for low, high in made.walls.ends)
    grid = Box.within(x, y, z, 3e-3, flat=False, cut=True)
    inside, cells = made.inside_fraction(grid), OutletCells(made.beyond(grid), (0.6, 0.4))
    segments = within_vessel(noisy(grid, (0.0, 0.0, -1.0), 0.2), inside, cells)
    plug = Plug(0.58, 4e-3, 0.0, (0.0, 0.01))
    fitted = space_field(segments, inside, plug, 6e-3, outlets=cells)
    field = fitted.field
    assert field.flux_y is not None
    fluxes = field.flux_r, field.flux_y, field.flux_z
    flow = tuple(area * flux for area, flux in zip(face_areas(grid), fluxes, strict=True))
    faces = cells.faces(field.bulk)
    total = level_flow(field.flux_z, grid) + left_above(faces, flow)  # type: ignore[arg-type]
    np.testing.assert_allclose(total, 4e-3, rtol=1e-10)
    assert [one.out(flow) for one in faces] == pytest.approx([2.4e-3, 1.6e-3], rel=1e-10)  # type: ignore[arg-type]
    out = sum(np.diff(one, axis=axis) for one, axis in zip(flow, (2, 1, 0), strict=True))
    assert np.abs(out[field.bulk]).max() <= 1e-12 * 4e-3
    open_faces = [sum(one.masks[k].astype(int) for one in faces) > 0 for k in range(3)]
    for k, axis in enumerate((2, 1, 0)):  # nothing passes a wall
        padded = np.pad(field.bulk, [(1, 1) if one == axis else (0, 0) for one in range(3)])
        wall = np.delete(padded, -1, axis) != np.delete(padded, 0, axis)
        if axis == 0:
            wall[-1] = False  # the inlet
        assert not flow[k][wall & ~open_faces[k]].any()
    below = grid.z_edges < (30e-3 if outlets is LEVELS else 1e-3)  # the step; the floor, which is closed
    left = 2.4e-3 if outlets is LEVELS else 0.0
    np.testing.assert_allclose(level_flow(field.flux_z, grid)[below], left, rtol=1e-10, atol=1e-13)


def test_what_lies_in_a_tube_beside_the_vessel_is_left_out(levels: Plan) -> None:
    """The tube of the outlet in the step stands in the box round the vessel."""
    made, grid = levels.space, levels.grid
    assert made is not None
    assert isinstance(grid, Box)
    inside, cells = made.inside_fraction(grid), OutletCells(made.beyond(grid), (0.6, 0.4))
    (whole,) = noisy(grid, (0.0, 0.0, -1.0), 0.0, 1)
    (cut,) = within_vessel([whole], inside, cells)
    at = np.array([[0.072, 0.024, 0.01]])
    place = tuple(int(np.searchsorted(line, one)) - 1 for line, one in zip(grid.lines, at[0, ::-1], strict=True))
    assert whole.volume[place] > 0
    assert cut.volume[place] == 0
    assert cut.volume.sum() == pytest.approx(0.58 * (inside > 0).sum() * grid.cell_volume[0])


def test_a_body_is_opened_where_outlets_are_and_stays_closed_at_the_bottom(tmp_path: Path) -> None:
    with gmsh_session("draw a bin") as gmsh:
        bin_, pipe = gmsh.model.occ.addBox(0, 0, 0, 60, 60, 90), gmsh.model.occ.addBox(60, 10, 10, 10, 40, 40)
        gmsh.model.occ.fuse([(3, bin_)], [(3, pipe)])
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "walls.brep"))
    text = (
        "name: case\nvessel: {file: walls.brep, unit: mm, outlets: {tap: {at: [70, 30, 30], share: 1}}}\n"
        "material: {density: 2500, size: {diameter: 6 mm}}\ncontact: {friction: 0.5}\nflow_rate: 50 kg/h\nmodel: dem\n"
    )
    (tmp_path / "case.yaml").write_text(text)
    made = make_plan(load_case(tmp_path / "case.yaml")).space
    assert made is not None
    (tap,) = made.outlets
    assert tap.opening.area == pytest.approx(0.04**2)
    assert tap.spout.fall == pytest.approx(0.04)
    (tmp_path / "case.yaml").write_text(text.replace("[70, 30, 30]", "[70, 30, 70]"))
    with pytest.raises(CaseError, match=r"no flat face of its body holds the point \(70, 30, 70\)"):
        make_plan(load_case(tmp_path / "case.yaml"))


def test_a_roof_with_a_hole_is_no_outlet() -> None:
    """A level opening below the top that faces upwards."""
    solid = np.ones((12, 6, 10), bool)
    solid[6:, :, 6:] = False

    def opened(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / 8
        roof = abs(z - 6) < 0.1 and 7 < x < 11
        return axis == 2 and (z > 9.9 or ((roof or (z < 0.1 and 1 < x < 5)) and 1 < y < 5))

    outlets = {"a": OutletSpec(at=(24, 24, 0), share=0.5), "b": OutletSpec(at=(72, 24, 48), share=0.5)}
    with pytest.raises(CaseError, match="faces upwards"):
        vessel(blocks(solid, 8, opened), outlets)


def test_the_picture_of_a_plan_shows_each_outlet_its_tube_and_its_plate(taps: Plan, tmp_path: Path) -> None:
    assert taps.space is not None
    shown = planned_in_space(taps, taps.space)
    assert [(one.name, one.share) for one in shown.outlets] == [("low", 0.6), ("high", 0.4)]
    low, high = shown.outlets
    for one in shown.outlets:
        assert one.tube[:, 2].min() == pytest.approx(one.opening[:, 2].min())
        start, end = one.plate
        assert end < start < one.opening[:, 2].min()
    assert (low.plate[0] - low.plate[1]) / (high.plate[0] - high.plate[1]) == pytest.approx(1.5)
    assert shown.simulated[..., 2].max() > shown.inlet[:, 2].max() > shown.walls[..., 2].min()
    assert draw_plan(taps, tmp_path / "plan.png") == f"picture   {tmp_path / 'plan.png'}"
    assert (tmp_path / "plan.png").stat().st_size > 10_000
