"""`granpipe plot`: one picture, in a file that is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from fakes.synthetic import field_of, pipe

from granpipe.cli import main
from granpipe.field import Box, Field


@pytest.fixture
def result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "silo"
    folder.mkdir()
    field_of(pipe(), 0.05).save(folder / "field.npz")
    return folder


def plot(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["plot", *arguments])


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((), "silo-overview.png"),
        (("--what", "speed"), "silo-speed.png"),
        (("--profile", "z=0.4"), "silo-profile-z0.4.png"),
        (("--profile", "z=40cm", "--out", "mine.png"), "mine.png"),
    ],
)
def test_it_writes_a_file_and_says_where(arguments: tuple[str, ...], name: str, result: Path) -> None:
    done = plot("silo", *arguments)
    assert (done.exit_code, done.output) == (0, f"picture in {name}\n")
    assert Path(name).read_bytes().startswith(b"\x89PNG")


def test_a_file_that_is_there_is_not_replaced(result: Path) -> None:
    Path("mine.png").write_text("precious")
    done = plot("silo", "--out", "mine.png")
    assert done.exit_code == 3
    assert "mine.png exists; move it away or choose another --out" in done.output
    assert Path("mine.png").read_text() == "precious"


@pytest.mark.parametrize("name", ["picture.txt", "picture.pdf", "picture", ""])
def test_a_picture_that_is_no_png_is_refused(name: str, result: Path) -> None:
    done = plot("silo", "--out", name)
    assert done.exit_code == 2
    assert "give a name that ends in .png" in done.output
    assert [path.name for path in Path().iterdir()] == ["silo"]


@pytest.mark.parametrize("text", ["", "null", "{}", "[" * 100_000])
def test_a_damaged_manifest_is_not_taken_for_none(text: str, result: Path) -> None:
    (result / "manifest.json").write_text(text)
    done = plot("silo")
    assert done.exit_code == 3
    assert "manifest.json: damaged" in done.output


@pytest.mark.parametrize("text", ["4.4", "r=0.2", "z=", "z=up", "=1"])
def test_a_profile_that_is_no_level_is_refused(text: str, result: Path) -> None:
    done = plot("silo", "--profile", text)
    assert done.exit_code == 2
    assert "--profile" in done.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("silo", "--profile", "z=7"), "choose a level from 0 to 1 m"),
        (("silo", "--what", "error"), "not have standard errors"),
        (("nothing",), "field.npz: file not found"),
    ],
)
def test_what_cannot_be_drawn_is_explained(arguments: tuple[str, ...], words: str, result: Path) -> None:
    done = plot(*arguments)
    assert done.exit_code == 3
    assert words in done.output
    assert not list(Path().glob("*.png"))


@pytest.mark.parametrize(("status", "words"), [(0, ""), (1, "no viewer could be started")])
def test_show_opens_the_viewer_of_the_desktop(
    status: int, words: str, result: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("click.launch", lambda path: opened.append(path) or status)
    done = plot("silo", "--show")
    assert done.exit_code == 0
    assert opened == ["silo-overview.png"]
    assert words in done.output
    assert ("no viewer" in done.output) == bool(words)


def test_a_flow_in_a_plane_is_drawn_as_well(result: Path) -> None:
    field = Field.load(result / "field.npz")
    box = Box(field.grid.r_edges - 0.25, field.grid.z_edges, field.grid.r_edges[[0, 1]], True)
    flow = float((field.flux_z[0] * box.ring_area).sum() / -field.bulk_packing)
    planar = replace(field, grid=box, psi=None, bulk_flow=flow)
    planar = replace(planar, flux_r=0 * field.flux_r, flux_z=0 * field.flux_z + field.flux_z[0].mean())
    planar = replace(planar, bulk_flow=float(-(planar.flux_z[0] * box.ring_area).sum() / field.bulk_packing))
    (result / "field.npz").unlink()
    planar.save(result / "field.npz")
    assert plot("silo").exit_code == 0
