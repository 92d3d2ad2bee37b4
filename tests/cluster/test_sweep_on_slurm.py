"""A sweep on a real Slurm of two nodes with the real LIGGGHTS: a job is killed, a node is lost, another is drained, a
time limit is hit. The sweep ends complete, and nothing is run twice.

`make test-cluster` installs what it needs. One story, told in order: each test goes on where the one before has ended.
Nothing in it hangs on the clock: a job that a test is about waits at its start until the test lets it go, and its time
limit is brought forward once it is under way.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from cluster.two_nodes import PATIENCE, TwoNodes, alive, missing, two_nodes, wait_for

pytestmark = [pytest.mark.cluster, pytest.mark.liggghts]

CASE = """\
name: column
outline:
  unit: cm
  wall: [[6, 10], [6, 0]]
material:
  density: 2000 kg/m^3
  size: {diameter: 2 cm}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 1 kg/s
model: dem
dem: {max_time: 10 s, plate_speed: 0.01 m/s, reservoir_height: 8 cm}
homogenize: {start: 2 s, method: gaussian}
figures: []
export: [comsol]
"""

SWEEP = """\
name: columns
case: column.yaml
axes:
  - contact.friction: [0.2, 0.5, 0.8]
  - homogenize.start: [2 s, 3 s]  # such two share all that LIGGGHTS does
points:
  long: {dem.seed: 2, dem.max_time: 100 s}
  lost: {dem.seed: 3, dem.max_time: 20 s}
  killed: {dem.seed: 4, dem.max_time: 20 s}
  two-ranks: {dem.seed: 5, dem.ranks: 2, dem.max_time: 5 s}
  two-more: {dem.seed: 6, dem.ranks: 2, dem.max_time: 5 s}
  wrong: {model: hybrid, fluid.known_field: none.npz, "outline.sections": {a: {z: [10, 0], model: dem}}}
chart: [solids_flow_m3_per_s]
table: [csv, netcdf]
"""
POINTS = 12
JOBS = {"long": "1_7", "lost": "1_8", "killed": "1_9"}
"""Points that something happens to → their jobs: job 1 has all that take one rank, in order."""

PROFILE = """\
time: 2 h
margin: 30 s
memory: 500 MB
partition: main
setup: [export LC_ALL=C, export OMPI_MCA_mpi_yield_when_idle=1, source {root}/hold.sh]
"""

COUNTING = """\
#!/bin/sh
# LIGGGHTS that notes each of its starts: the job, the folder and the arguments.
case "$OMPI_COMM_WORLD_RANK" in ""|0) [ "$2" = /dev/null ] || echo "$GRANPIPE_JOB $PWD $*" >>{notes} ;; esac
exec {real} "$@"
"""

HOLD = """\
# A job waits while there is a file with its name.
while [ -e {held}/"$SLURM_ARRAY_JOB_ID"_"$SLURM_ARRAY_TASK_ID" ]; do sleep 0.2; done
"""


@dataclass(frozen=True)
class Start:
    """One start of LIGGGHTS: for which job, in which folder of the store, from which segment (0: it fills)."""

    job: str
    stage: str
    segment: int


@dataclass
class Story:
    """The sweep, and what has become of it so far."""

    cluster: TwoNodes
    root: Path
    interrupted: dict[str, int] = field(default_factory=dict)
    """Point → segments that were there when it was interrupted."""

    @property
    def folder(self) -> Path:
        return self.root / "results" / "columns"

    @property
    def store(self) -> Path:
        return self.root / "results" / ".store"

    def hold(self, point: str) -> None:
        """Let the job of a point wait at its next start."""
        (self.root / "held" / JOBS[point]).touch()

    def release(self, point: str) -> None:
        """Let it go on."""
        (self.root / "held" / JOBS[point]).unlink()

    def granpipe(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "granpipe", *arguments]
        environment = self.cluster.environment | {"PATH": f"{self.root / 'bin'}:{os.environ['PATH']}"}
        return subprocess.run(
            command, cwd=self.root, env=environment, capture_output=True, text=True, check=False, timeout=PATIENCE
        )

    def sweep(self) -> str:
        done = self.granpipe("sweep", "run", "columns.yaml", "--on", "slurm")
        assert done.returncode == 0, done.stderr
        return done.stderr

    def status(self) -> dict[str, tuple[str, str]]:
        """Point → how it stands, and the remark."""
        lines = self.granpipe("sweep", "status", "columns.yaml").stdout.splitlines()[:-1]
        rows = (line.split(maxsplit=2) for line in lines)
        return {row[0]: (row[1], row[2] if len(row) > 2 else "") for row in rows}

    def nodes_at_work(self) -> set[str]:
        """Nodes on which jobs run; ``n[1-2]`` for one that has both."""
        return {node for _, state, node in self.cluster.queue() if state == "RUNNING"}

    def state(self, point: str) -> dict[str, Any]:
        file = self.folder / "state" / f"{point}.json"
        return dict(json.loads(file.read_text())) if file.exists() else {}

    def starts(self) -> list[Start]:
        found = []
        for line in (self.root / "starts").read_text().splitlines() if (self.root / "starts").exists() else []:
            job, folder, arguments = line.split(maxsplit=2)
            first = re.search(r"-var first (\d+)", arguments)
            stage = Path(folder).parent.name if first else re.sub(r"^\.|\.\d+\.part$", "", Path(folder).name)
            found.append(Start(job, stage, int(first[1]) if first else 0))
        return found

    def jobs(self) -> list[dict[str, Any]]:
        """What was submitted."""
        return list(json.loads((self.folder / "slurm" / "jobs.json").read_text())["jobs"])

    def segments(self, point: str) -> int:
        """How many segments the point's production has published; 0 before it began."""
        chains = [one.stage for one in self.starts() if one.job == self.state(point).get("job") and one.segment]
        return len(list((self.store / chains[-1]).glob("segment-*"))) if chains else 0

    def log(self, point: str) -> str:
        """What the point's job has said."""
        job = self.state(point).get("job", "none")
        return "".join(path.read_text() for path in self.folder.glob(f"slurm/*/{job}.txt"))

    def wait_for_segments(self, point: str, number: int = 2) -> None:
        """Wait until the point's production has published some segments."""

        def there() -> bool:
            assert self.state(point).get("phase") != "failed", self.log(point)
            return self.segments(point) >= number

        wait_for(there)

    def start_requeued_jobs_now(self) -> None:
        """Slurm lets a requeued job wait for two minutes; the test need not."""
        for job, state, _ in self.cluster.queue():
            if state == "PENDING":
                with contextlib.suppress(AssertionError):
                    self.cluster.run("scontrol", "update", f"JobId={job}", "StartTime=now")


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    assert not missing(), f"not installed: {missing()}; `make test-cluster` installs them"
    assert os.geteuid() == 0, "the daemons of Slurm must be started by root"
    root = tmp_path_factory.mktemp("sweep")
    real = shutil.which("liggghts")
    assert real, "LIGGGHTS is not installed"
    for name in ("bin", "held"):
        (root / name).mkdir()
    counting = root / "bin" / "liggghts"
    counting.write_text(COUNTING.format(notes=root / "starts", real=real))
    counting.chmod(0o755)
    for name, text in (("column", CASE), ("columns", SWEEP), ("cluster", PROFILE.format(root=root))):
        (root / f"{name}.yaml").write_text(text)
    (root / "hold.sh").write_text(HOLD.format(held=root / "held"))
    with two_nodes(root / "slurm") as cluster:
        told = Story(cluster, root)
        for point in JOBS:
            told.hold(point)
        yield told


