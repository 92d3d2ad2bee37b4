"""How many cores this process may keep busy."""

from __future__ import annotations

import os

import psutil

VARIABLE = "GRANPIPE_CORES"
"""Environment variable by which whoever runs several granpipes side by side gives each its share."""


def usable_cores() -> int:
    """The share that this process was given; all cores that the system lets it use unless it was given one."""
    return _share() or len(os.sched_getaffinity(0))


def free_cores() -> int:
    """How many cores other processes leave to this one, at least one; its whole share where it was given one."""
    return _share() or max(1, usable_cores() - round(busy_cores()))


def busy_cores(watched: float = 0.5) -> float:
    """How many of the cores that this process may use are busy, watched for so long while it sleeps [s]."""
    usable = os.sched_getaffinity(0)
    return sum(part for core, part in enumerate(psutil.cpu_percent(watched, percpu=True)) if core in usable) / 100


def _share() -> int:
    """0 where this process was given none."""
    share = os.environ.get(VARIABLE, "")
    return int(share) if share.isdecimal() else 0
