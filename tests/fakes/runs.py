"""Runs of granpipe as tests start, watch and compare them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from granpipe.case.reader import CaseFile
from granpipe.field import level_flow
from granpipe.homogenize.average import Sums
from granpipe.pipeline.run import Outcome, run_case
from granpipe.progress import Silent


class Stages(Silent):
    """Remembers which stages were worked and which were found done."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def stage(self, name: str, detail: str = "") -> None:
        self.seen.append(f"{name}: {detail}" if detail else name)


def run(file: CaseFile, results: Path) -> tuple[Outcome, list[str]]:
    """Run a case in this process; the stages as they were announced."""
    stages = Stages()
    return run_case(file, results, stages), stages.seen


def start(case: Path, results: Path, **environment: str) -> subprocess.Popen[str]:
    """Run a case in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "granpipe", "run", str(case), "--results", str(results)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
        preexec_fn=listen_to_interrupts,
    )


def listen_to_interrupts() -> None:
    """A shell starts background jobs deaf to SIGINT, and the test run may be one."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def wait_for(pattern: str, folder: Path, timeout: float = 120) -> Path:
    """The first path that matches, once there is one."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if found := sorted(folder.glob(pattern)):
            return found[0]
        time.sleep(0.02)
    raise AssertionError(f"no {pattern} in {folder} within {timeout} s")


def running_below(folder: Path) -> dict[int, str]:
    """Processes that work below a folder, with their commands."""
    found = {}
    for link in Path("/proc").glob("[0-9]*/cwd"):
        try:
            if link.readlink().is_relative_to(folder):
                command = (link.parent / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                found[int(link.parent.name)] = command
        except OSError:
            continue
    return found


def all_gone(folder: Path, timeout: float = 15) -> bool:
    """Whether no process works below a folder any more, soon."""
    end = time.monotonic() + timeout
    while running_below(folder) and time.monotonic() < end:
        time.sleep(0.05)
    return not running_below(folder)


def chain(results: Path) -> Path:
    """The folder of the one production below a results folder."""
    (found,) = (results / ".store").glob("produce-*/")
    return found


def segments(results: Path) -> list[Sums]:
    """The sums of all segments, which must be numbered without a gap and follow each other in time from 0."""
    folders = sorted(chain(results).glob("segment-*/"))
    assert [int(folder.name[-5:]) for folder in folders] == list(range(1, len(folders) + 1))
    sums = [Sums.load(folder / "sums.npz") for folder in folders]
    np.testing.assert_allclose([s.start for s in sums], [0.0, *(s.stop for s in sums[:-1])], rtol=1e-12)
    return sums


def assert_statistically_equal(one: list[Sums], other: list[Sums], start: float) -> None:
    """Mean flow and mean packing of two runs agree within four standard errors of what the segments scatter.

    Neighbouring segments hang together, so five of them make one block.
    """
    for figure in (_flow, _packing):
        means, errors = [], []
        for parts in (one, other):
            values = np.array([figure(part) for part in parts if part.start >= start - 1e-9])
            blocks = values[: len(values) // 5 * 5].reshape(-1, 5).mean(axis=1)
            means.append(values.mean())
            errors.append(blocks.std(ddof=1) / np.sqrt(len(blocks)))
        assert abs(means[0] - means[1]) <= 4 * np.hypot(*errors), (figure.__name__, means, errors)


def _flow(part: Sums) -> float:
    return float(level_flow(part.mean_flux[1], part.grid).mean())


def _packing(part: Sums) -> float:
    return float(part.mean_volume.sum())
