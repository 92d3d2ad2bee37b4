"""The programs that granpipe starts: where they are, and which LIGGGHTS it is."""

from __future__ import annotations

import os
import shutil
import subprocess

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


def find_program(name: str) -> str:
    """Path of an installed program; RunError with the package to install where it is missing."""
    path = shutil.which(name)
    if path is None:
        package = {"liggghts": "liggghts", "mpirun": "openmpi-bin"}.get(name, name)
        raise RunError(f"{name} is not installed; run: apt-get install --no-install-recommends {package}")
    return path
