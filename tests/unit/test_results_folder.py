"""A results folder is renewed file by file: granpipe's own files change, and nothing of the user's is lost."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from granpipe.errors import DataError
from granpipe.system.manifest import is_whole, read_manifest, verify
from granpipe.system.publish import renewing


def write(target: Path, files: dict[str, str]) -> list[str]:
    """Renew a folder with these files; what was noted."""
    notes: list[str] = []
    with renewing(target, notes.append) as folder:
        for name, text in files.items():
            (folder / name).parent.mkdir(exist_ok=True, parents=True)
            (folder / name).write_text(text)
    assert is_whole(target)
    assert not list(target.glob(".*"))
    return notes


def contents(folder: Path) -> dict[str, str]:
    """Every file but the manifest."""
    found = {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}
    del found["manifest.json"]
    return found


OLD = {"field.npz": "old", "comsol/flow.txt": "old", "figures/w.png": "old"}
NEW = {"field.npz": "new", "comsol/flow.txt": "new"}


@pytest.fixture
def target(tmp_path: Path) -> Path:
    assert not write(tmp_path / "case", OLD)
    return tmp_path / "case"


def test_what_granpipe_wrote_is_replaced_and_what_it_no_longer_writes_is_removed(target: Path) -> None:
    assert not write(target, NEW)
    assert contents(target) == NEW
    assert not (target / "figures").exists()


def test_the_files_of_a_user_stay_where_they_are(target: Path) -> None:
    for name in ("notes.txt", "comsol/flow.mph", "figures/mine/own.png"):
        (target / name).parent.mkdir(exist_ok=True)
        (target / name).write_text("mine")
    inode = (target / "comsol" / "flow.mph").stat().st_ino
    assert not write(target, NEW)
    mine = {"notes.txt": "mine", "comsol/flow.mph": "mine", "figures/mine/own.png": "mine"}
    assert contents(target) == NEW | mine
    assert (target / "comsol" / "flow.mph").stat().st_ino == inode  # a program that has it open keeps it


def test_a_file_that_the_user_edited_is_kept_aside(target: Path) -> None:
    (target / "comsol" / "flow.txt").write_text("edited")
    notes = write(target, NEW)
    assert contents(target) == NEW | {"comsol/flow.changed-1.txt": "edited"}
    assert notes == [f"note: {target}/comsol/flow.txt is not as granpipe wrote it; it is kept as flow.changed-1.txt"]
    (target / "comsol" / "flow.txt").write_text("edited again")
    write(target, OLD)
    assert contents(target)["comsol/flow.changed-1.txt"] == "edited"
    assert contents(target)["comsol/flow.changed-2.txt"] == "edited again"


def test_an_edited_file_that_is_no_longer_written_stays(target: Path) -> None:
    (target / "figures" / "w.png").write_text("edited")
    (note,) = write(target, NEW)
    assert contents(target) == NEW | {"figures/w.png": "edited"}
    assert "figures/w.png is of an earlier run, but no longer as granpipe wrote it; it stays" in note


def test_what_a_user_put_under_a_name_that_granpipe_needs_is_kept_aside(target: Path) -> None:
    (target / "report.html").write_text("mine")
    (target / "logs").write_text("mine, too")
    (target / "field.npz").unlink()
    (target / "field.npz").mkdir()
    (target / "field.npz" / "inside").write_text("mine as well")
    assert len(write(target, NEW | {"report.html": "new", "logs/run.txt": "new"})) == 3
    kept = {
        "report.changed-1.html": "mine",
        "logs.changed-1": "mine, too",
        "field.changed-1.npz/inside": "mine as well",
    }
    assert contents(target) == NEW | {"report.html": "new", "logs/run.txt": "new"} | kept


def test_symbolic_links_stay_links(target: Path, tmp_path: Path) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    shutil.move(target / "comsol", scratch / "comsol")
    (target / "comsol").symlink_to(scratch / "comsol")
    shutil.move(target / "field.npz", scratch / "large.npz")
    (target / "field.npz").symlink_to("../scratch/large.npz")
    shutil.move(target, scratch / "case")
    target.symlink_to(scratch / "case")
    (scratch / "case" / "field.npz").unlink()
    (scratch / "case" / "field.npz").symlink_to(scratch / "large.npz")
    assert not write(target, NEW)
    assert target.is_symlink()
    assert (target / "comsol").is_symlink()
    assert (target / "field.npz").is_symlink()
    assert (scratch / "large.npz").read_text() == (scratch / "comsol" / "flow.txt").read_text() == "new"


def test_a_link_to_another_file_system_is_followed(target: Path) -> None:
    memory = Path("/dev/shm")
    if not memory.is_dir() or memory.stat().st_dev == target.stat().st_dev:
        pytest.skip("needs a second file system")
    place = memory / f"granpipe-test-{target.stat().st_ino}"
    try:
        (target / "field.npz").unlink()
        place.write_text("old")
        (target / "field.npz").symlink_to(place)
        assert not write(target, NEW)
        assert place.read_text() == "new"
        assert (target / "field.npz").is_symlink()
    finally:
        place.unlink(missing_ok=True)


def test_a_renewal_that_was_killed_halfway_is_completed_without_false_alarm(
    target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        pass

    replace, seen = Path.replace, []

    def killed(path: Path, to: Path) -> Path:
        seen.append(path)
        if path.name == "field.npz":
            raise Killed
        return replace(path, to)

    monkeypatch.setattr(Path, "replace", killed)
    with pytest.raises(Killed):
        write(target, {"field.npz": "half", "comsol/flow.txt": "half"})
    monkeypatch.undo()
    assert contents(target)["comsol/flow.txt"] == "half"
    assert not is_whole(target)
    assert not write(target, NEW)
    assert contents(target) == NEW


def test_an_emptied_file_and_a_damaged_manifest_lose_nothing(target: Path) -> None:
    (target / "field.npz").write_bytes(b"")
    (target / "manifest.json").write_text("{")
    write(target, NEW)
    assert contents(target) == NEW | {"comsol/flow.changed-1.txt": "old", "figures/w.png": "old"}


def test_a_folder_in_the_place_of_the_manifest_is_kept_aside(target: Path) -> None:
    (target / "manifest.json").unlink()
    (target / "manifest.json").mkdir()
    (target / "manifest.json" / "letter").write_text("mine")
    assert any("manifest.json is not as granpipe wrote it" in note for note in write(target, NEW))
    assert (target / "manifest.changed-1.json" / "letter").read_text() == "mine"
    assert (target / "field.npz").read_text() == "new"


def test_a_manifest_cannot_name_files_outside_of_its_folder(target: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("old")
    text = (target / "manifest.json").read_text()
    (target / "manifest.json").write_text(text.replace("figures/w.png", "../mine"))
    write(target, NEW)
    assert (tmp_path / "mine").read_text() == "old"


@pytest.mark.parametrize("name", ["field.npz", "manifest.json"])
@pytest.mark.parametrize("damage", [b"", b"olD", None])
def test_damage_is_named(target: Path, name: str, damage: bytes | None) -> None:
    verify(target, "field.npz")
    if damage is None:
        (target / name).unlink()
    else:
        (target / name).write_bytes(damage)
    with pytest.raises(DataError, match=name.replace(".", r"\.")):
        verify(target)
    with pytest.raises(DataError, match=name.replace(".", r"\.")):
        verify(target, "field.npz")


def test_what_is_not_asked_for_may_be_edited(target: Path) -> None:
    (target / "comsol" / "flow.txt").write_text("edited")
    verify(target, "field.npz")
    assert set(read_manifest(target)) == set(OLD)
