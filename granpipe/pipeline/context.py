"""The settings and services that every stage of a run shares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from granpipe.progress import Progress
from granpipe.system.store import Store


@dataclass(frozen=True)
class Context:
    """Where stages are kept, what they depend on beside the case, whom they report to, and the cores they may use.

    Parameters
    ----------
    store : folders of finished stages
    versions : name → version of each program and library that results depend on
    progress : receiver of progress reports
    cores : how many cores this run may keep busy
    """

    store: Store
    versions: Mapping[str, str]
    progress: Progress
    cores: int
