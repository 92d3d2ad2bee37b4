"""The store: nothing half-done is visible, keys follow content, damage is noticed, one process at a time."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import pytest

from granpipe.errors import DataError, RunError
from granpipe.system import files
from granpipe.system.files import check_space, write_whole
from granpipe.system.manifest import write_manifest
from granpipe.system.publish import publishing, publishing_new
from granpipe.system.store import Store, evidence_kept, key_of


def writes(text: str) -> Callable[[Path], None]:
    """Work that leaves one file, in a folder of its own."""

    def work(folder: Path) -> None:
        (folder / "below").mkdir(parents=True)
        (folder / "below" / "result").write_text(text)

    return work


def test_a_stage_is_worked_once_and_found_afterwards(tmp_path: Path) -> None:
    first = Store(tmp_path).make("walls", "abc", writes("42"))
    assert Store(tmp_path).make("walls", "abc", writes("43")) == first
    assert (first / "below" / "result").read_text() == "42"


@pytest.mark.parametrize("name", ["below/result", "manifest.json", "stage.json"])
@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(path.read_bytes()[:-2]),
        lambda path: path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:]),
        lambda path: path.write_bytes(path.read_bytes().replace(b"a", b"b").replace(b"1", b"2").replace(b"4", b"5")),
        Path.unlink,
    ],
    ids=["empty", "short", "flipped", "other values", "gone"],
)
def test_a_damaged_stage_is_made_anew_or_refused(tmp_path: Path, name: str, damage: Callable[[Path], None]) -> None:
    made = Store(tmp_path).make("walls", "abc", writes("42"))
    damage(made / name)
    if name == "stage.json":  # without its marker the folder may be somebody else's
        with pytest.raises(DataError, match="not a stage that granpipe wrote; move it away"):
            Store(tmp_path).make("walls", "abc", writes("43"))
        assert (made / "below" / "result").read_text() == "42"
    else:
        Store(tmp_path).make("walls", "abc", writes("43"))
        assert (made / "below" / "result").read_text() == "43"
        assert Store(tmp_path).has("walls", "abc")


def test_a_failed_stage_leaves_nothing(tmp_path: Path) -> None:
    def work(folder: Path) -> None:
        (folder / "half").write_text("half")
        raise RunError("broke")

    with pytest.raises(RunError):
        Store(tmp_path).make("walls", "abc", work)
    assert not list(tmp_path.iterdir())


def test_what_a_killed_process_left_of_a_stage_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".walls-abc.0123abcd.part").mkdir()
    Store(tmp_path).make("walls", "abc", writes("42"))
    assert [path.name for path in tmp_path.iterdir()] == ["walls-abc"]


def test_the_key_changes_with_every_part_and_not_with_their_order() -> None:
    assert key_of("a", 1, {"x": 1, "y": 2}) == key_of("a", 1, {"y": 2, "x": 1})
    keys = {key_of("a", 1, {"x": 1}), key_of("a", 2, {"x": 1}), key_of("b", 1, {"x": 1}), key_of("a", 1, {"x": 1.5})}
    assert len(keys) == 4


def test_two_processes_do_not_work_on_one_stage(tmp_path: Path) -> None:
    first, second = Store(tmp_path), Store(tmp_path)
    busy = rf"another granpipe \(process {os.getpid()} on .*\) is working on produce"
    with first.lock("produce", "k"), pytest.raises(RunError, match=busy), second.lock("produce", "k"):
        pass
    with second.lock("produce", "k"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["link", "pipe", "folder", "letter"])
def test_what_is_no_lock_is_not_taken_for_one(tmp_path: Path, kind: str) -> None:
    """A link in its place led to a file of the user's, which was emptied."""
    lock, letter = tmp_path / ".walls-k.lock", tmp_path / "letter"
    letter.write_text("dear reader")
    match kind:
        case "link":
            lock.symlink_to(letter)
        case "pipe":
            os.mkfifo(lock)
        case "folder":
            lock.mkdir()
        case "letter":
            lock.write_text("dear reader")
    with pytest.raises(RunError, match="not a lock that granpipe wrote; move it away"):
        Store(tmp_path).make("walls", "k", writes("1"))
    assert letter.read_text() == "dear reader"
    assert os.path.lexists(lock)


def test_the_lock_of_a_process_that_was_killed_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / ".walls-k.lock").write_text('{"host": "there", "pid": 12}')
    assert Store(tmp_path).make("walls", "k", writes("1")).is_dir()


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_without_locks_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(RunError, match=r"\.walls-k\.lock: this file system has no file locks .*; choose a folder"):
        Store(tmp_path).make("walls", "k", writes("42"))
    with pytest.raises(RunError, match=r"\.lock: this file system has no file locks"), Store(tmp_path).in_use():
        pass


def test_everything_is_on_the_disk_before_a_folder_or_file_gets_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: set[str] = set()
    sync, rename, replace = os.fsync, Path.rename, Path.replace

    def note_sync(handle: int) -> None:
        flushed.add(Path(f"/proc/self/fd/{handle}").readlink().name)
        sync(handle)

    def check_rename(path: Path, target: Path) -> Path:
        assert {one.name for one in (path, *path.rglob("*"))} <= flushed
        return rename(path, target)

    def check_replace(path: Path, target: Path) -> Path:
        assert path.name in flushed
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(Path, "rename", check_rename)
    monkeypatch.setattr(Path, "replace", check_replace)
    Store(tmp_path).make("walls", "abc", writes("42"))
    assert tmp_path.name in flushed
    flushed.clear()
    write_whole(tmp_path / "one.json", "{}")
    assert tmp_path.name in flushed


