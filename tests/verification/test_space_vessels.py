"""Fields in space that conserve, in the walls of a case: against flows and solutions that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fakes.analytic_flow import ConvergingFlow, binary_snapshot, snapshots, table
from fakes.drawings import revolved_stl
from matplotlib.image import imread
from scipy.stats import qmc

from granpipe.case.outline import OutlineSpec, Section
from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Box, Field, level_flow
from granpipe.geometry.in_space import inside_space
from granpipe.geometry.outline import Outline
from granpipe.homogenize.space_field import Faces, Projection
from granpipe.pipeline.dump_average import Homogenized
from granpipe.pipeline.dump_files import write_homogenized
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.dumps import Walls, homogenize_files

FLOW = ConvergingFlow(solids_flow=0.01, packing=0.58, peak=0.5)
RADIUS, CELL = 0.02, 0.06
SHARE = 0.94
"""Of the radius of the known flow: what moves farther out is left out, so that spheres touch a wall from inside."""

SOLIDS_FLOW = -2 * np.pi * float(FLOW.psi(np.array(SHARE * FLOW.upper_radius), np.array(FLOW.height)))


@pytest.fixture(scope="module")
def dumps(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """Twenty snapshots, 0.8 s and 1000 steps apart, of a known converging flow."""
    folder, box = tmp_path_factory.mktemp("dumps"), np.array([[-0.6, 0.6], [-0.6, 0.6], [-1.0, 10.0]])
    paths = []
    for index, (number, position, velocity, radius) in enumerate(snapshots(FLOW, np.full(1, RADIUS), 0.8, 20, 1)):
        inner = np.hypot(position[:, 0], position[:, 1]) < SHARE * FLOW.wall(position[:, 2])[0]
        paths.append(folder / f"{1000 * index}.bin")
        values = table(number[inner], position[inner], velocity[inner], radius[inner])
        paths[-1].write_bytes(binary_snapshot(1000 * index, box, values))
    return tuple(paths)


def vessel(**homogenize: object) -> Case:
    """The case of the known flow: its wall as a polygon, its flow rate as bulk."""
    reactor = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml", {"flow_rate": "1 m^3/h"})
    z = np.linspace(FLOW.height, 0, 60)
    wall = tuple(zip((SHARE * FLOW.wall(z)[0] + RADIUS).tolist(), z.tolist(), strict=True))
    outline = OutlineSpec(wall=wall, sections={"wide": Section(z=(FLOW.height, 0.5)), "narrow": Section(z=(0.5, 0.0))})
    dem = reactor.dem.model_copy(update={"statistical_error": None})
    more = reactor.homogenize.model_copy(update=homogenize)
    return reactor.model_copy(update={"outline": outline, "dem": dem, "homogenize": more})


def averaged(dumps: tuple[Path, ...], frame: Frame, **homogenize: object) -> Homogenized:
    return homogenize_files(Request(dumps=dumps, frame=frame, time_step=8e-4), vessel(**homogenize))


@pytest.fixture(scope="module")
def made(dumps: tuple[Path, ...]) -> Homogenized:
    return averaged(dumps, Frame("xyz", CELL))


def out_of_cells(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(nz, ny, nx) what flows out of each cell."""
    return np.diff(x, axis=2) + np.diff(y, axis=1) + np.diff(z, axis=0)


def balance(field: Field) -> np.ndarray:
    grid = field.grid
    assert isinstance(grid, Box)
    assert field.flux_y is not None
    area = grid.side_area[0], grid.front_area, grid.ring_area[0]
    return out_of_cells(field.flux_r * area[0], field.flux_y * area[1], field.flux_z * area[2])


def test_every_cell_and_every_level_conserves(made: Homogenized) -> None:
    field = made.field
    flow = level_flow(field.flux_z, field.grid)
    assert flow == pytest.approx(flow[0], rel=1e-10)
    assert np.abs(balance(field)).max() < 1e-12 * flow[0]
    assert flow[0] == pytest.approx(SOLIDS_FLOW, rel=0.02)
    assert flow[0] * field.velocity_scale == pytest.approx(1 / 3600, rel=1e-9)


def test_nothing_flows_through_walls_and_sides(made: Homogenized) -> None:
    field, void = made.field, ~made.field.bulk
    assert field.flux_y is not None
    for flux in (field.flux_r[..., :-1], field.flux_r[..., 1:], field.flux_y[:, :-1], field.flux_y[:, 1:]):
        assert not flux[void].any()
    assert not field.flux_z[:-1][void].any()
    assert not field.flux_z[1:][void].any()
    assert not field.flux_r[..., [0, -1]].any()


