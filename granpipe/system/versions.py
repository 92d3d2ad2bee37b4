"""Versions of the programs that results depend on; part of every key."""

from __future__ import annotations

import json
import platform
import shutil
from importlib.metadata import version
from pathlib import Path

from granpipe.errors import DataError
from granpipe.system.files import write_whole
from granpipe.system.jsonfile import read_json
from granpipe.system.programs import liggghts_version


def library_versions() -> dict[str, str]:
    """Python and the libraries that shape numbers."""
    names = ("numpy", "scipy", "gmsh", "scikit-fem", "pymetis")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def program_versions(cache: Path) -> dict[str, str]:
    """gmsh and LIGGGHTS; asking LIGGGHTS takes half a second, so the answer is kept beside the store.

    The answer holds for one binary: its path, size and time of change.

    Raises
    ------
    RunError : LIGGGHTS does not start
    """
    binary = shutil.which("liggghts")
    state = Path(binary).stat() if binary else None
    identity = f"{binary} {state.st_size} {state.st_mtime_ns}" if state else ""
    known = _known(cache)
    if not identity or identity not in known:
        known = {identity: liggghts_version()}
        cache.parent.mkdir(parents=True, exist_ok=True)
        write_whole(cache, json.dumps(known))
    return {"gmsh": version("gmsh"), "liggghts": known[identity]}


def _known(cache: Path) -> dict[str, str]:
    try:
        return read_json(cache, dict[str, str])
    except DataError:
        return {}
