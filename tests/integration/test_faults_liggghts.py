"""Killed and resumed on the real LIGGGHTS: nothing is lost, and the average is that of an unbroken run."""

from __future__ import annotations

import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fakes.runs import all_gone, assert_statistically_equal, chain, run, running_below, segments, start, wait_for

from granpipe.case.reader import read_case
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import read_snapshot
from granpipe.dem.run import Liggghts, Limits
from granpipe.errors import RunError
from granpipe.planning.make import make_plan

pytestmark = pytest.mark.liggghts

CORES = len(os.sched_getaffinity(0))


def longer(tiny: Path, seconds: float) -> Path:
    tiny.write_text(tiny.read_text().replace("max_time: 1.2 s", f"max_time: {seconds} s"))
    return tiny


def copied(results: Path, to: Path) -> Path:
    """The same results before production."""
    shutil.copytree(results / ".store", to / ".store")
    shutil.rmtree(chain(to))
    return to


def ranks(results: Path) -> list[int]:
    """Processes of LIGGGHTS at work on production, without mpirun."""
    return [n for n, command in running_below(results).items() if command.startswith("/") and "liggghts -in" in command]


def killed(case: Path, results: Path, rng: random.Random, victim: str, longest: float, after: int = 0) -> None:
    """Kill the driver, LIGGGHTS or one rank of it at a random moment after a segment, and see it all end."""
    process = start(case, results)
    if after:
        wait_for(f".store/produce-*/segment-{after:05d}", results)
    targets = [process.pid]
    while victim != "driver" and not (targets := ranks(results)) and process.poll() is None:
        time.sleep(0.02)
    time.sleep(rng.uniform(0, longest))
    if victim == "rank":
        targets = targets[:1]
    for target in targets:
        with contextlib.suppress(ProcessLookupError):
            os.kill(target, signal.SIGKILL)
    _, said = process.communicate(timeout=60)
    assert process.returncode in ({-signal.SIGKILL} if victim == "driver" else {3, 0, 4}), said
    assert "Traceback" not in said
    assert all_gone(results)
    assert not (results / "tiny").exists() or process.returncode != 3


def with_ranks(case: Path, number: int) -> Path:
    other = case.with_name(f"ranks{number}.yaml")
    other.write_text(case.read_text().replace("ranks: 1", f"ranks: {number}"))
    return other


def victims(rng: random.Random, count: int) -> list[str]:
    """As many kills of each kind, in random order."""
    kinds = ["driver", "liggghts", *(["rank"] if CORES > 1 else [])]
    chosen = [kinds[i % len(kinds)] for i in range(count)]
    rng.shuffle(chosen)
    return chosen


def kills_change_nothing(tiny: Path, tmp_path: Path, seconds: float, kills: int, longest: float) -> None:
    rng, case = random.Random(kills), longer(tiny, seconds)
    run(read_case(case), tmp_path / "unbroken")
    results = copied(tmp_path / "unbroken", tmp_path / "results")
    done = 0
    for victim in victims(rng, kills):
        killed(with_ranks(case, 2) if victim == "rank" else case, results, rng, victim, longest)
        assert not (results / "tiny").exists(), "it was over before it was killed: make it longer"
        now = len(segments(results)) if list((results / ".store").glob("produce-*/segment-*/")) else 0
        assert now >= done
        done = now
    run(read_case(case), results)
    one, other = segments(tmp_path / "unbroken"), segments(results)
    assert len(one) == len(other)
    assert_statistically_equal(one, other, start=0.2 * seconds)


def test_killed_twice_a_run_ends_as_if_unbroken(tiny: Path, tmp_path: Path) -> None:
    kills_change_nothing(tiny, tmp_path, seconds=2.4, kills=2, longest=1.0)


@pytest.mark.slow
def test_killed_some_twenty_times_a_run_ends_as_if_unbroken(tiny: Path, tmp_path: Path) -> None:
    kills_change_nothing(tiny, tmp_path, seconds=16, kills=21, longest=0.8)


def test_an_ended_run_leaves_no_process(tiny: Path, tmp_path: Path) -> None:
    """Interrupted while it fills the vessel, on two ranks where there are two cores."""
    results = tmp_path / "results"
    process = start(with_ranks(tiny, min(2, CORES)), results)
    while not ranks(results):
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 130
    assert all_gone(results)
    assert not list((results / ".store").glob("*.part")) or not list((results / ".store").glob(".settle*.part"))


