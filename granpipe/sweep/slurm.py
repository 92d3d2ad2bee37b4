"""Slurm by its own commands: scripts that a user can read, `sbatch`, `squeue`, `scancel`. No accounting is needed."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granpipe.errors import RunError
from granpipe.system.templates import templates

PATIENCE = 60.0
"""How long a command of Slurm may take [s]."""

_PLAIN_PATH = re.compile(r"[A-Za-z0-9_./+@=,-]+")

ACTIVE = {"PENDING", "RUNNING", "COMPLETING", "CONFIGURING", "SUSPENDED", "REQUEUED", "REQUEUE_HOLD", "STOPPED"}
"""States of a job that is still to run, or running."""


@dataclass(frozen=True)
class Element:
    """A job of an array, as `squeue` sees it: `job` as ``123_4``, or ``123`` for a job that is no array's."""

    job: str
    state: str
    reason: str

    @property
    def runs(self) -> bool:
        """Whether it is at work now."""
        return self.state in {"RUNNING", "COMPLETING"}


def script(name: str, values: dict[str, Any]) -> str:
    """A batch script from a template; every value is either a number or matches a strict pattern."""
    return templates(keep_trailing_newline=True).get_template(name).render(values)


def plain_path(path: Path) -> str:
    """The absolute path as text that is safe in a batch script; RunError otherwise."""
    text = str(path.absolute())
    if not _PLAIN_PATH.fullmatch(text):
        raise RunError(
            f"{text}: on a cluster the path may have letters, digits and _ . / + @ = , - only; use another folder"
        )
    return text


def is_here() -> bool:
    """Whether this machine can ask Slurm."""
    return shutil.which("squeue") is not None


def submit(path: Path, *options: str) -> str:
    """Submit a batch script; the id of the job.

    Raises
    ------
    RunError : Slurm does not take the jobs
    """
    return _run("sbatch", "--parsable", *options, str(path)).strip().split(";")[0]


def queue() -> list[Element]:
    """What of this user's jobs is still to run or running, element by element.

    Raises
    ------
    RunError : Slurm does not answer
    """
    lines = _run("squeue", "--me", "--array", "--noheader", "--format=%i|%T|%r").splitlines()
    rows = (line.strip().split("|", 2) for line in lines if line.count("|") >= 2)
    return [Element(*row) for row in rows if row[1] in ACTIVE]


def cancel(jobs: Iterable[str]) -> None:
    """Cancel jobs.

    Raises
    ------
    RunError : Slurm does not answer
    """
    for some in _several(list(jobs), 200):
        _run("scancel", *some)


def largest_array() -> int:
    """How many elements an array may have.

    Raises
    ------
    RunError : Slurm does not answer
    """
    found = re.search(r"MaxArraySize\s*=\s*(\d+)", _run("scontrol", "show", "config"))
    return max(1, int(found[1]) - 1) if found else 1000


def _several(items: Sequence[str], size: int) -> Iterator[Sequence[str]]:
    return (items[at : at + size] for at in range(0, len(items), size))


def _run(program: str, *arguments: str) -> str:
    if shutil.which(program) is None:
        raise RunError(f"{program} is not here: this machine is not of a Slurm cluster; leave out --on slurm")
    command = [program, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise RunError(f"{program} did not answer in {PATIENCE:g} s; is the cluster up? try `sinfo`") from None
    if done.returncode != 0:
        raise RunError(f"{program} failed: {(done.stderr or done.stdout).strip()[-500:]}")
    return done.stdout
