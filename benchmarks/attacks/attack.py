"""One attack: hostile input to granpipe, what is right stated beforehand, and a judge of what became of it."""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import resource
import select
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from granpipe.cli import QUALITY_FAILED, main

SECONDS = 60
"""Processor time of one attack [s] beyond which it hangs."""

WAITING = 6
"""How much longer than its processor time an attack may take on a busy machine."""

Verdict = Literal["refused", "marked", "told", "right", "WRONG", "TRACEBACK", "HANG", "WARNING", "UNCLEAR"]
HELD: tuple[Verdict, ...] = ("refused", "marked", "told", "right")
"""Verdicts of attacks that granpipe held: each as it was stated to be right."""

PRELOADED = (
    "granpipe.pipeline.run",
    "granpipe.pipeline.closing",
    "granpipe.pipeline.drawing",
    "granpipe.pipeline.fluid_field",
    "granpipe.pipeline.hybrid_field",
    "granpipe.pipeline.plan_picture",
    "granpipe.pipeline.results",
    "granpipe.planning.text",
    "granpipe.planning.vessel_text",
    "granpipe.study.recommend",
    "ezdxf.bbox",
    "ezdxf.path",
    "scipy.interpolate",
    "scipy.spatial",
    "shapely",
    "skfem",
)
"""Modules that commands import when they run."""

_END: dict[int, Verdict] = {2: "refused", 3: "refused", QUALITY_FAILED: "marked"}

Check = Callable[[Path, str], str]
"""The attack's folder and the output → what is wrong; empty where nothing is."""


@dataclass(frozen=True)
class Right:
    """What is right: how granpipe ends, and what it says.

    Parameters
    ----------
    verdicts : any of them is right
    words : regular expressions, each of which the output matches
    check : of a result with status 0, by a truth that does not come from granpipe
    """

    verdicts: tuple[Verdict, ...]
    words: tuple[str, ...] = ()
    check: Check | None = None


def refused(*words: str) -> Right:
    """Status 2 or 3 with a message of these words."""
    return Right(("refused",), words)


def marked(*words: str) -> Right:
    """Status 4 with a gate of these words."""
    return Right(("marked",), words)


def told(*words: str, check: Check | None = None) -> Right:
    """Status 0 with a note of these words; where there is a check, the values are right, too."""
    return Right(("told",), words, check)


def right(check: Check, *words: str) -> Right:
    """Status 0 and right values."""
    return Right(("right",), words, check)


def not_wrong(*words: str, check: Check | None = None) -> Right:
    """Refused or marked with these words; where there is a check, also right."""
    return Right(("refused", "marked", *(("right",) if check else ())), words, check)


@dataclass(frozen=True)
class Ran:
    """How granpipe ended: its status (None: it hung) and all that it printed."""

    status: int | None
    output: str


@dataclass(frozen=True)
class Attack:
    """One attack.

    Parameters
    ----------
    kind : rows of the table of counts
    name : unique in its module
    act : does it, in a folder of its own
    right : what is right
    pinned : cheap and typical: tried by the quick tests, too
    """

    kind: str
    name: str
    act: Callable[[Path], Ran]
    right: Right
    pinned: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of an attack: the verdict and why, and how long it took [s]."""

    attack: Attack
    verdict: Verdict
    why: str
    seconds: float

    @property
    def held(self) -> bool:
        """Whether it ended in what was stated to be right."""
        return self.verdict in HELD


def try_attack(attack: Attack, folder: Path) -> Outcome:
    """Do an attack in an empty folder and judge it; the folder is deleted where it was held."""
    folder.mkdir(parents=True)
    start = time.monotonic()
    ran = attack.act(folder)
    outcome = Outcome(attack, *judge(attack.right, folder, ran), time.monotonic() - start)
    if outcome.held:
        shutil.rmtree(folder, ignore_errors=True)
    return outcome


def judge(what: Right, folder: Path, ran: Ran) -> tuple[Verdict, str]:
    """The verdict and why."""
    output = ran.output.strip()
    if ran.status is None:
        return "HANG", output
    if "Traceback (most recent call last)" in output or ran.status not in (0, *_END):
        return "TRACEBACK", f"status {ran.status}: {output}"
    if re.search(r"\w+Warning: ", output):
        return "WARNING", output
    verdict: Verdict = _END.get(ran.status, "told" if "told" in what.verdicts else "right")
    if verdict not in what.verdicts:
        return ("WRONG" if ran.status == 0 else "UNCLEAR"), f"status {ran.status}, right: {what.verdicts}: {output}"
    if missing := [word for word in what.words if not re.search(word, output)]:
        return ("WRONG" if ran.status == 0 else "UNCLEAR"), f"does not say {missing}: {output}"
    if ran.status == 0 and what.check is not None:
        try:
            wrong = what.check(folder, output)
        except Exception as error:  # whatever a wrong result makes it stumble over
            wrong = f"cannot be checked: {error!r}"
        if wrong:
            return "WRONG", f"{wrong}: {output}"
    return verdict, output


def granpipe(
    *arguments: str, files: Mapping[str, str | bytes | Callable[[Path], object]] | None = None
) -> Callable[[Path], Ran]:
    """An act: write files into the folder (text, bytes, or what makes them there) and start granpipe in it."""

    def act(folder: Path) -> Ran:
        for name, content in (files or {}).items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if callable(content):
                content(path)
            else:
                path.write_bytes(content.encode() if isinstance(content, str) else content)
        return run(arguments, folder)

    return act


def run(arguments: tuple[str, ...], folder: Path, seconds: int = SECONDS) -> Ran:
    """Granpipe in a child of this process, which has imported it already; bounded in time."""
    return forked(lambda: _status_of(lambda: main(list(arguments), prog_name="granpipe")), folder, seconds)


def forked(work: Callable[[], int], folder: Path, seconds: int = SECONDS) -> Ran:
    """Work in a child of this process, in a folder; bounded in time. Its status is what `work` returns."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _child(work, folder, writing, seconds)
    os.close(writing)
    return watched(child, reading, seconds)


def watched(child: int, reading: int, seconds: int) -> Ran:
    """The end of a child that leads a session of its own, and what comes through a pipe until nobody writes to it."""
    output, end = b"", time.monotonic() + WAITING * seconds
    while select.select([reading], [], [], max(0.0, end - time.monotonic()))[0]:
        some = os.read(reading, 65536)
        if not some:
            break
        output += some
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    os.close(reading)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    hung = status in (-signal.SIGXCPU, -signal.SIGKILL)
    return Ran(None if hung else status, output.decode(errors="replace"))


def _child(work: Callable[[], int], folder: Path, writing: int, seconds: int) -> None:
    """What the child does; never returns."""
    status = 99
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(writing, 1)
        os.dup2(writing, 2)
        os.close(writing)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        import sys

        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        warnings.resetwarnings()
        warnings.showwarning = warnings._showwarning_orig  # type: ignore[attr-defined]  # a test may collect them
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        warnings.filterwarnings("ignore", category=PendingDeprecationWarning)
        status = work()
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(status)


def _status_of(command: Callable[[], object]) -> int:
    """The status with which a command ends."""
    try:
        command()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def unique(attacks: list[Attack]) -> list[Attack]:
    """The same attacks; a name that stands twice in a kind is a fault of the module."""
    names = [f"{attack.kind}: {attack.name}" for attack in attacks]
    assert len(set(names)) == len(names), sorted({name for name in names if names.count(name) > 1})
    return attacks


def preload() -> None:
    """Import what commands import when they run, so that no attack has to: they are children of this process."""
    for module in PRELOADED:
        importlib.import_module(module)