def test_all_points_are_submitted_and_only_once(story: Story) -> None:
    first = story.sweep()
    assert sum(map(int, re.findall(r"(\d+) points in", first))) == POINTS
    story.cluster.run("scontrol", "hold", "2")  # two ranks take both nodes: at the end
    assert "nothing to submit" in story.sweep()
    assert {word for word, _ in story.status().values()} <= {"waiting", "running", "done"}
    (one_rank, *_) = (job for job in story.jobs() if job["job"] == "1")
    assert {point: f"1_{one_rank['points'].index([point]) + 1}" for point in JOBS} == JOBS


def test_what_runs_on_a_lost_node_goes_back_into_the_queue(story: Story) -> None:
    story.release("lost")
    story.wait_for_segments("lost")
    job = story.state("lost")["job"]
    node = next(node for one, _, node in story.cluster.queue() if one == job)
    story.cluster.run("scontrol", "update", f"NodeName={node}", "State=DOWN", "Reason=lost")
    wait_for(lambda: (job, "PENDING", "") in story.cluster.queue())
    wait_for(lambda: not alive(story.state("lost")["pid"]))
    story.interrupted["lost"] = story.segments("lost")
    assert story.status()["lost"][0] == "waiting"
    story.cluster.wait_until_up()


def test_a_job_that_is_killed_is_shown_as_failed(story: Story) -> None:
    story.release("killed")
    story.wait_for_segments("killed")
    os.kill(story.state("killed")["pid"], signal.SIGKILL)
    wait_for(lambda: story.state("killed")["job"] not in [job for job, _, _ in story.cluster.queue()])
    story.interrupted["killed"] = story.segments("killed")
    word, remark = story.status()["killed"]
    assert word == "failed"
    assert "ended without an error message" in remark


def test_a_job_at_its_time_limit_goes_on_in_the_queue(story: Story) -> None:
    story.release("long")
    story.wait_for_segments("long")
    story.hold("long")  # from its second start on
    spent = story.cluster.run("squeue", f"--jobs={JOBS['long']}", "--noheader", "--format=%M").strip()
    minutes = sum(int(text) * size for text, size in zip(spent.split(":")[::-1][1:], (1, 60), strict=False))
    story.cluster.run("scontrol", "update", f"JobId={JOBS['long']}", f"TimeLimit={minutes + 1}")
    wait_for(lambda: "near its time limit, goes on in the queue" in story.log("long"))
    story.cluster.run("scontrol", "update", f"JobId={JOBS['long']}", "TimeLimit=120")
    story.interrupted["long"] = story.segments("long")
    assert story.interrupted["long"] > 0
    wait_for(lambda: story.status()["long"][0] in ("waiting", "running"))