def test_the_field_is_the_known_flow_within_its_errors(made: Homogenized) -> None:
    """Away from walls; the claimed standard errors are those that the differences from the truth show."""
    field, grid = made.field, made.field.grid
    assert isinstance(grid, Box)
    assert field.flux_z_se is not None
    z, y, x = np.meshgrid(
        grid.z_edges[3:-3], 0.5 * (grid.y_edges[1:] + grid.y_edges[:-1]), grid.r_centres, indexing="ij"
    )
    r = np.hypot(x, y)
    exact = FLOW.packing * FLOW.particle_velocity(r, z)[1]
    inner = r < SHARE * FLOW.wall(z)[0] - 2 * CELL
    error = (field.flux_z[3:-3] - exact)[inner]
    assert np.sqrt(np.mean(error**2)) < 0.12 * np.abs(exact[inner]).mean()
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(np.mean(field.flux_z_se[3:-3][inner] ** 2)), rel=0.5)
    assert 0 < made.figures["statistical_error"]["wide"] < 0.2


def test_in_space_and_on_rings_the_same_dumps_carry_the_same_flow_between_radii(
    made: Homogenized, dumps: tuple[Path, ...]
) -> None:
    """Solids that pass within half the wall's radius at each level: 8 % of the whole flow is the noise of both."""
    rings = averaged(dumps, Frame("rz", 0.02)).field
    grid = made.field.grid
    assert isinstance(grid, Box)
    x, y = np.meshgrid(grid.r_centres, 0.5 * (grid.y_edges[1:] + grid.y_edges[:-1]))
    for level in np.linspace(0.1, 0.9, 5):
        half = 0.6 * float(FLOW.wall(np.array(level))[0])
        here = made.field.flux_z[int(np.abs(grid.z_edges - level).argmin())]
        points = np.linspace(-0.5, 0.5, 21)[1::2] * CELL
        part = np.mean([[np.hypot(x + a, y + b) < half for a in points] for b in points], axis=(0, 1))
        in_space = -(here * part).sum() * grid.ring_area[0]
        own = rings.flux_z[int(np.abs(rings.grid.z_edges - level).argmin())] * rings.grid.ring_area
        on_rings = -np.interp(half, rings.grid.r_edges, np.concatenate([[0.0], np.cumsum(own)]))
        assert in_space == pytest.approx(on_rings, abs=0.08 * SOLIDS_FLOW)


def test_files_hold_the_field_in_space(made: Homogenized, tmp_path: Path) -> None:
    write_homogenized(made, vessel(), tmp_path / "out")
    loaded = Field.load(tmp_path / "out" / "field.npz")
    assert np.array_equal(loaded.flux_z, made.field.flux_z)
    assert (tmp_path / "out" / "field.vtr").is_file()
    picture = imread(tmp_path / "out" / "figures" / "space_w.png")[..., :3]
    assert len(np.unique(picture.reshape(-1, 3).round(2), axis=0)) > 100
    assert "on five cuts through the vessel" in (tmp_path / "out" / "report.html").read_text()


def test_what_has_no_place_in_space_is_refused(dumps: tuple[Path, ...]) -> None:
    with pytest.raises(DataError, match=r"homogenize\.fields are told on rings only"):
        averaged(dumps, Frame("xyz", CELL), fields=("age",))
    with pytest.raises(DataError, match=r"the vessel gives the ranges: leave out --x and --z"):
        averaged(dumps, Frame("xyz", CELL, x=(0.0, 0.1), z=(0.0, 0.5)))


def test_the_part_of_each_cell_inside_adds_up_to_the_vessel() -> None:
    outline = Outline.from_case(vessel())
    grid = Box.within((-0.5, 0.5), (-0.5, 0.5), (0.0, 1.0), 0.04, flat=False, cut=True)
    volume = inside_space(outline, grid).sum() * float(np.prod(grid._steps))
    assert volume == pytest.approx(outline.volume(), rel=2e-3)


# --- walls from triangles ---------------------------------------------------------------------------------------------


