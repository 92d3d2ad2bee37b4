"""Cores that other programs keep busy, and what a run makes of it."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from fakes.records import WALLS

from granpipe.case.reader import read_case
from granpipe.pipeline import calibrate, run
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import _Replica, _walls_key
from granpipe.pipeline.results import results_key
from granpipe.pipeline.run import plan_case
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.system.cores import VARIABLE, busy_cores, free_cores
from granpipe.system.store import Store

REACTOR = Path(__file__).parents[2] / "cases" / "reactor.yaml"


@dataclass
class Heard(Silent):
    """Keeps the notes."""

    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        self.notes.append(text)


@pytest.fixture(autouse=True)
def machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four cores, of which this process may use 0, 1 and 3; 0 and 2 are busy, 1 a little."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 3})
    monkeypatch.setattr(psutil, "cpu_percent", lambda *_, **__: [98.0, 20.0, 100.0, 2.0])


def beside(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, free: int, **changes: str) -> tuple[int, list[str]]:
    """Ranks of the reactor on two cores, so many of them free, and what was said."""
    monkeypatch.setattr(run, "free_cores", lambda: free)
    file, progress = read_case(REACTOR, changes), Heard()
    context = Context(Store(tmp_path), {}, progress, 2)
    return run._beside_others(file, plan_case(file, 2), context).dem.ranks, progress.notes


def test_cores_that_this_process_may_not_use_do_not_count() -> None:
    assert busy_cores() == pytest.approx(1.2)
    assert free_cores() == 2


def test_one_core_is_always_counted_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(psutil, "cpu_percent", lambda *_, **__: [100.0] * 4)
    assert free_cores() == 1


def test_a_share_is_trusted_however_busy_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")
    assert free_cores() == 3


def test_a_run_beside_others_takes_fewer_ranks_and_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ranks, (note,) = beside(monkeypatch, tmp_path, free=1)
    assert ranks == 1
    assert "other programs keep cores busy: 1 rank in place of 2" in note


def test_on_idle_cores_nothing_changes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert beside(monkeypatch, tmp_path, free=2) == (2, [])


def test_ranks_of_the_case_stay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert beside(monkeypatch, tmp_path, free=1, **{"dem.ranks": "2"}) == (2, [])


def test_what_was_made_on_other_ranks_is_found_again(tmp_path: Path) -> None:
    WALLS.write(tmp_path)
    versions = {"gmsh": "4", "liggghts": "3.8"}
    found = set()
    for ranks in ("auto", "1", "2"):
        plan = make_plan(read_case(REACTOR, {"dem.ranks": ranks}).case, cores=2)
        replica = _Replica(0, plan, tmp_path, Context(Store(tmp_path), versions, Silent(), 2))
        keys = _walls_key(plan, versions), replica.settle_key, replica.produce_key, results_key(plan.case, versions)
        found.add(keys)
    assert len(found) == 1


@pytest.mark.parametrize(("free", "measured"), [(1, {1}), (2, {1, 2}), (8, {1, 2})])
def test_two_ranks_are_measured_on_free_cores_only(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, free: int, measured: set[int]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(calibrate, "free_cores", lambda: free)
    monkeypatch.setattr(calibrate, "_rate", lambda *_: 1e6)
    progress = Heard()
    assert set(calibrate.calibrate(progress).by_ranks) == measured
    assert len(progress.notes) == (free == 1)
