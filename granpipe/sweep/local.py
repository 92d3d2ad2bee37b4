"""The points of a sweep on this machine: worker processes, as many as the cores allow.

Points with particles get a worker each. Without particles the work is shorter than starting Python and importing what
it needs, so a worker takes several of them.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from granpipe.errors import CaseError
from granpipe.progress import Progress, counted
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import Point
from granpipe.sweep.queue import queued
from granpipe.sweep.state import State
from granpipe.system.children import DieWithParent
from granpipe.system.cores import VARIABLE
from granpipe.system.pool import Task, run_together
from granpipe.system.programs import python_environment

CHUNK = 25
"""Points without particles that one worker takes."""

_POLL = 0.05  # s
_PATIENCE = 30.0  # s; LIGGGHTS is given time to end


def run_here(folder: Folder, points: Sequence[Point], cores: int, progress: Progress) -> None:
    """Run points in worker processes that keep at most `cores` cores busy; a point that fails is noted in its state.

    Those that a cluster has in its queue are left to it.

    Raises
    ------
    CaseError : a point needs more ranks than there are cores here
    RunError : the sweep is running elsewhere
    """
    elsewhere = queued(folder)
    points = [point for point in points if point.name not in elsewhere]
    if (most := max((point.ranks for point in points), default=0)) > cores:
        raise CaseError(f"{most} ranks, but this machine has {counted(cores, 'core')}", ("dem", "ranks"))
    ended = 0

    def attended(names: Sequence[str], ranks: int) -> Generator[None, None, None]:
        nonlocal ended
        for _ in _attend(folder, names, ranks):
            yield
        ended += len(names)
        progress.update(ended / len(points), f"{ended} of {len(points)} points")

    with interrupted_once(), folder.started():
        progress.stage(folder.name, f"{counted(len(points), 'point')} to run on {counted(cores, 'core')}")
        tasks = (Task(names[0], ranks, attended(names, ranks)) for names, ranks in batches(points, cores))
        run_together(tasks, cores, _POLL)


@contextlib.contextmanager
def interrupted_once() -> Iterator[None]:
    """The first Ctrl-C or SIGTERM ends the block; it is not disturbed by others while it cleans up."""
    handled = [one for one in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(one) != signal.SIG_IGN]

    def interrupt(*_: object) -> NoReturn:
        for one in handled:
            signal.signal(one, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = [(one, signal.signal(one, interrupt)) for one in handled]
    try:
        yield
    finally:
        for one, handler in before:
            signal.signal(one, handler)


def batches(points: Sequence[Point], cores: int, chunk: int = CHUNK) -> Iterator[tuple[list[str], int]]:
    """What one worker takes, and the ranks of its points: `auto` shares the cores among the points that there are."""
    share = max(1, cores // max(1, len(points)))
    yield from (([point.name], point.ranks or share) for point in points if point.particles)
    quick = [point.name for point in points if not point.particles]
    size = min(chunk, -(-len(quick) // cores))
    yield from ((quick[at : at + size], 1) for at in range(0, len(quick), max(1, size)))


def _attend(folder: Folder, names: Sequence[str], ranks: int) -> Iterator[None]:
    """Have workers run the points until each is done or failed: one that dies takes only the point that it was at."""
    left = list(names)
    log = folder.root / "logs" / f"{names[0]}.txt"
    log.parent.mkdir(exist_ok=True)
    while left:
        with _worker(folder, left, ranks, log) as process:
            while process.poll() is None:
                yield
        if process.returncode == 0:
            return
        reached = [name for name in left if _attended_by(folder.state(name), process.pid)]
        lost = reached[-1] if reached else left[0]
        state = folder.state(lost) or State.begins(folder.key(lost))
        if state.phase == "running" or not reached:
            error = f"its process {_how(process.returncode)}; {log} tells more"
            replace(state, phase="failed", error=error).save(folder.state_file(lost))
        left = left[left.index(lost) + 1 :]


def _attended_by(state: State | None, pid: int) -> bool:
    return state is not None and state.pid == pid


def _how(code: int) -> str:
    return f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"


@contextlib.contextmanager
def _worker(folder: Folder, names: Sequence[str], ranks: int, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A worker process that ends with the block, and with this process."""
    command = [sys.executable, "-m", "granpipe", "sweep", "points", "--ranks", str(ranks), str(folder.root), *names]
    with log.open("ab") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=python_environment() | {"OMP_NUM_THREADS": str(ranks), VARIABLE: str(ranks)},
            start_new_session=True,
            preexec_fn=DieWithParent(),
        )
    try:
        yield process
    finally:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.terminate()
            process.wait(_PATIENCE)
        process.kill()
        process.wait()
