"""The programs that granpipe starts: where they are, which LIGGGHTS it is, and what Python must not import."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import granpipe
from granpipe.errors import RunError


def liggghts_version(timeout: float = 60) -> str:
    """First line that LIGGGHTS prints of itself.

    Raises
    ------
    RunError : it is missing, does not start, or does not answer within `timeout` [s]
    """
    binary = find_program("liggghts")
    command = [binary, "-in", os.devnull, "-log", "none"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        raise RunError(
            f"LIGGGHTS did not answer within {timeout:g} s: the machine is very busy, or it hangs; "
            "try: liggghts -in /dev/null -log none"
        ) from None
    except OSError as error:
        raise RunError(f"{binary} does not start: {error.strerror}") from error
    line = next((line for line in done.stdout.splitlines() if "LIGGGHTS" in line), "")
    if not line:
        raise RunError(f"{binary} does not start: {(done.stderr or done.stdout).strip()[:200]}")
    return line.strip()


def python_environment() -> dict[str, str]:
    """Environment of a Python that imports granpipe as this one does, and nothing from the folder that it works in.

    Otherwise a ``gmsh.py`` or ``random.py`` of the user's there would run in the place of the library.
    """
    root = str(Path(granpipe.__file__).parents[1])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    return os.environ | {"PYTHONSAFEPATH": "1", "PYTHONPATH": path}


def find_program(name: str) -> str:
    """Path of an installed program; RunError with the package to install where it is missing."""
    path = shutil.which(name)
    if path is None:
        package = {"liggghts": "liggghts", "mpirun": "openmpi-bin"}.get(name, name)
        raise RunError(f"{name} is not installed; run: apt-get install --no-install-recommends {package}")
    return path
