"""Dumps of strangers: vessels that stand elsewhere, fill, recirculate or cannot be; right, marked or refused."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fakes.analytic_flow import COLUMNS, ConvergingFlow, binary_snapshot, snapshots, table, text_snapshot
from numpy.typing import NDArray

from granpipe.case.outline import OutlineSpec, Section
from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.cli import main
from granpipe.errors import DataError
from granpipe.field import level_flow
from granpipe.pipeline.dump_average import Homogenized
from granpipe.pipeline.dump_files import write_homogenized
from granpipe.pipeline.dump_window import Frame, Request, Up
from granpipe.pipeline.dumps import homogenize_files

Array = NDArray[np.float64]
Particles = tuple[Array, Array, Array, Array]

FLOW = ConvergingFlow(solids_flow=0.01, packing=0.58)
BOX = np.array([[-0.6, 0.6], [-0.6, 0.6], [-1.0, 10.0]])
AXIS_ROTATIONS: dict[Up, tuple[int, int, int, int]] = {
    # which column of (x, y, z) of the flow each coordinate of the dump is, and the sign of what points up
    "y": (0, 2, 1, 1),
    "-y": (0, 2, 1, -1),
    "x": (2, 1, 0, 1),
    "-x": (2, 1, 0, -1),
}


def flow(count: int = 8) -> list[Particles]:
    return list(snapshots(FLOW, np.full(1, 0.02), 0.2, count, 1))


def write(folder: Path, series: list[Particles], box: Array = BOX, first: int = 0) -> tuple[Path, ...]:
    """Binary dumps, 1000 steps of 0.2 ms apart."""
    paths = []
    for index, particles in enumerate(series):
        paths.append(folder / f"{first + index}.bin")
        paths[-1].write_bytes(binary_snapshot(1000 * (first + index), box, table(*particles)))
    return tuple(paths)


def averaged(dumps: tuple[Path, ...], case: Case | None = None, **frame: object) -> Homogenized:
    return homogenize_files(request(dumps, **frame), case)


def request(dumps: tuple[Path, ...], **frame: object) -> Request:
    return Request(dumps=dumps, frame=Frame(**({"plane": "rz", "cell": 0.02} | frame)), time_step=2e-4)


def vessel(scale: float = 1.0) -> Case:
    reactor = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml", {"flow_rate": "1 m^3/h"})
    z = np.linspace(FLOW.height, 0, 60)
    wall = tuple(zip((scale * FLOW.wall(z)[0]).tolist(), (scale * z).tolist(), strict=True))
    outline = OutlineSpec(wall=wall, sections={"all": Section(z=(scale * FLOW.height, 0.0))})
    material = reactor.material.model_copy(update={"bulk_density": None})
    return reactor.model_copy(update={"outline": outline, "material": material})


def turned(up: Up) -> Callable[[Array], Array]:
    """From the flow's coordinates to those of a dump whose `up` is the flow's z; mirrored is as good in a flow that is
    the same all round."""
    *columns, sign = AXIS_ROTATIONS[up]

    def turn(vectors: Array) -> Array:
        found = vectors[..., columns].copy()
        found[..., columns.index(2)] *= sign
        return found

    return turn


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Homogenized:
    """The field of the flow where it stands at the axis, with gravity along -z."""
    return averaged(write(tmp_path_factory.mktemp("straight"), flow()))


# --- the vessel stands elsewhere -------------------------------------------------------------------------------------


def test_a_vessel_beside_the_axis_is_refused_until_the_axis_is_given(tmp_path: Path, straight: Homogenized) -> None:
    place = np.array([0.7, -0.4, 0.0])
    series = [(n, x + place, v, a) for n, x, v, a in flow()]
    dumps = write(tmp_path, series, BOX + place[:, None])
    with pytest.raises(
        DataError, match=r"lie about x = 0\.\d+ m, y = -0\.\d+ m, .* give --axis 0\.(69|7)\d*,-0\.(39|4)"
    ):
        averaged(dumps)
    made = averaged(dumps, axis=(0.7, -0.4))
    assert not made.failed
    assert np.allclose(made.field.flux_z, straight.field.flux_z, atol=1e-9 * np.abs(straight.field.flux_z).max())


def test_a_vessel_slightly_beside_the_axis_is_noticed(tmp_path: Path) -> None:
    series = [(n, x + np.array([0.05, 0, 0]), v, a) for n, x, v, a in flow(3)]
    with pytest.raises(DataError, match="--axis"):
        averaged(write(tmp_path, series))


@pytest.mark.parametrize("up", AXIS_ROTATIONS)
def test_gravity_along_another_axis_is_refused_until_it_is_told(tmp_path: Path, up: Up, straight: Homogenized) -> None:
    turn = turned(up)
    series = [(n, turn(x), turn(v), a) for n, x, v, a in flow()]
    ends = turn(BOX.T).T
    dumps = write(tmp_path, series, np.sort(ends, axis=1))
    with pytest.raises(DataError, match=r"--up|--axis"):
        averaged(dumps)
    made = averaged(dumps, up=up)
    assert not made.failed
    assert made.field.bulk_packing == pytest.approx(straight.field.bulk_packing, rel=1e-9)
    assert np.allclose(made.field.flux_z, straight.field.flux_z, atol=1e-9 * np.abs(straight.field.flux_z).max())


def test_the_direction_of_gravity_is_named_where_the_bed_lies_about_the_axis(tmp_path: Path) -> None:
    turn = turned("y")
    series = [(n, turn(x), turn(v), a) for n, x, v, a in flow(3)]
    with pytest.raises(DataError, match=r"move along -y, .* give --up y"):
        averaged(write(tmp_path, series, np.array([[-9.0, 9]] * 3)))
    upwards = [(n, x * [1, 1, -1], v * [1, 1, -1], a) for n, x, v, a in flow(3)]
    with pytest.raises(DataError, match=r"move along z, .* give --up -z"):
        averaged(write(tmp_path, upwards, np.array([[-9.0, 9]] * 3)))


def test_an_axis_that_is_given_wrong_marks_the_field(tmp_path: Path) -> None:
    made = averaged(write(tmp_path, flow(3)), axis=(0.1, 0.0))
    assert any("from the axis" in gate.name for gate in made.failed)


def test_a_case_of_another_vessel_or_unit_is_refused(tmp_path: Path) -> None:
    dumps = write(tmp_path, flow(3))
    with pytest.raises(DataError, match=r"\d+\.\d% of the solids lie outside the walls of the case"):
        averaged(dumps, vessel(0.8))
    with pytest.raises(DataError, match=r"\d+\.\d% of the solids lie outside|no particles between"):
        averaged(dumps, vessel(1e-3), cell=1e-5)
    made = averaged(dumps, vessel())
    assert made.figures["solids_outside_the_walls"] < 1e-3  # between the wall and the chords of its polygon


# --- which snapshots -------------------------------------------------------------------------------------------------


def test_a_filling_run_is_averaged_on_the_grid_of_its_window(tmp_path: Path, straight: Homogenized) -> None:
    """The first dump holds a few small particles near the bottom, another one none: neither is in the window."""
    number, place, velocity, radius = flow(1)[0]
    few = place[:, 2] < 0.05
    start = [(number[few], place[few], velocity[few], 0.5 * radius[few]), tuple(a[:0] for a in flow(1)[0])]
    dumps = write(tmp_path, [*start, *flow()])
    made = homogenize_files(replace(request(dumps), start=0.4), None)
    assert np.array_equal(made.field.grid.z_edges, straight.field.grid.z_edges)
    assert np.allclose(made.field.flux_z, straight.field.flux_z, rtol=1e-9)
    assert made.figures["sauter_diameter_m"] == pytest.approx(0.04)


@pytest.mark.parametrize("at", [0, 3])
def test_snapshots_without_particles_are_left_out_and_said(tmp_path: Path, at: int) -> None:
    series = flow()
    series.insert(at, tuple(a[:0] for a in series[0]))
    made = averaged(write(tmp_path, series))
    assert made.figures["empty_snapshots"] == 1
    assert f"left out: 1 snapshot without particles (first at step {1000 * at})" in made.notes
    assert made.figures["snapshots"] == 8
    with pytest.raises(DataError, match="no particles"):
        averaged(write(tmp_path, [series[at]]))


def test_the_solids_of_the_field_are_those_of_the_dumps(tmp_path: Path, straight: Homogenized) -> None:
    volume = np.mean([4 / 3 * np.pi * (a**3).sum() for _, _, _, a in flow()])
    assert straight.figures["solids_m3"] == pytest.approx(volume, rel=0.01)
    assert straight.figures["solids_in_the_field_m3"] == pytest.approx(volume, rel=0.005)
    part = averaged(write(tmp_path, flow()), z=(0.2, 0.6))
    whole = (
        np.pi * np.trapezoid(FLOW.wall(np.linspace(0.2, 0.6, 200))[0] ** 2, np.linspace(0.2, 0.6, 200)) * FLOW.packing
    )
    assert part.figures["solids_in_the_field_m3"] == pytest.approx(whole, rel=0.02)
    assert any("of the solids lie outside the field" in note for note in part.notes)
    assert not part.failed


def test_ranges_that_hold_nothing_or_do_not_go_with_rings_are_refused(tmp_path: Path) -> None:
    dumps = write(tmp_path, flow(2))
    with pytest.raises(DataError, match=r"--z 30 40: no particles there"):
        averaged(dumps, z=(30.0, 40.0))
    with pytest.raises(DataError, match="leave out --x and --y"):
        averaged(dumps, x=(0.0, 1.0))


# --- what moves how --------------------------------------------------------------------------------------------------


def circulating(count: int, velocities: bool = True) -> Iterator[Particles]:
    """A plug that sinks through a cylinder of 0.2 m × 1 m once in `count` snapshots; what leaves comes in on top."""
    spheres = int(0.58 * np.pi * 0.18**2 / (4 / 3 * np.pi * 0.02**3))
    share = (np.arange(spheres) + 0.5) / spheres
    r, angle = 0.18 * np.sqrt(share), 2.399963 * np.arange(spheres)  # sunflower
    z = np.arange(spheres) * 0.7548777 % 1
    for index in range(count + 1):
        place = np.column_stack([r * np.cos(angle), r * np.sin(angle), (z - index / count) % 1])
        yield (
            np.arange(1.0, spheres + 1),
            place,
            np.tile([0, 0, -velocities / (0.2 * count)], (spheres, 1)),
            np.full(spheres, 0.02),
        )


def test_particles_that_come_back_on_top_do_not_move_upwards(tmp_path: Path) -> None:
    count = 50  # half a diameter between snapshots
    made = averaged(write(tmp_path, list(circulating(count))))
    spheres = len(next(circulating(1))[0])
    flow = spheres * 4 / 3 * np.pi * 0.02**3 / (0.2 * count)
    found = level_flow(made.field.flux_z, made.field.grid)
    inside = slice(3, -3)  # more than a radius from where they leave and enter
    assert np.allclose(found[inside], flow, rtol=2e-3)
    assert made.figures["jumps"] == spheres
    assert made.sampling == "displacement between snapshots"
    assert any(f"{spheres} jumps" in note for note in made.notes)
    assert made.figures["solids_in_the_field_m3"] == pytest.approx(flow * 0.2 * count, rel=0.03)


def test_a_wrong_time_step_marks_the_field(tmp_path: Path) -> None:
    dumps = write(tmp_path, flow())
    made = homogenize_files(replace(request(dumps), time_step=2e-5), None)
    failed = next(gate for gate in made.failed if "time" in gate.name)
    assert failed.value == pytest.approx(10, rel=0.05)
    assert "--time-step" in failed.limit


@pytest.mark.parametrize(("factor", "marked"), [(1 / 1.5, True), (1.0, False), (1.5, True)])
def test_a_time_step_that_is_half_as_long_again_marks_the_field(tmp_path: Path, factor: float, marked: bool) -> None:
    asked = request(write(tmp_path, flow()))
    made = homogenize_files(replace(asked, time_step=factor * asked.time_step), None)
    assert any("--time-step" in gate.limit for gate in made.failed) == marked


def test_a_bed_at_rest_is_written_and_drawn_without_a_flow(tmp_path: Path) -> None:
    still = [(ids, place, np.zeros_like(velocity), radius) for ids, place, velocity, radius in flow(1)] * 3
    made = homogenize_files(request(write(tmp_path, still)), None)
    assert made.field.bulk_flow == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_homogenized(made, None, tmp_path / "out")
    assert not (tmp_path / "out" / "figures" / "rz_flow.png").exists()


@pytest.mark.parametrize("step", [0.02, 0.037, 0.013])
def test_a_rigid_motion_is_given_as_it_is(tmp_path: Path, step: float) -> None:
    """A lattice that sinks, also by whole cells of the grid between snapshots: segments do not differ."""
    steps = np.arange(-8, 8) * 0.04 + 0.02
    place = np.stack(np.meshgrid(steps, steps, np.arange(40) * 0.04 - 0.3, indexing="ij"), -1).reshape(-1, 3)
    count = len(place)
    sinking = [
        (
            np.arange(1.0, count + 1),
            place - np.array([0, 0, step * k]),
            np.tile([0, 0, -5 * step], (count, 1)),
            np.full(count, 0.02),
        )
        for k in range(9)
    ]
    dumps = write(tmp_path, sinking)
    field = averaged(dumps, z=(0.2, 0.6)).field
    at = field.grid.r_centres < 0.2
    speed = field.flux_z[:, at].mean(axis=1) / field.packing_fraction[:, at].mean()
    assert np.allclose(speed, -5 * step, rtol=0.05)
    in_cylinder = np.hypot(place[:, 0], place[:, 1]) < 0.28
    inside = write(tmp_path, [tuple(array[in_cylinder] for array in particles) for particles in sinking])
    cylinder = OutlineSpec(wall=((0.3, 0.7), (0.3, 0.1)), sections={"all": Section(z=(0.7, 0.1))})
    case = vessel().model_copy(update={"outline": cylinder})
    flow = level_flow((field := averaged(inside, case).field).flux_z, field.grid)
    held = in_cylinder.sum() / 40 * 4 / 3 * np.pi * 0.02**3 / 0.04
    assert np.allclose(flow, held * 5 * step, rtol=0.05)


# --- what cannot be --------------------------------------------------------------------------------------------------


def test_particles_that_grow_are_refused(tmp_path: Path) -> None:
    series = [(n, x, v, a * 2**k) for k, (n, x, v, a) in enumerate(flow(3))]
    with pytest.raises(DataError, match=r"particle \d+ has a radius of 0.02 m at step 0 and of 0.04 m at step 1000"):
        averaged(write(tmp_path, series))


def test_a_packing_that_no_spheres_have_is_refused(tmp_path: Path) -> None:
    series = [(n, x, v, 1.3 * a) for n, x, v, a in flow(3)]
    with pytest.raises(DataError, match=r"a packing of 1\.\d+ at r = .* more densely than 0.75"):
        averaged(write(tmp_path, series))
    with pytest.raises(DataError, match=r"a packing of 1\.\d+ at r = "):
        averaged(write(tmp_path, series), vessel())


def test_a_place_beyond_all_bounds_is_refused(tmp_path: Path) -> None:
    series = flow(3)
    series[1][1][7, 0] = 1e300
    with pytest.raises(DataError, match=r"step 1000: a particle at x = 1e\+300 m is far outside the box"):
        averaged(write(tmp_path, series))


def test_a_loose_bed_marks_the_field(tmp_path: Path) -> None:
    series = [tuple(array[n % 2 == 0] for array in (n, x, v, a)) for n, x, v, a in flow()]
    made = averaged(write(tmp_path, series))
    assert [gate.name for gate in made.failed] == ["reference packing"]


@pytest.mark.parametrize(("count", "marked"), [(7, True), (8, False)])  # a segment lies between two snapshots
def test_too_few_snapshots_for_an_error_bar_mark_the_field(tmp_path: Path, count: int, marked: bool) -> None:
    made = averaged(write(tmp_path, flow(count)))
    assert [gate.name for gate in made.failed] == ["segments averaged"] * marked
    assert ("statistical_error" in made.figures) != marked
    assert (made.field.flux_z_se is None) == marked


# --- radius, time and the command ------------------------------------------------------------------------------------


def text(folder: Path, columns: tuple[str, ...]) -> tuple[Path, ...]:
    paths = []
    for index, particles in enumerate(flow(3)):
        paths.append(folder / f"{index}.txt")
        chosen = table(*particles)[:, [COLUMNS.index(name) for name in columns]]
        paths[-1].write_bytes(text_snapshot(1000 * index, BOX, chosen, columns))
    return tuple(paths)


def test_one_radius_may_be_given_for_all_particles(tmp_path: Path) -> None:
    dumps = text(tmp_path, COLUMNS[:-1])
    with pytest.raises(DataError, match=r"no column 'radius' or 'diameter' .*--radius"):
        averaged(dumps)
    made = homogenize_files(replace(request(dumps), radius=0.02), None)
    assert made.figures["sauter_diameter_m"] == pytest.approx(0.04)
    with pytest.raises(DataError, match="holds radii; leave out --radius"):
        homogenize_files(replace(request(text(tmp_path, COLUMNS)), radius=0.02), None)


def test_a_time_in_the_dump_must_agree_with_the_time_step(tmp_path: Path) -> None:
    path = text(tmp_path, COLUMNS)[1]
    path.write_bytes(b"ITEM: TIME\n0.5\n" + path.read_bytes())
    with pytest.raises(DataError, match=r"says 0.5 s, --time-step gives 0.2 s; give --time-step 0.0005"):
        averaged((path,))


def command(dumps: tuple[Path, ...], out: Path, *more: str) -> tuple[int, str]:
    options = ["--cell", "2 cm", "--time-step", "2e-4", "--out", str(out), *more]
    done = CliRunner().invoke(main, ["homogenize", *map(str, dumps), *options])
    return done.exit_code, done.output


def test_the_command_marks_what_fails_and_writes_what_it_measured(tmp_path: Path) -> None:
    dumps = write(tmp_path, flow())
    assert command(dumps, tmp_path / "good")[0] == 0
    status, output = command(dumps, tmp_path / "marked", "--axis", "10cm,0")
    assert status == 4
    assert "quality gate failed: distance of the bed's middle" in output
    for name, failed in (("good", 0), ("marked", 1)):
        provenance = json.loads((tmp_path / name / "provenance.json").read_text())
        assert sum(not gate["passed"] for gate in provenance["quality"]) >= failed
        assert provenance["figures"]["snapshots"] == 8
        assert provenance["sampling"] == "displacement between snapshots"
    assert command(dumps, tmp_path / "bad", "--axis", "1")[0] == 2
    assert command(dumps, tmp_path / "bad", "--time-step", "0")[0] == 2
    assert not (tmp_path / "bad").exists()
