"""How fast this machine is: rates measured once by `granpipe calibrate`, kept in the user's cache folder."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated

from pydantic import Field, PositiveInt

from granpipe.errors import DataError, RunError
from granpipe.progress import counted
from granpipe.system.files import write_whole
from granpipe.system.jsonfile import read_json
from granpipe.system.surroundings import cache_folder, can_be_written

Rate = Annotated[float, Field(gt=0, lt=1e15, allow_inf_nan=False)]

_FILE = "rates.json"

RANK_GAIN = 0.9
"""Parallel efficiency of a few ranks on idle cores."""


def machine() -> str:
    """The processor's name and how many cores the system lets this process use, whatever share of them it was given."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name}, {len(os.sched_getaffinity(0))} cores"


@dataclass(frozen=True)
class Rates:
    """Particle-steps per second of whole runs, filling and averaging included, by number of ranks; and since when."""

    made: str
    by_ranks: Annotated[dict[PositiveInt, Rate], Field(validation_alias="rates", min_length=1)]

    @property
    def text(self) -> str:
        """For the user: the rate for each number of ranks, and the machine."""
        lines = (f"{counted(n, 'rank')}: {rate:.3g} particle-steps/s" for n, rate in self.by_ranks.items())
        return "\n".join([*lines, f"saved for {machine()}"])

    def of(self, ranks: int) -> float:
        """With so many ranks; from the largest number that was measured, ranks beyond it at the usual efficiency."""
        known = max(n for n in self.by_ranks if n <= ranks)
        gain = 1.0 if known == ranks else RANK_GAIN * ranks / known
        return self.by_ranks[known] * gain


def known_rates() -> Rates | None:
    """What has been measured on this machine; None where nothing has."""
    rates = _stored(_path()).get(machine())
    return rates if rates is not None and 1 in rates.by_ranks else None


def require_place() -> None:
    """RunError where rates cannot be kept; asked before they are measured."""
    if not can_be_written(_path().parent):
        raise RunError(f"{_path().parent}: not writable; give a writable folder in XDG_CACHE_HOME")


def keep_rates(by_ranks: dict[int, float]) -> Rates:
    """Keep what has been measured today, beside what other machines with the same cache have."""
    rates, path = Rates(date.today().isoformat(), by_ranks), _path()
    known = _stored(path) | {machine(): rates}
    stored = {name: {"made": one.made, "rates": one.by_ranks} for name, one in known.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(stored, indent=1))
    return rates


def _stored(path: Path) -> dict[str, Rates]:
    """What is kept of every machine; nothing where the file is not there or damaged."""
    try:
        return read_json(path, dict[str, Rates])
    except DataError:
        return {}


def _path() -> Path:
    return cache_folder() / "granpipe" / _FILE