def test_after_a_resume_the_plate_is_where_it_would_have_been(tiny: Path, tmp_path: Path) -> None:
    results, rng = tmp_path / "results", random.Random(1)
    killed(tiny, results, rng, "driver", 0.3, after=3)
    outcome, _ = run(read_case(tiny), results)
    dem = make_plan(read_case(outcome.folder / "case.yaml").case).dem
    last = sorted(chain(results).glob("segment-*/"))[-1]
    snapshot = read_snapshot(last / "snapshot.bin", DUMP_COLUMNS)
    plate = dem.plate_z - dem.plate_speed * dem.time_step * snapshot.step
    lowest = (snapshot.position[:, 2] - snapshot.radius).min()
    assert lowest == pytest.approx(plate, abs=0.05 * 2 * snapshot.radius.max())


@pytest.mark.slow
def test_free_discharge_resumes_with_its_balance(tiny: Path, tmp_path: Path) -> None:
    """What the catcher has counted before is not counted again; the balance is checked at every row."""
    text = tiny.read_text().replace("wall: [[6, 10], [6, 0]]", "wall: [[6, 10], [6, 6], [5, 0]]")
    tiny.write_text(
        text.replace("diameter: 2 cm", "diameter: 1.4 cm").replace("{max_time: 1.2 s", "{outlet: open, max_time: 0.6 s")
    )
    results = tmp_path / "results"
    killed(tiny, results, random.Random(2), "driver", 0.5, after=12)
    _, stages = run(read_case(tiny), results)
    assert any(stage.startswith("produce: continues after segment") for stage in stages)
    assert len(segments(results)) == make_plan(read_case(tiny).case).dem.segments


def test_during_a_run_a_second_one_and_a_clean_are_refused_and_touch_nothing(tiny: Path, tmp_path: Path) -> None:
    tiny.write_text(tiny.read_text().replace("max_time: 1.2 s", "max_time: 3 s"))  # the others need a second to begin
    results = tmp_path / "results"
    first = start(tiny, results)
    wait_for(".store/produce-*/segment-00002", results)
    others = (
        ("run", str(tiny), r"another granpipe \(process \d+ on .*\) is running tiny"),
        ("clean", "a run uses this store"),
    )
    for *arguments, words in others:
        command = [sys.executable, "-m", "granpipe", *arguments, "--results", str(results)]
        refused = subprocess.run(command, capture_output=True, text=True, check=False)
        assert first.poll() is None, "it was over before: make it longer"
        assert (refused.returncode, bool(re.search(words, refused.stderr))) == (3, True), refused.stderr
    _, said = first.communicate(timeout=60)
    assert first.returncode in (0, 4), said
    assert len(segments(results)) == make_plan(read_case(tiny).case).dem.segments
    _, stages = run(read_case(tiny), results)
    assert stages == []  # the results are whole: nothing is left to do


# --- LIGGGHTS' own ways to fail --------------------------------------------------------------------------------------


def test_liggghts_own_error_reaches_the_user(tmp_path: Path) -> None:
    (tmp_path / "bad.in").write_text("units si\nno_such_command 1\n")
    with Liggghts("bad.in", tmp_path, 1, {}) as process, pytest.raises(RunError, match="Unknown command"):
        list(process.wait())


def test_a_deck_that_ends_early_is_no_success(tmp_path: Path) -> None:
    (tmp_path / "short.in").write_text("units si\n")
    with Liggghts("short.in", tmp_path, 1, {}) as process, pytest.raises(RunError, match="end of its deck"):
        list(process.wait())


def test_output_without_end_is_cut_off(tmp_path: Path) -> None:
    """The cap must leave room for the MPI library's own shared files of some megabytes."""
    (tmp_path / "loop.in").write_text('label a\nprint "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"\njump SELF a\n')
    with (
        Liggghts("loop.in", tmp_path, 1, {}, Limits(file_bytes=64_000_000)) as process,
        pytest.raises(RunError, match="outgrew its cap"),
    ):
        list(process.wait())
    assert (tmp_path / "output.txt").stat().st_size <= 64_000_000