def test_a_drained_node_takes_no_jobs_and_the_sweep_goes_on(story: Story) -> None:
    def begun_again() -> bool:
        story.start_requeued_jobs_now()
        return any(job == JOBS["long"] and state == "RUNNING" for job, state, _ in story.cluster.queue())

    wait_for(begun_again, every=1)
    node = next(node for job, _, node in story.cluster.queue() if job == JOBS["long"])
    other = "n2" if node == "n1" else "n1"
    story.cluster.run("scontrol", "update", f"NodeName={other}", "State=DRAIN", "Reason=upkeep")
    wait_for(lambda: story.cluster.node_states()[other] == "drained")  # what runs on it ends in peace
    story.release("long")
    wait_for(lambda: story.state("long")["phase"] == "running")
    story.wait_for_segments("long", story.interrupted["long"] + 1)
    assert story.nodes_at_work() == {node}
    story.cluster.run("scontrol", "update", f"NodeName={other}", "State=RESUME")


def test_a_second_call_submits_what_has_failed_and_nothing_else(story: Story) -> None:
    wait_for(lambda: story.status()["wrong"][0] == "failed")
    submitted = story.sweep()
    assert sum(map(int, re.findall(r"(\d+) points in", submitted))) == 2
    assert {point for line in story.jobs()[-1]["points"] for point in line} == {"killed", "wrong"}


def test_the_sweep_ends_complete(story: Story) -> None:
    story.cluster.run("scontrol", "release", "2")

    def ended() -> bool:
        story.start_requeued_jobs_now()
        return not story.cluster.queue()

    wait_for(ended, seconds=4 * PATIENCE, every=3)
    standing = story.status()
    assert Counter(word for word, _ in standing.values()) == {"done": POINTS - 1, "failed": 1}
    assert "none.npz cannot be read" in standing["wrong"][1]


def test_nothing_was_run_twice(story: Story) -> None:
    """Each bed was filled once; each production began once, and went on once for each time that it was interrupted."""
    starts = Counter(start.stage for start in story.starts())
    again = sum(starts.values()) - len(starts)
    logs = "".join(path.read_text() for path in story.folder.glob("slurm/*/*_*.txt"))
    assert again == logs.count("goes on in the queue") + 2  # the lost and the killed
    assert len([stage for stage in starts if stage.startswith("produce-")]) == 8  # 3 frictions, 5 more seeds
    assert len([stage for stage in starts if stage.startswith("settle-")]) >= 8  # a bed that is too soft is filled anew
    assert len(list(story.store.glob("walls-*"))) <= 4  # one for each travel of the plate


@pytest.mark.parametrize("point", ["lost", "killed", "long"])
def test_an_interruption_costs_no_more_than_the_running_segment(story: Story, point: str) -> None:
    chain = {one.stage for one in story.starts() if one.segment and one.job == story.state(point)["job"]}
    first = [one.segment for one in story.starts() if one.stage in chain]
    assert story.interrupted[point] + 1 in first


def test_the_table_holds_every_point(story: Story) -> None:
    reduced = sorted(story.folder.glob("slurm/*/table-*.txt"))
    assert f"{POINTS} points: {POINTS - 1} done, 1 failed" in reduced[-1].read_text()
    with (story.folder / "table.csv").open(newline="") as file:
        rows = {row["point"]: row for row in csv.DictReader(file)}
    assert len(rows) == POINTS
    flows = [float(row["solids_flow_m3_per_s"]) for row in rows.values() if row["status"] == "done"]
    plate = 3.1416 * 0.06**2 * 0.01  # m³/s; of it the bed's packing is solid
    assert flows == pytest.approx([0.55 * plate] * len(flows), rel=0.3)
    assert (story.folder / "chart.png").stat().st_size > 1000
    assert (story.folder / "table.nc").stat().st_size > 1000


def test_a_point_that_is_done_is_told_again_without_a_run(story: Story) -> None:
    """How long granpipe itself takes for it is measured in benchmarks/sweep.py."""
    starts = len(story.starts())
    (story.folder / "state" / "two-more.json").unlink()
    done = story.granpipe("sweep", "points", str(story.folder), "two-more")
    assert done.returncode == 0, done.stderr
    assert story.status()["two-more"][0] == "done"
    assert len(story.starts()) == starts


def test_a_sweep_is_cancelled(story: Story) -> None:
    for node in ("n1", "n2"):
        story.cluster.run("scontrol", "update", f"NodeName={node}", "State=DRAIN", "Reason=test")
    assert "1 point in 1 element" in story.sweep()
    assert "cancelled jobs" in story.granpipe("sweep", "cancel", "columns.yaml").stdout
    wait_for(lambda: not story.cluster.queue())
    assert story.status()["wrong"][0] == "failed"
