"""How many cores this process may keep busy."""

from __future__ import annotations

import os

VARIABLE = "GRANPIPE_CORES"
"""Environment variable by which whoever runs several granpipes side by side gives each its share."""


def usable_cores() -> int:
    """The share that this process was given; all cores that the system lets it use unless it was given one."""
    share = os.environ.get(VARIABLE, "")
    return int(share) if share.isdecimal() and int(share) > 0 else len(os.sched_getaffinity(0))