def test_a_round_vessel_as_triangles_gives_the_field_that_its_case_gives(
    made: Homogenized, dumps: tuple[Path, ...], tmp_path: Path
) -> None:
    """180 facets; the outline's cells and those of the triangles differ by the chords and by the rays."""
    z = np.linspace(FLOW.height, 0, 60)
    profile = np.column_stack([SHARE * FLOW.wall(z)[0] + RADIUS, z]) * 1000
    stl = revolved_stl(tmp_path / "vessel.stl", profile, facets=180)
    request = Request(dumps=dumps, frame=Frame("xyz", CELL), time_step=8e-4)
    own = homogenize_files(request, None, Walls((stl,), 1e-3))
    assert own.field.grid.shape == made.field.grid.shape
    assert own.field.bulk_packing == pytest.approx(made.field.bulk_packing, rel=0.01)
    difference = own.field.flux_z - made.field.flux_z
    assert np.sqrt((difference**2).sum() / (made.field.flux_z**2).sum()) < 0.03
    assert np.abs(balance(own.field)).max() < 1e-12 * SOLIDS_FLOW
    assert own.figures["outlets"][0]["share"] == pytest.approx(1)


@pytest.fixture(scope="module")
def ducts(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[Path, ...], Path]:
    """Dumps of two square ducts side by side, in which solids sink at 30 and 20 mm/s, and their walls."""
    folder = tmp_path_factory.mktemp("ducts")
    box, paths = np.array([[-0.1, 0.6], [-0.1, 0.3], [-0.5, 2.0]]), []
    side, radius, rng = 0.2, 0.01, np.random.default_rng(4)
    number = int(0.58 * (side - 2 * radius) ** 2 * 2.0 / (4 / 3 * np.pi * radius**3))
    draws = qmc.Halton(3, rng=rng).random(2 * number)
    place = draws * [side - 2 * radius, side - 2 * radius, 2.0] + [radius, radius, -0.5]
    place[number:, 0] += 0.25
    speed = np.where(np.arange(2 * number) < number, 0.03, 0.02)
    velocity = np.column_stack([0 * speed, 0 * speed, -speed])
    for k in range(16):
        now = place + velocity * 0.5 * k
        values = table(np.arange(1, 2 * number + 1), now, velocity, np.full(2 * number, radius))
        inner = (now[:, 2] > -0.05) & (now[:, 2] < 0.65)
        paths.append(folder / f"{1000 * k}.bin")
        paths[-1].write_bytes(binary_snapshot(1000 * k, box, values[inner]))
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [(x0 + dx * side, dy * side, z) for x0 in (0.0, 0.25) for z in (0.0, 0.6) for dx, dy in square]
    faces = []
    for first in (0, 8):
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
            faces += [(first + a, first + b, first + 4 + b), (first + a, first + 4 + b, first + 4 + a)]
    walls = folder / "ducts.obj"
    walls.write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    return tuple(paths), walls


def test_two_outlets_share_the_flow_as_the_solids_sink(ducts: tuple[tuple[Path, ...], Path]) -> None:
    """60 : 40, from speeds of 30 and 20 mm/s in ducts of equal width; each level and each duct carries its flow."""
    paths, walls = ducts
    made = homogenize_files(Request(dumps=paths, frame=Frame("xyz", 0.025), time_step=5e-4), None, Walls((walls,), 1.0))
    left, right = sorted(made.figures["outlets"], key=lambda one: one["x_m"])
    assert left["share"] + right["share"] == pytest.approx(1, abs=1e-12)
    assert left["share"] == pytest.approx(0.6, abs=max(0.01, 3 * left["share_se"]))
    assert left["area_m2"] == pytest.approx(0.04)
    flow = -made.field.flux_z * made.field.grid.ring_area
    in_left = flow[:, :, made.field.grid.r_centres < 0.225].sum(axis=(1, 2))
    assert in_left == pytest.approx(in_left[0], rel=1e-10)
    assert any("60." in note or "59." in note for note in made.notes)


def test_walls_need_space_and_no_case(dumps: tuple[Path, ...], tmp_path: Path) -> None:
    for frame, case in ((Frame("rz", CELL), None), (Frame("xyz", CELL), vessel())):
        with pytest.raises(DataError, match="--walls are those of a vessel in space: give --plane xyz, and leave out"):
            homogenize_files(Request(dumps=dumps, frame=frame, time_step=8e-4), case, Walls((tmp_path / "a.stl",), 1.0))
    with pytest.raises(DataError, match=r"a\.stl: file not found"):
        homogenize_files(
            Request(dumps=dumps, frame=Frame("xyz", CELL), time_step=8e-4), None, Walls((tmp_path / "a.stl",), 1.0)
        )


