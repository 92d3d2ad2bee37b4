"""What sweeps cost beside the work itself: fluid-only points here, and as array jobs on a Slurm of two nodes.

python benchmarks/sweep.py      # as root, with Debian's Slurm (see .ci/cluster)

Writes docs/validation/benchmarks_sweep.md.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from cluster.two_nodes import two_nodes, wait_for  # noqa: E402

SWEEP = """\
name: many
case: {case}
set: {{figures: [], export: []}}
axes: [{{outline.sections.b.wall_factor: {{first: 0.5, last: 0.9, number: {number}}}}}]
chart: []
"""
PROFILE = "time: 30 min\n"


@dataclass(frozen=True)
class Cost:
    """Wall time and processor time [s] of one command and all that it started."""

    wall: float
    cpu: float

    def __str__(self) -> str:
        return f"{self.wall:.1f}, {self.cpu:.1f}"


def granpipe(folder: Path, *arguments: str, environment: Mapping[str, str] = os.environ) -> Cost:
    """Run granpipe and measure it."""
    before, begun = os.times(), time.monotonic()
    command = [sys.executable, "-m", "granpipe", *arguments]
    subprocess.run(command, cwd=folder, env=dict(environment), check=True, capture_output=True)
    wall, after = time.monotonic() - begun, os.times()
    spent = after.children_user - before.children_user + after.children_system - before.children_system
    return Cost(wall, spent)


def prepared(folder: Path, number: int) -> Path:
    """A folder with a sweep of `number` points."""
    path = folder / str(number)
    path.mkdir()
    (path / "sweep.yaml").write_text(SWEEP.format(case=ROOT / "cases" / "hopper.yaml", number=number))
    (path / "cluster.yaml").write_text(PROFILE)
    return path


def local_row(folder: Path, number: int) -> str:
    path = prepared(folder, number)
    first = granpipe(path, "sweep", "run", "sweep.yaml")
    status = granpipe(path, "sweep", "status", "sweep.yaml")
    second = granpipe(path, "sweep", "run", "sweep.yaml")
    return (
        f"| {number} | {first.wall:.1f} | {first.cpu / number:.2f} | {status} | {second} | "
        f"{files(path / 'results') / number:.1f} | {size(path / 'results') / number / 1e3:.0f} |"
    )


def queue_row(folder: Path, number: int) -> str:
    """On nodes that take no jobs: all that is asked of Slurm, while the queue is full."""
    path = prepared(folder / "queue", number)
    with two_nodes(folder / f"drained-{number}") as cluster:
        for node in ("n1", "n2"):
            cluster.run("scontrol", "update", f"NodeName={node}", "State=DRAIN", "Reason=benchmark")
        submit, status, again, cancel = (
            granpipe(path, "sweep", command, "sweep.yaml", *more, environment=cluster.environment)
            for command, *more in (("run", "--on", "slurm"), ("status",), ("run", "--on", "slurm"), ("cancel",))
        )
    return f"| {number} | {submit} | {status} | {again} | {cancel} |"


def slurm_row(folder: Path, number: int) -> str:
    path = prepared(folder / "slurm", number)
    with two_nodes(folder / f"two-nodes-{number}") as cluster:
        begun = time.monotonic()
        granpipe(path, "sweep", "run", "sweep.yaml", "--on", "slurm", environment=cluster.environment)
        wait_for(lambda: not cluster.queue(), 3600, every=1.0)
        wall = time.monotonic() - begun
        text = (path / "results" / "many" / "slurm" / "jobs.json").read_text()
    elements = sum(len(job["points"]) for job in json.loads(text)["jobs"])
    log = "".join(file.read_text() for file in path.glob("results/many/slurm/*/table-*.txt"))
    assert f"{number} points: {number} done" in log, log
    return f"| {number} | {elements} | {wall:.1f} |"


def alone(folder: Path) -> Cost:
    """One point as a run of its own, which starts Python anew: the mean of five."""
    changes = ["--set", "figures=[]", "--set", "export=[]"]
    case = str(ROOT / "cases" / "hopper.yaml")
    costs = [granpipe(folder, "run", case, *changes, "--results", f"alone-{n}") for n in range(5)]
    return Cost(sum(cost.wall for cost in costs) / 5, sum(cost.cpu for cost in costs) / 5)


def files(folder: Path) -> int:
    return sum(1 for path in folder.rglob("*") if path.is_file())


def size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def processor() -> str:
    found = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
    return found[1] if found else platform.processor()


def measure(parts: list[str], numbers: list[int]) -> dict[str, list[str]]:
    """Part of the page → its rows."""
    folder = Path(tempfile.mkdtemp(prefix="sweep-"))
    for part in ("queue", "slurm"):
        (folder / part).mkdir()
    try:
        found = {}
        if "local" in parts:
            single = alone(folder)
            found["alone"] = [f"{single.wall:.1f} s of wall time and {single.cpu:.2f} s of processor time"]
            found["local"] = [local_row(folder, number) for number in numbers]
        if "queue" in parts:
            found["queue"] = [queue_row(folder, number) for number in numbers]
        if "slurm" in parts:
            found["slurm"] = [slurm_row(folder, number) for number in numbers]
        return found
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[100, 1000])
    parser.add_argument(
        "--parts", nargs="+", default=["local", "queue", "slurm"], help="measure these, keep the others"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "validation" / "benchmarks_sweep.md")
    options = parser.parse_args()
    kept = ROOT / "results" / "benchmarks_sweep.json"
    rows = json.loads(kept.read_text()) if kept.exists() else {}
    rows |= measure(options.parts, options.points)
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps(rows))
    options.out.write_text(page(rows))


def page(rows: Mapping[str, list[str]]) -> str:
    text = f"""\
# What a sweep costs beside its work

Made by `benchmarks/sweep.py` on {date.today()}: {os.cpu_count()} cores, {processor()}, shared with other work: wall
times are upper bounds. Points of `cases/hopper.yaml` without pictures and export files, each with another wall factor.
"""
    if "local" in rows:
        text += f"""
## On this machine

A run of its own takes {rows["alone"][0]}, most of it for
starting Python and importing what it needs; a worker that takes up to 25 points does that once. Where two numbers
stand, they are wall time and processor time; files and kB are those of one point.

| points | wall time [s] | processor time for each [s] | `granpipe sweep status` [s] | second call [s] | files | kB |
|---|---|---|---|---|---|---|
{chr(10).join(rows["local"])}
"""
    if "queue" in rows:
        text += f"""
## Asking Slurm, all points waiting in the queue

Wall time and processor time. Submitting checks and plans every point first.

| points | submitting [s] | `granpipe sweep status` [s] | second call [s] | `granpipe sweep cancel` [s] |
|---|---|---|---|---|
{chr(10).join(rows["queue"])}
"""
    if "slurm" in rows:
        text += f"""
## By array jobs, on a Slurm of two nodes of one core each on this machine

| points | elements | until the table is there [s] |
|---|---|---|
{chr(10).join(rows["slurm"])}
"""
    return text


if __name__ == "__main__":
    main()
