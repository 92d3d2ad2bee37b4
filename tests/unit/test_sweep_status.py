"""How a sweep stands, told from files and the queue alone."""

import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from granpipe.errors import CaseError, DataError, RunError
from granpipe.sweep import folder as sweep_folder
from granpipe.sweep import slurm
from granpipe.sweep import status as sweep_status
from granpipe.sweep.folder import Folder, Owner, find_folder
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.jobs import cancel
from granpipe.sweep.queue import jobs_of
from granpipe.sweep.slurm import Element
from granpipe.sweep.state import Recorder, State
from granpipe.sweep.status import statuses, summary
from granpipe.sweep.variants import crossed

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"


def make_folder(root, number):
    (root / "state").mkdir(parents=True)
    shutil.copyfile(HOPPER, root / "case.yaml")
    points = [asdict(variant) for variant in crossed([{"dem.seed": [str(n) for n in range(number)]}])]
    plan = {"axes": ["dem.seed"], "chart": [], "table": ["csv"], "points": points}
    (root / "points.json").write_text(json.dumps(plan))
    return Folder(root)


@pytest.fixture
def folder(tmp_path):
    return make_folder(tmp_path / "sweep", 3)


@pytest.fixture
def queue(monkeypatch):
    """Elements of Slurm's queue by point."""
    elements = {}
    monkeypatch.setattr(sweep_status, "queued", lambda folder: elements)
    monkeypatch.setattr(slurm, "is_here", lambda: True)
    return elements


def write(folder, name, **what):
    state = replace(State.begins(folder.key(name)), **{"job": "", **what})
    state.save(folder.state_file(name))
    if state.phase == "done":
        (folder.points / name).mkdir(parents=True)
        (folder.points / name / "provenance.json").write_text("{}")


def words(folder):
    return [one.state for one in statuses(folder)]


def test_without_a_trace_a_point_is_missing(folder, queue):
    assert words(folder) == ["missing"] * 3
    assert summary(statuses(folder)) == "3 points: 3 missing"


def test_every_standing_is_told_apart(folder, queue):
    write(folder, "seed-0", phase="done", gates=("packing: 0.4, must be 0.5 to 0.68",))
    write(folder, "seed-1", stage="produce", fraction=0.4, text="3 min 10 s left")
    write(folder, "seed-2", phase="failed", error="LIGGGHTS ended with status 1")
    done, running, failed = statuses(folder)
    assert (done.state, running.state, failed.state) == ("done", "running", "failed")
    assert "packing: 0.4" in done.text
    assert "produce 40% (3 min 10 s left)" in running.text
    assert failed.text == "LIGGGHTS ended with status 1"


def test_what_was_done_for_another_case_is_missing(folder, queue):
    write(folder, "seed-0", phase="done")
    assert words(folder)[0] == "done"
    folder.case.write_text(folder.case.read_text().replace("1 m^3/h", "2 m^3/h"))
    assert words(Folder(folder.root))[0] == "missing"


def test_results_that_were_deleted_are_missing(folder, queue):
    write(folder, "seed-0", phase="done")
    shutil.rmtree(folder.points / "seed-0")
    assert words(folder)[0] == "missing"


def test_a_process_that_is_gone_has_failed(folder, queue):
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    write(folder, "seed-0", pid=process.pid)
    write(folder, "seed-1", pid=os.getpid())
    write(folder, "seed-2", pid=process.pid, host="another")
    assert words(folder) == ["failed", "running", "running"]


def test_the_queue_is_believed_for_jobs(folder, queue):
    for name in ("seed-0", "seed-1", "seed-2"):
        write(folder, name, job="7_1", host="node")
    queue["seed-0"] = Element("7_1", "RUNNING", "None")
    queue["seed-1"] = Element("7_2", "PENDING", "BeginTime")
    waiting = statuses(folder)[1]
    assert words(folder) == ["running", "waiting", "failed"]
    assert waiting.text == "job 7_2: BeginTime"


def test_an_interrupted_point_whose_job_begins_anew_has_not_failed(folder, queue):
    write(folder, "seed-0", job="7_1", phase="failed", error="interrupted")
    write(folder, "seed-1", job="7_1", phase="failed", error="no such file")
    assert words(folder)[:2] == ["failed", "failed"]
    queue["seed-0"] = queue["seed-1"] = Element("7_1", "RUNNING", "None")
    assert words(folder)[:2] == ["waiting", "failed"]


def test_without_slurm_jobs_are_what_their_files_say(folder, queue, monkeypatch):
    monkeypatch.setattr(slurm, "is_here", lambda: False)
    write(folder, "seed-0", job="7_1", host="node")
    assert words(folder)[0] == "running"


def test_later_points_of_a_running_job_wait(folder, queue):
    queue["seed-2"] = Element("7_1", "RUNNING", "None")
    assert words(folder) == ["missing", "missing", "waiting"]


def test_points_of_a_sweep_that_runs_here_wait(folder, queue):
    with folder.started():
        assert folder.owner() == Owner(socket.gethostname(), os.getpid())
        assert words(folder) == ["waiting"] * 3
    assert folder.owner() is None
    assert words(folder) == ["missing"] * 3


def test_looking_at_a_folder_writes_nothing_into_it(folder, queue):
    before = sorted(folder.root.rglob("*"))
    statuses(folder)
    assert "nothing to cancel" in cancel(folder)
    assert sorted(folder.root.rglob("*")) == before


