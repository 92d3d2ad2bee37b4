"""The store: nothing half-done is visible, keys follow content, one process at a time."""

from __future__ import annotations

import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from granpipe.errors import RunError
from granpipe.system import store as store_module
from granpipe.system.store import Store, key_of, publishing


def test_a_stage_is_worked_once_and_found_afterwards(tmp_path: Path) -> None:
    calls = []

    def work(folder: Path) -> None:
        calls.append(1)
        (folder / "result").write_text("42")

    first = Store(tmp_path).make("walls", "abc", work)
    assert Store(tmp_path).make("walls", "abc", work) == first
    assert calls == [1]
    assert (first / "result").read_text() == "42"


def test_a_failed_stage_leaves_nothing_that_looks_finished(tmp_path: Path) -> None:
    def work(folder: Path) -> None:
        (folder / "half").write_text("half")
        raise RunError("broke")

    with pytest.raises(RunError):
        Store(tmp_path).make("walls", "abc", work)
    assert [path.name for path in tmp_path.iterdir()] == [".walls-abc.lock"]


def test_the_key_changes_with_every_part_and_not_with_their_order() -> None:
    assert key_of("a", 1, {"x": 1, "y": 2}) == key_of("a", 1, {"y": 2, "x": 1})
    keys = {key_of("a", 1, {"x": 1}), key_of("a", 2, {"x": 1}), key_of("b", 1, {"x": 1}), key_of("a", 1, {"x": 1.5})}
    assert len(keys) == 4


def test_two_processes_do_not_work_on_one_stage(tmp_path: Path) -> None:
    first, second = Store(tmp_path), Store(tmp_path)
    with first.lock("produce", "k"), pytest.raises(RunError, match="another granpipe"), second.lock("produce", "k"):
        pass
    with second.lock("produce", "k"):
        pass


def test_publishing_replaces_a_folder_as_a_whole(tmp_path: Path) -> None:
    target = tmp_path / "case"
    for text in ("old", "new"):
        with publishing(target) as folder:
            (folder / text).write_text(text)
    assert [path.name for path in target.iterdir()] == ["new"]
    assert [path.name for path in tmp_path.iterdir()] == ["case"]


def test_a_full_disk_is_said_before_anything_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9, 10**6))
    with pytest.raises(RunError, match=r"1 MB free on this disk.*--results"), publishing(tmp_path / "x"):
        pass
    assert not (tmp_path / "x").exists()


def test_space_is_asked_for_what_is_needed(tmp_path: Path) -> None:
    store_module.check_space(tmp_path)
    with pytest.raises(RunError, match="make room"):
        store_module.check_space(tmp_path, needed=10**18)


def test_clearing_frees_finished_stages_and_spares_what_is_being_worked_on(tmp_path: Path) -> None:
    store = Store(tmp_path)

    def work(folder: Path) -> None:
        (folder / "x").write_bytes(b"12345678")

    for key in ("a", "b"):
        store.make("walls", key, work)
    with store.lock("walls", "b"):
        freed, (kept,) = store.clear()
    assert freed == 8
    assert kept.startswith("walls-b: another granpipe")
    assert not store.folder("walls", "a").exists()
    assert store.folder("walls", "b").exists()
