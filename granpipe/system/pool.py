"""The one local pool: it owns the cores of this machine and runs tasks on them side by side."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """Something that runs for a while.

    Parameters
    ----------
    name : what it is, for whoever reads a traceback
    cores : how many it keeps busy
    work : a generator that looks after it: every `next` is brief, the end of the generator is the end of the task, and
        `close` ends whatever it started
    """

    name: str
    cores: int
    work: Generator[object, None, None]


def run_together(tasks: Iterable[Task], cores: int, poll: float = 0.2) -> None:
    """Run tasks in their order, each as soon as its cores are free; return when all have ended.

    A task that wants more cores than there are runs alone. What a task raises ends the others and is raised again; so
    does KeyboardInterrupt. `tasks` is read one ahead of what runs, and may be as long as it likes.

    Parameters
    ----------
    cores : how many the tasks may keep busy together
    poll : pause between two looks at the running tasks [s]
    """
    queue = iter(tasks)
    upcoming = next(queue, None)
    running: list[Task] = []
    try:
        while running or upcoming is not None:
            while upcoming is not None and _busy([*running, upcoming], cores) <= cores:
                running.append(upcoming)
                upcoming = next(queue, None)
            running = [task for task in running if _advance(task)]
            time.sleep(poll if running else 0)
    finally:
        with contextlib.ExitStack() as ending:  # one that fails to close does not keep the others open
            for task in running:
                ending.callback(task.work.close)


def _busy(tasks: list[Task], cores: int) -> int:
    return sum(min(task.cores, cores) for task in tasks)


def _advance(task: Task) -> bool:
    """Let a task look at its work once; False when it has ended."""
    try:
        next(task.work)
    except StopIteration:
        return False
    except Exception as error:
        error.add_note(f"in {task.name}")
        raise
    return True