def test_a_folder_that_another_process_runs_is_neither_taken_nor_rewritten(folder, monkeypatch):
    monkeypatch.setattr(sweep_folder, "_PATIENCE", 0.05)
    before = folder.case.read_bytes(), (folder.root / "points.json").read_bytes()
    other = Folder(folder.root, SweepInput("name: other\n", {}, beside={"axes.json": "{}"}))
    refused = pytest.raises(RunError, match=f"process {os.getpid()} on .* is running .*granpipe sweep cancel")
    with folder.started(), refused, other.started():
        pass
    assert (folder.case.read_bytes(), (folder.root / "points.json").read_bytes()) == before
    assert not (folder.root / "axes.json").exists()
    with other.started():
        assert folder.case.read_text() == "name: other\n"
        assert (folder.root / "axes.json").exists()


def test_a_glimpse_at_a_folder_does_not_keep_a_sweep_from_starting(folder, monkeypatch):
    folder.root.mkdir(exist_ok=True)
    folder._lock.touch()
    with folder._lock.open() as looking:
        fcntl.flock(looking, fcntl.LOCK_SH)
        threading.Timer(0.1, fcntl.flock, (looking, fcntl.LOCK_UN)).start()
        with folder.started():
            assert folder.owner() == Owner(socket.gethostname(), os.getpid())


def test_only_the_owner_of_the_lock_is_told_to_end(folder, queue, monkeypatch):
    told = []
    monkeypatch.setattr(os, "kill", lambda pid, number: told.append((pid, number)))
    with folder.started():
        assert cancel(folder) == f"told process {os.getpid()} to end"
        folder._lock.write_text(json.dumps({"host": "another", "pid": 7}))
        with pytest.raises(RunError, match=r"process 7 on another runs .*: cancel it there"):
            cancel(folder)
        folder._lock.write_text("")
        with pytest.raises(RunError, match="starting at this moment"):
            cancel(folder)
    folder._lock.write_text(json.dumps({"host": socket.gethostname(), "pid": 7}))  # left by one that was killed
    assert "nothing to cancel" in cancel(folder)
    assert told == [(os.getpid(), signal.SIGTERM)]


@pytest.mark.parametrize(
    ("error", "expected"), [(ProcessLookupError, "has just ended"), (PermissionError, "another user")]
)
def test_a_process_that_cannot_be_told_to_end_is_explained(folder, queue, monkeypatch, error, expected):
    def kill(pid, number):
        raise error

    monkeypatch.setattr(os, "kill", kill)
    with folder.started():
        try:
            text = cancel(folder)
        except RunError as refused:
            text = str(refused)
    assert expected in text


@pytest.mark.parametrize(
    "text",
    ["{}", "[]", "{", "3", '{"axes": [], "chart": [], "table": [], "points": []}',
     '{"axes": [], "chart": [], "table": [], "points": [{"name": "a"}]}',
     '{"axes": [], "chart": [], "table": [], "points": [{"name": "a", "changes": {"b": 1}}]}'],
)  # fmt: skip
def test_a_damaged_list_of_points_is_refused_with_a_remedy(folder, text):
    (folder.root / "points.json").write_text(text)
    with pytest.raises(DataError, match=r"points\.json: damaged .*start the sweep or study again"):
        statuses(folder)


@pytest.mark.parametrize("text", ["{}", "[]", '{"jobs": [{"job": "7"}]}', '{"jobs": [{"job": "7", "points": [1]}]}'])
def test_a_damaged_list_of_jobs_is_refused_with_a_remedy(folder, text):
    (folder.root / "slurm").mkdir()
    (folder.root / "slurm" / "jobs.json").write_text(text)
    with pytest.raises(DataError, match=r"jobs\.json: damaged \(.*\); cancel"):
        jobs_of(folder)


def test_a_case_that_is_no_text_is_refused(folder):
    folder.case.write_bytes(b"\xff\xfe")
    with pytest.raises(DataError, match=r"case\.yaml: damaged"):
        statuses(folder)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(CaseError, match=r"none: not found; give a sweep\.yaml, or the folder of a sweep or study"):
        find_folder(tmp_path / "none", tmp_path)


def test_a_thousand_points_are_told_in_less_than_two_seconds(tmp_path, queue):
    folder = make_folder(tmp_path / "sweep", 1000)
    for name in folder.variants:
        write(folder, name, phase="done")
    begun = time.process_time()
    assert summary(statuses(Folder(folder.root))) == "1000 points: 1000 done"
    assert time.process_time() - begun < 2


def test_progress_is_kept_in_the_file(tmp_path):
    path = tmp_path / "point.json"
    recorder = Recorder(path, "key")
    recorder.stage("settle", "filling")
    assert (State.load(path).stage, State.load(path).text) == ("settle", "filling")
    recorder.update(0.5, "half")
    assert State.load(path).fraction == 0.0  # too soon to write again
    recorder.failed("lost")
    assert (State.load(path).phase, State.load(path).fraction, State.load(path).error) == ("failed", 0.5, "lost")
    recorder.done(())
    assert State.load(path).phase == "done"
    assert [entry.name for entry in tmp_path.iterdir()] == ["point.json"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"key": 1, "nonsense": 2}', '{"key": "k"}'])
def test_a_damaged_file_is_no_state(tmp_path, text):
    (tmp_path / "point.json").write_text(text)
    assert State.load(tmp_path / "point.json") is None