def test_walls_in_another_unit_are_refused_with_the_question(dumps: tuple[Path, ...], tmp_path: Path) -> None:
    z = np.array([FLOW.height, 0.0])
    stl = revolved_stl(tmp_path / "vessel.stl", np.column_stack([[500.0, 500.0], 1000 * z]), facets=24)
    with pytest.raises(DataError, match=r"of memory.*the walls are 1e\+03 m high: is --unit right\?"):
        homogenize_files(Request(dumps=dumps, frame=Frame("xyz", CELL), time_step=8e-4), None, Walls((stl,), 1.0))


# --- the projection -----------------------------------------------------------------------------------------------


def faces_of(cells: np.ndarray) -> list[np.ndarray]:
    """Faces between two cells, and at the ends of z."""
    x = np.zeros((*cells.shape[:2], cells.shape[2] + 1), bool)
    y = np.zeros((cells.shape[0], cells.shape[1] + 1, cells.shape[2]), bool)
    z = np.zeros((cells.shape[0] + 1, *cells.shape[1:]), bool)
    x[..., 1:-1] = cells[..., 1:] & cells[..., :-1]
    y[:, 1:-1] = cells[:, 1:] & cells[:, :-1]
    z[1:-1] = cells[1:] & cells[:-1]
    z[0], z[-1] = cells[0], cells[-1]
    return [x, y, z]


def random_flow(cells: np.ndarray, seed: int = 0) -> tuple[list[np.ndarray], Faces, Faces]:
    """Faces, flows through them, and variances over two decades."""
    faces, rng = faces_of(cells), np.random.default_rng(seed)
    flow = tuple(np.where(face, rng.normal(size=face.shape), 0.0) for face in faces)
    variance = tuple(np.where(face, 10 ** rng.uniform(-1, 1, face.shape), 1.0) for face in faces)
    return faces, flow, variance  # type: ignore[return-value]


def test_the_projection_is_the_weighted_least_squares_solution() -> None:
    """Against the normal equations with multipliers, solved densely."""
    cells = np.random.default_rng(1).random((4, 3, 3)) < 0.8
    faces, flow, variance = random_flow(cells)
    found = Projection(cells, faces, variance).of(flow, 1.0)
    open_faces = np.concatenate([face.ravel() for face in faces])
    number = len(open_faces)
    sizes = [face.size for face in faces]
    matrix = np.empty((cells.size, number))
    for k in range(number):
        one = np.zeros(number)
        one[k] = float(open_faces[k])
        parts = [
            part.reshape(face.shape) for part, face in zip(np.split(one, np.cumsum(sizes)[:-1]), faces, strict=True)
        ]
        matrix[:, k] = out_of_cells(*parts).ravel()
    weight = np.diag(1 / np.concatenate([v.ravel() for v in variance]))
    given = np.concatenate([f.ravel() for f in flow])
    saddle = np.block([[weight, matrix.T], [matrix, np.zeros((cells.size, cells.size))]])
    exact = np.linalg.lstsq(saddle, np.concatenate([weight @ given, np.zeros(cells.size)]), rcond=None)[0][:number]
    assert np.concatenate([f.ravel() for f in found]) == pytest.approx(exact, abs=1e-8)


def test_a_flow_that_conserves_stays_as_it_is() -> None:
    cells = np.ones((5, 4, 4), bool)
    faces, _, variance = random_flow(cells)
    flow = (np.zeros(faces[0].shape), np.zeros(faces[1].shape), np.full(faces[2].shape, -1.0))
    found = Projection(cells, faces, variance).of(flow, 16.0)
    for one, other in zip(found, flow, strict=True):
        assert one == pytest.approx(other, abs=1e-12)


def test_pockets_without_a_way_out_and_single_cells_come_to_rest() -> None:
    cells = np.zeros((7, 5, 5), bool)
    cells[:, :2, :2] = True  # a channel
    cells[2:5, 3:, 3:] = True  # a closed pocket
    cells[3, 0, 4] = True  # a single cell
    faces, flow, variance = random_flow(cells)
    found = Projection(cells, faces, variance).of(flow, 1.0)
    assert np.abs(out_of_cells(*found)).max() < 1e-12
    assert np.isfinite(np.concatenate([one.ravel() for one in found])).all()
    assert np.diff(found[2].sum(axis=(1, 2))) == pytest.approx(0, abs=1e-11)
