"""Sweeps on this machine: worker processes, one store, what fails and what is killed."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from granpipe.sweep.folder import Folder

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"

FLUID = f"""\
name: walls
case: {HOPPER}
set: {{figures: [], export: []}}
axes:
  - outline.sections.b.wall_factor: {{first: 0.5, last: 0.8, number: 4}}
points:
  wrong: {{model: hybrid, fluid.known_field: none.npz, outline.sections.c.model: dem}}
  slip: {{fluid.walls: slip}}
chart: [residual]
table: [csv, netcdf]
"""

SHORT = FLUID.replace("number: 4", "number: 2").replace("[csv, netcdf]", "[csv]").replace("[residual]", "[]")

DEM = """\
name: starts
case: tiny.yaml
axes:
  - homogenize.start: [0.3 s, 0.4 s]
chart: [bulk_packing]
"""


def granpipe(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "granpipe", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "table.csv").open(newline="") as file:
        return {row["point"]: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    root = tmp_path_factory.mktemp("sweep")
    (root / "sweep.yaml").write_text(FLUID)
    return root, granpipe(root, "sweep", "run", "sweep.yaml", "--cores", "2")


def test_one_point_that_fails_does_not_keep_the_others_from_their_end(
    swept: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    root, done = swept
    assert done.returncode == 3, done.stderr
    assert "6 points: 5 done, 1 failed" in done.stdout
    assert "fluid.known_field: none.npz cannot be read" in done.stderr
    found = rows(root / "results" / "walls")
    assert [row["status"] for row in found.values()] == ["done"] * 4 + ["failed", "done"]
    assert [row["outline.sections.b.wall_factor"] for row in found.values()][:4] == ["0.5", "0.6", "0.7", "0.8"]
    assert "figures" not in found["slip"]  # the same in every point
    assert all(float(row["residual"]) < 1e-9 for row in found.values() if row["status"] == "done")
    assert (root / "results" / "walls" / "chart.png").exists()
    assert (root / "results" / "walls" / "table.nc").exists()


def test_points_are_what_granpipe_run_makes(swept: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    root, _ = swept
    changes = ["--set", "figures=[]", "--set", "export=[]", "--set", "outline.sections.b.wall_factor=0.6"]
    done = granpipe(root, "run", str(HOPPER), *changes, "--set", "name=wall_factor-0_6", "--results", "alone")
    assert done.returncode == 0, done.stderr
    keys = [
        json.loads((root / place / "wall_factor-0_6" / "provenance.json").read_text())["key"]
        for place in ("alone", "results/walls/points")
    ]
    assert keys[0] == keys[1]


def test_a_second_call_runs_what_has_failed_and_nothing_else(
    swept: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    root, _ = swept
    done = granpipe(root, "sweep", "run", "sweep.yaml")
    assert done.returncode == 3
    assert "1 point to run" in done.stderr


def test_a_wrong_point_is_refused_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(FLUID.replace("last: 0.8", "last: 1.7"))
    done = granpipe(tmp_path, "sweep", "run", "sweep.yaml")
    assert done.returncode == 2
    assert "sweep.yaml:5 outline.sections.b.wall_factor: 1.3; must be in [0, 1] (point wall_factor-1_3)" in done.stderr
    assert not (tmp_path / "results").exists()


def test_a_dry_run_changes_nothing_of_a_sweep_that_was_run(
    swept: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    root, _ = swept
    before = {path: path.read_bytes() for path in (root / "results" / "walls").iterdir() if path.is_file()}
    (root / "other.yaml").write_text(FLUID.replace("last: 0.8", "last: 0.9"))
    done = granpipe(root, "sweep", "run", "other.yaml", "--dry-run")
    new = ["wall_factor-0_633333333333", "wall_factor-0_766666666667", "wall_factor-0_9"]
    assert done.stdout.split() == ["results/walls", *new, "wrong"]
    assert {path: path.read_bytes() for path in before} == before


def test_a_sweep_that_another_process_runs_is_refused_before_anything_is_written(
    swept: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    root, _ = swept
    folder = Folder(root / "results" / "walls")
    before = (folder.root / "points.json").read_bytes()
    (root / "other.yaml").write_text(FLUID.replace("last: 0.8", "last: 0.9"))
    with folder.started():
        done = granpipe(root, "sweep", "run", "other.yaml")
    assert done.returncode == 3
    assert done.stderr.startswith(f"granpipe: process {os.getpid()} on ")
    assert "is running results/walls already, and nothing was changed" in done.stderr
    assert (folder.root / "points.json").read_bytes() == before


def test_a_misspelt_chart_is_told_after_table_and_summary(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(SHORT.replace("chart: []", "chart: [nonsense]"))
    done = granpipe(tmp_path, "sweep", "run", "sweep.yaml")
    assert done.returncode == 3
    assert "4 points: 3 done, 1 failed\nwrote results/walls/table.csv" in done.stdout
    failed, chart = done.stderr.splitlines()[-2:]
    assert failed.startswith("wrong: ")
    assert chart.startswith("granpipe: chart: no numbers in column nonsense")


def test_a_case_in_place_of_a_sweep_is_told(tmp_path: Path) -> None:
    (tmp_path / "hopper.yaml").write_text(HOPPER.read_text())
    for command in ("status", "cancel", "table"):
        shutil.rmtree(tmp_path / "results", ignore_errors=True)
        done = granpipe(tmp_path, "sweep", command, "hopper.yaml")
        assert (done.returncode, done.stdout) == (2, "")
        assert "hopper.yaml: is a case, not a sweep; it has no study in results" in done.stderr
        (tmp_path / "results" / "hopper-study").mkdir(parents=True)
        assert "its study, results/hopper-study" in granpipe(tmp_path, "sweep", command, "hopper.yaml").stderr


def test_a_worker_that_dies_takes_one_point_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(SHORT)
    command = [sys.executable, "-m", "granpipe", "sweep", "run", "sweep.yaml", "--cores", "1"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        states = tmp_path / "results" / "walls" / "state"
        while not list(states.glob("*.json")):
            assert process.poll() is None
            time.sleep(0.01)
        first = json.loads(next(states.glob("*.json")).read_text())
        os.kill(first["pid"], signal.SIGKILL)
        output, _ = process.communicate(timeout=120)
    assert process.returncode == 3
    assert "4 points: 2 done, 2 failed" in output
    assert any("killed by signal 9" in row["remark"] for row in rows(tmp_path / "results" / "walls").values())


def test_an_interrupted_sweep_leaves_no_process_and_goes_on(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(SHORT.replace("number: 2", "number: 20"))  # long enough to be interrupted
    command = [sys.executable, "-m", "granpipe", "sweep", "run", "sweep.yaml", "--cores", "1"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        states = tmp_path / "results" / "walls" / "state"
        while not list(states.glob("*.json")):
            assert process.poll() is None
            time.sleep(0.01)
        worker = json.loads(next(states.glob("*.json")).read_text())["pid"]
        assert "told process" in granpipe(tmp_path, "sweep", "cancel", "sweep.yaml").stdout
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert not Path(f"/proc/{worker}").exists()
    assert "21 done, 1 failed" in granpipe(tmp_path, "sweep", "run", "sweep.yaml").stdout


@pytest.mark.liggghts
def test_points_share_what_they_have_in_common(tmp_path: Path, tiny_text: str) -> None:
    """Both begin at once: one makes walls, bed and production, the other waits for it, and LIGGGHTS runs once."""
    (tmp_path / "tiny.yaml").write_text(tiny_text)
    (tmp_path / "sweep.yaml").write_text(DEM)
    done = granpipe(tmp_path, "sweep", "run", "sweep.yaml", "--cores", "2")
    assert "2 points: 2 done" in done.stdout, done.stderr
    store = tmp_path / "results" / ".store"
    assert {stage: len(list(store.glob(f"{stage}-*"))) for stage in ("walls", "settle", "produce")} == {
        "walls": 1,
        "settle": 1,
        "produce": 1,
    }
    assert len(list(store.glob("produce-*/logs/*"))) == 1
    logs = "".join(path.read_text() for path in tmp_path.glob("results/starts/logs/*"))
    assert "waiting for it" in logs
