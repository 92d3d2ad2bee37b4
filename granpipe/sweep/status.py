"""How a sweep stands: every point, from its files and the queue. Nothing else is asked, so it takes a moment."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from granpipe.progress import counted, duration_text
from granpipe.sweep import slurm
from granpipe.sweep.folder import Folder
from granpipe.sweep.queue import queued
from granpipe.sweep.slurm import Element
from granpipe.sweep.state import INTERRUPTED, State

PointState = Literal["done", "running", "waiting", "failed", "missing"]

QUIET = 300.0
"""A point on another machine that has not been heard of for so long is said to be quiet [s]."""


@dataclass(frozen=True)
class PointStatus:
    """How one point stands, and a line about it."""

    name: str
    state: PointState
    text: str = ""


def statuses(folder: Folder) -> list[PointStatus]:
    """Every point in order.

    Raises
    ------
    DataError : the results of a point are damaged
    """
    elements, here = queued(folder), folder.owner() is not None
    return [_status(folder, name, elements.get(name), here) for name in folder.variants]


def status_text(found: list[PointStatus]) -> str:
    """One line for each point, and the summary."""
    width = max(len(one.name) for one in found)
    lines = [f"{one.name:<{width}}  {one.state:<7}  {next(iter(one.text.splitlines()), '')}".rstrip() for one in found]
    return "\n".join([*lines, summary(found)])


def marked(folder: Folder) -> list[str]:
    """Names of the points that are done but failed a quality gate.

    Raises
    ------
    DataError : the results of a point are damaged
    """
    return [one.name for one in statuses(folder) if one.state == "done" and one.text]


def summary(found: list[PointStatus]) -> str:
    """``12 points: 3 done, 2 running, 7 waiting``."""
    counts = Counter(one.state for one in found)
    states: tuple[PointState, ...] = ("done", "running", "waiting", "failed", "missing")
    told = ", ".join(f"{counts[state]} {state}" for state in states if counts[state])
    return f"{counted(len(found), 'point')}: {told}"


def _status(folder: Folder, name: str, element: Element | None, here: bool) -> PointStatus:
    state = folder.state(name)
    if folder.is_done(name) and state is not None:
        return PointStatus(name, "done", "; ".join(f"quality gate failed: {gate}" for gate in state.gates))
    if element is not None and not element.runs:
        return PointStatus(name, "waiting", f"job {element.job}: {element.reason}")
    if element is not None and state is not None and state.error == INTERRUPTED:  # its job has begun anew
        return PointStatus(name, "waiting", f"job {element.job}: starts")
    if state is None or state.phase == "done":  # a point that comes later in its job, or of an earlier case
        waits = element is not None or here
        return PointStatus(name, "waiting" if waits else "missing", "" if waits else "run the sweep again")
    if state.phase == "failed":
        return PointStatus(name, "failed", state.error)
    if (state.job and element is None and slurm.is_here()) or (not state.job and state.process_is_gone()):
        where = f"job {state.job}" if state.job else f"process {state.pid}"
        return PointStatus(
            name, "failed", f"{where} ended without an error message (killed, or its machine lost) at {_at(state)}"
        )
    return PointStatus(name, "running", ", ".join(_running(state)))


def _running(state: State) -> Iterator[str]:
    yield _at(state)
    yield f"on {state.host} for {duration_text(time.time() - state.begun)}"
    if (quiet := time.time() - state.updated) > QUIET:
        yield f"last heard of {duration_text(quiet)} ago"


def _at(state: State) -> str:
    share = f" {state.fraction:.0%}" if state.fraction else ""
    return f"{state.stage or 'start'}{share}" + (f" ({state.text})" if state.text else "")
