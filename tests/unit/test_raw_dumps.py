"""Averaging dumps that exist already: how the flow is sampled, the times asked for, with and without a case."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from fakes.analytic_flow import COLUMNS, ConvergingFlow, binary_snapshot, snapshots, table, text_snapshot, write_dumps

from granpipe.case.outline import OutlineSpec, Section
from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import level_flow
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.dumps import homogenize_files

FLOW = ConvergingFlow(solids_flow=0.01, packing=0.58)
RADII = np.full(1, 0.02)


@pytest.fixture(scope="module")
def dumps(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """Eight snapshots, 0.2 s and 1000 steps apart, of a known converging flow."""
    return tuple(write_dumps(tmp_path_factory.mktemp("dumps"), FLOW, RADII, 0.2, 8))


def request(dumps: tuple[Path, ...], **times: float) -> Request:
    return Request(dumps=dumps, frame=Frame("rz", 0.02), time_step=2e-4, **times)


def vessel(method: str) -> Case:
    """The case of the known flow: its wall as a polygon, its flow rate as bulk."""
    reactor = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml", {"flow_rate": "1 m^3/h"})
    z = np.linspace(FLOW.height, 0, 60)
    wall = tuple(zip(FLOW.wall(z)[0].tolist(), z.tolist(), strict=True))
    outline = OutlineSpec(wall=wall, sections={"all": Section(z=(FLOW.height, 0.0))})
    homogenize = reactor.homogenize.model_copy(update={"method": method})
    dem = reactor.dem.model_copy(update={"statistical_error": None})  # the error of eight snapshots is not known
    return reactor.model_copy(update={"outline": outline, "homogenize": homogenize, "dem": dem})


def test_without_a_case_the_plain_average_of_the_chosen_times_is_given(dumps: tuple[Path, ...]) -> None:
    field = homogenize_files(request(dumps), None).field
    inside = np.abs(level_flow(field.flux_z, field.grid)[10:40])
    np.testing.assert_allclose(inside, FLOW.solids_flow, rtol=0.25)
    assert field.psi is None
    late = homogenize_files(request(dumps, start=1.0), None).field
    assert not np.array_equal(late.flux_z, field.flux_z)


@pytest.mark.parametrize("method", ["gaussian", "psi"])
def test_with_a_case_the_field_conserves_by_its_method(dumps: tuple[Path, ...], method: str) -> None:
    field = homogenize_files(request(dumps), vessel(method)).field
    flow = level_flow(field.flux_z, field.grid)
    np.testing.assert_allclose(flow, flow[0], rtol=1e-10)
    assert field.bulk_packing == pytest.approx(FLOW.packing, rel=0.1)
    assert flow[0] * field.velocity_scale == pytest.approx(1 / 3600)


def test_with_a_case_its_other_fields_come_along(dumps: tuple[Path, ...]) -> None:
    extra = homogenize_files(request(dumps), asking("size_classes", "wall_slip", "residence_time")).field.extra
    assert {"class_packing", "wall_slip", "residence_time"} <= set(extra)


def asking(*fields: str) -> Case:
    """The case of the known flow, which asks for more."""
    case = vessel("psi")
    return case.model_copy(update={"homogenize": case.homogenize.model_copy(update={"fields": fields})})


def test_dumps_tell_what_moves_and_touches(dumps: tuple[Path, ...]) -> None:
    """Particles on streamlines have no temperature of their own; their gradients are those of the flow."""
    made = homogenize_files(
        request(dumps), asking("granular_temperature", "coordination", "mixing", "strain_rate", "age")
    )
    extra = made.field.extra
    speed = FLOW.solids_flow / FLOW.packing / (np.pi * FLOW.wall(np.array([0.0]))[0][0] ** 2)
    assert np.sqrt(np.nanmedian(extra["granular_temperature"])) < 0.05 * speed
    assert np.nanmax(extra["coordination"]) > 0
    assert "mixing_index" not in made.figures  # the particles of these dumps are of one size, not those of the case
    assert np.isnan(extra["mixing_index"]).all()
    z = np.array([FLOW.height / 2 - 0.05, FLOW.height / 2 + 0.05])
    stretch = np.diff(FLOW.particle_velocity(np.full(2, 1e-6), z)[1])[0] / 0.1
    rows = np.abs(made.field.grid.z_centres - FLOW.height / 2) < 0.1
    assert np.nanmean(extra["strain_zz"][rows, :5]) == pytest.approx(stretch, rel=0.35)
    assert np.nanmedian(extra["age"]) > 0
    assert "age_se" not in extra


@pytest.mark.parametrize("name", ["wall_pressure", "stress"])
def test_forces_that_dumps_do_not_hold_are_refused(dumps: tuple[Path, ...], name: str) -> None:
    with pytest.raises(DataError, match=f"hold no forces.*take {name} out of homogenize.fields, or let granpipe run"):
        homogenize_files(request(dumps), asking(name))


def test_a_temperature_without_velocities_is_refused(tmp_path: Path) -> None:
    without = written(tmp_path, tuple(name for name in COLUMNS if name[0] != "v"))
    with pytest.raises(DataError, match=r"hold no velocities.*dump vx vy vz"):
        homogenize_files(text_request(without), asking("granular_temperature"))


def test_mixing_of_one_size_is_refused(dumps: tuple[Path, ...]) -> None:
    case = asking("mixing")
    single = load_case(Path(__file__).parents[2] / "cases" / "smoke.yaml").material.size
    case = case.model_copy(update={"material": case.material.model_copy(update={"size": single})})
    with pytest.raises(DataError, match="one size alone"):
        homogenize_files(request(dumps), case)


def test_times_without_a_snapshot_are_named(dumps: tuple[Path, ...]) -> None:
    with pytest.raises(DataError, match=r"run from 0 to 1\.4 s; none lies between --start 20 s"):
        homogenize_files(request(dumps, start=20.0), None)


BOX = np.array([[-0.6, 0.6], [-0.6, 0.6], [-1.0, 10.0]])


def written(folder: Path, columns: tuple[str, ...] = COLUMNS, count: int = 4) -> tuple[Path, ...]:
    """Text snapshots of the flow, 0.2 s apart, with some of the columns."""
    paths = []
    for index, particles in enumerate(snapshots(FLOW, RADII, 0.2, count, 1)):
        values = table(*particles)
        paths.append(folder / f"{index * 1000}.txt")
        chosen = [COLUMNS.index(name) for name in columns]
        paths[-1].write_bytes(text_snapshot(index * 1000, BOX, values[:, chosen], columns))
    return tuple(paths)


def text_request(dumps: tuple[Path, ...]) -> Request:
    return Request(dumps=dumps, frame=Frame("rz", 0.02), time_step=2e-4)


def test_particles_that_can_be_followed_are_sampled_by_their_way(dumps: tuple[Path, ...], tmp_path: Path) -> None:
    assert homogenize_files(request(dumps), None).sampling.startswith("displacement")
    without_velocities = written(tmp_path, tuple(name for name in COLUMNS if name[0] != "v"))
    made = homogenize_files(text_request(without_velocities), None)
    flow = level_flow(made.field.flux_z, made.field.grid)[10:40]
    np.testing.assert_allclose(flow, FLOW.solids_flow, rtol=0.25)


def test_a_velocity_that_is_wrong_between_snapshots_does_no_harm(tmp_path: Path) -> None:
    """Stick and slip: at rest in every snapshot, moving in between."""
    paths = []
    for index, (number, position, velocity, radius) in enumerate(snapshots(FLOW, RADII, 0.2, 8, 1)):
        paths.append(tmp_path / f"{index}.bin")
        paths[-1].write_bytes(binary_snapshot(1000 * index, BOX, table(number, position, 0 * velocity, radius)))
    flow = level_flow((field := homogenize_files(request(tuple(paths)), None).field).flux_z, field.grid)
    np.testing.assert_allclose(flow[10:40], FLOW.solids_flow, rtol=0.25)


def test_velocities_serve_where_particles_cannot_be_followed(dumps: tuple[Path, ...], tmp_path: Path) -> None:
    for name in ("none", "twice"):
        (tmp_path / name).mkdir()
    (tmp_path / "twice" / "0.txt").write_bytes(
        text_snapshot(0, BOX, table(np.ones(2), np.full((2, 3), 0.1), np.zeros((2, 3)), np.full(2, 0.02)))
    )
    reasons = {
        "there is only one": request(dumps[:1]),
        "no ids": text_request(written(tmp_path / "none", COLUMNS[1:])),
        "ids occur twice": text_request((tmp_path / "twice" / "0.txt",)),
        "diameters .* dump more often": request((dumps[0], dumps[-1])),
    }
    for reason, asked in reasons.items():
        assert re.search(f"^velocities .*{reason}", homogenize_files(asked, None).sampling), reason
