"""The grid round dumps that a user brings: its ends, and what is refused."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from fakes.plane_flow import PlaneFlow

import granpipe.pipeline.dump_grid as module
from granpipe.case.reader import load_case
from granpipe.cli import main
from granpipe.errors import CaseError, DataError
from granpipe.field import Box
from granpipe.pipeline.dump_grid import grid_round
from granpipe.pipeline.dump_survey import Survey
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.dumps import homogenize_files

BOX = np.array([[-1.0, 1.0], [0.0, 0.2], [-5.0, 5.0]])


def survey(*centres: tuple[float, float, float], radius: float = 0.02) -> Survey:
    """What is found of some spheres in the box."""
    place = np.array(centres)
    found = Survey(times=[0.0], solids=[4 / 3 * np.pi * radius**3], surface=4 * np.pi * radius**2)
    found.low = np.maximum(place.min(axis=0) - radius, BOX[:, 0])
    found.high = np.minimum(place.max(axis=0) + radius, BOX[:, 1])
    return found


CLOUD = survey((0.1, 0.01, 0.3), (0.4, 0.19, 0.9), (0.2, 0.1, 0.5))


def test_ranges_are_those_of_the_particles_within_the_box() -> None:
    grid = grid_round(CLOUD, Frame("xyz", 0.01), 14)
    assert isinstance(grid, Box)
    assert grid.r_edges[[0, -1]] == pytest.approx([0.08, 0.42])
    assert grid.y_edges[[0, -1]] == pytest.approx([0.0, 0.2])  # the box cuts particles there
    assert grid.z_edges[[0, -1]] == pytest.approx([0.28, 0.92])
    assert grid.shape == (64, 20, 34)


def test_particles_are_cut_at_the_ends_of_a_depth_that_is_given_only() -> None:
    whole = grid_round(CLOUD, Frame("xz", 0.01), 40)
    given = grid_round(CLOUD, Frame("xz", 0.01, y=(0.05, 0.15)), 40)
    assert isinstance(whole, Box)
    assert isinstance(given, Box)
    assert (whole.cut, given.cut) == (False, True)
    assert given.measure.turn == pytest.approx(0.1)
    assert given.shape == whole.shape == (64, 34)


def test_a_grid_that_does_not_fit_into_memory_is_refused_with_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.psutil, "virtual_memory", lambda: SimpleNamespace(available=1e9))
    wide = survey((-0.9, 0.02, -4), (0.9, 0.18, 4))
    with pytest.raises(DataError, match=r"184 × 20 × 804 cells takes 2\.7 GB .* 1 GB are free; make --cell 1\.4 times"):
        grid_round(wide, Frame("xyz", 0.01), 14)
    assert grid_round(wide, Frame("xyz", 0.015), 14).shape[0] == 536


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (Frame("xz", 1e-4), "less than 0.02 of the particles' Sauter diameter of 0.04 m; 0.01 m is fine enough"),
        (Frame("xyz", 0.01, z=(1.0, 0.5)), "--z 1 0.5: give the lower end first"),
    ],
)
def test_senseless_frames_are_refused(frame: Frame, message: str) -> None:
    with pytest.raises(DataError, match=message):
        grid_round(CLOUD, frame, 14)


def test_a_round_vessel_goes_with_rings_only(tmp_path: Path) -> None:
    dumps = PlaneFlow().dumps(tmp_path, 0.1, 2)
    case = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml")
    with pytest.raises(DataError, match="vessel of revolution: give no --plane xz, or leave out --case"):
        homogenize_files(Request(dumps, Frame("xz", 0.02), 1e-4), case)


def test_dumps_are_averaged_between_the_walls_that_the_case_draws(tmp_path: Path) -> None:
    dumps = PlaneFlow().dumps(tmp_path, 0.1, 2)
    case = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml", {"dem.walls": "set_back"})
    for plane in ("rz", "xyz"):
        with pytest.raises(CaseError, match="draw those that the particles had") as refused:
            homogenize_files(Request(dumps, Frame(plane, 0.02), 1e-4), case)
        assert refused.value.key == ("dem", "walls")


def test_flow_through_the_ends_of_x_is_not_made_to_conserve(tmp_path: Path) -> None:
    dumps = PlaneFlow().dumps(tmp_path, 0.1, 9)
    made = homogenize_files(Request(dumps, Frame("xz", 0.04, x=(0.1, 0.3), z=(0.0, 1.0)), 1e-4), None)
    assert made.field.psi is None
    assert "passes through the ends of the range of x" in made.method


def test_the_command_says_what_it_did(tmp_path: Path) -> None:
    dumps = [str(path) for path in PlaneFlow().dumps(tmp_path, 0.1, 8)]
    options = ["--cell", "4 cm", "--plane", "xz", "--z", "0", "100 cm", "--time-step", "1e-4"]
    done = CliRunner().invoke(main, ["homogenize", *dumps, *options, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "sampled by displacement between snapshots; method: psi" in done.output
    assert (tmp_path / "out" / "comsol" / "psi_grid.txt").is_file()
    wrong = CliRunner().invoke(main, ["homogenize", *dumps, *options, "--y", "0", "1 kg", "--out", str(tmp_path / "b")])
    assert wrong.exit_code == 2
    assert "--y" in wrong.output