def test_two_containers_with_the_same_process_number_do_not_touch_each_others_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getpid", lambda: 1)
    with publishing(tmp_path / "one") as first:
        (first / "mine").write_text("1")
        with pytest.raises(RuntimeError), publishing(tmp_path / "one"):
            raise RuntimeError
        assert (first / "mine").read_text() == "1"


def test_a_folder_that_a_user_names_is_new(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for target in list(tmp_path.iterdir()):
        with pytest.raises(RunError, match="exists already; choose another --out"), publishing_new(target):
            pass
    with publishing_new(tmp_path / "new") as folder:
        (folder / "field").touch()
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "file", "link", "new"}


def test_a_folder_that_appears_during_the_work_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="has appeared meanwhile"), publishing_new(tmp_path / "out"):
        writes("mine")(tmp_path / "out")
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "below", "result"]


def test_a_full_disk_is_said_before_anything_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9, 10**6))
    with pytest.raises(RunError, match=r"1 MB free on this disk.*--results"), publishing(tmp_path / "x"):
        pass
    assert not (tmp_path / "x").exists()


def test_space_is_asked_for_what_is_needed(tmp_path: Path) -> None:
    check_space(tmp_path)
    with pytest.raises(RunError, match="make room"):
        check_space(tmp_path, needed=10**18)


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: Path) -> None:
        raise OSError(errno.ENOSPC, "full")

    write_whole(tmp_path / "a", "old")
    monkeypatch.setattr(files, "flush", full)
    with pytest.raises(OSError, match="full"):
        write_whole(tmp_path / "a", "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_clearing_deletes_stages_and_nothing_else(tmp_path: Path) -> None:
    """The store may be a link to a folder in which a user has other things."""
    scratch = tmp_path / "scratch"
    (scratch / "my-thesis").mkdir(parents=True)
    (scratch / "my-thesis" / "chapter").write_text("years of work")
    (scratch / "notes").write_text("mine")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / ".store").symlink_to(scratch)
    store = Store(tmp_path / "results" / ".store")
    store.make("walls", "a", writes("12345678"))
    (store.begin("produce", "b") / "segment-00001").mkdir()
    shutil.copytree(store.folder("walls", "a"), scratch / "copy-of-walls")
    (scratch / "walls-c").symlink_to(scratch / "walls-a")
    (scratch / "my-paper").mkdir()
    (scratch / "my-paper" / "stage.json").write_text('{"stage": "x", "key": ""}')
    freed, foreign = store.clear()
    assert freed > 8
    assert {path.name for path in scratch.iterdir()} == {"my-thesis", "my-paper", "notes", "copy-of-walls", "walls-c"}
    assert [path.name for path in foreign] == ["copy-of-walls", "my-paper", "my-thesis"]
    assert (scratch / "my-thesis" / "chapter").read_text() == "years of work"
    assert (tmp_path / "results" / ".store").is_symlink()


def in_parts(store: Store) -> Path:
    """A stage in parts, as production leaves it."""
    folder = store.begin("produce", "b")
    for name, text in {"segment-00001/sums": "1", "logs/log": "2", "work/in": "3", ".part/half": "4"}.items():
        (folder / name).parent.mkdir()
        (folder / name).write_text(text)
    write_manifest(folder / "segment-00001")
    return folder


@pytest.mark.parametrize("name", ["notes", "mine/notes", "below/notes", "segment-00001/notes"])
@pytest.mark.parametrize("stage", ["walls", "produce"])
def test_what_a_user_put_into_a_stage_is_not_deleted(tmp_path: Path, stage: str, name: str) -> None:
    store = Store(tmp_path)
    folder = store.make("walls", "a", writes("42")) if stage == "walls" else in_parts(store)
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text("mine")
    assert store.clear()[1] == [folder]
    assert (folder / name).read_text() == "mine"
    if stage == "walls":
        (folder / "below" / "result").write_text("damaged")
        with pytest.raises(DataError, match=rf"{folder / name}: not written by granpipe; move it away"):
            Store(tmp_path).make("walls", "a", writes("43"))
    (folder / name).unlink()
    assert store.clear()[1] == []
    assert not folder.exists()


def test_evidence_with_a_users_notes_is_kept_beside_that_of_the_next_failure(tmp_path: Path) -> None:
    def fails() -> None:
        work = tmp_path / "work"
        work.mkdir()
        (work / "log").write_text("lost atoms")
        with pytest.raises(RunError, match="evidence: "), evidence_kept(work, tmp_path / "evidence"):
            raise RunError("it failed")

    fails()
    fails()
    assert [path.name for path in tmp_path.iterdir()] == ["evidence"]  # the first had nothing of the user's
    (tmp_path / "evidence" / "notes").write_text("mine")
    fails()
    first, second = sorted(tmp_path.glob("evidence*"))
    assert (second / "notes").read_text() == "mine"
    assert (second / "log").exists()
    assert not (first / "notes").exists()


def test_a_store_that_a_run_uses_is_not_cleared(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.make("walls", "a", writes("1"))
    with store.in_use(), Store(tmp_path).in_use(), pytest.raises(RunError, match="a run uses this store"):
        store.clear()
    assert store.folder("walls", "a").exists()
    store.clear()
    assert not list(tmp_path.iterdir())
