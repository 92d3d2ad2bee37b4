"""The programs that granpipe starts: where they are, and which LIGGGHTS it is."""

from __future__ import annotations

import os
import shutil
import subprocess

from granpipe.errors import RunError


def liggghts_version(timeout: float = 10) -> str:
    """First line that LIGGGHTS prints of itself; RunError where it is missing or does not start."""
    binary = find_program("liggghts")
    done = subprocess.run(
        [binary, "-in", os.devnull, "-log", "none"], capture_output=True, text=True, timeout=timeout, check=False
    )
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
