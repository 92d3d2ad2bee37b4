"""What a run needs, what is there, what a missing thing would be needed for, and how to get it.

Nothing heavy is imported: packages are looked up by their metadata, libraries are tried in processes of their own,
side by side and with a time limit.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from granpipe.errors import RunError
from granpipe.system.locks import shared
from granpipe.system.programs import liggghts_version, python_environment
from granpipe.system.surroundings import cache_folder, can_be_written, require_memory

TIMEOUT = 30.0
"""Seconds after which a program that does not answer counts as missing; on a busy machine gmsh took more than four."""

DISK_WANTED = 1e9
"""Free disk space [bytes] below which a particle run is likely to stop."""

PACKAGES = {
    "click": "the command line",
    "ezdxf": "walls from a DXF drawing",
    "gmsh": "wall surfaces for LIGGGHTS, meshes for the fluid",
    "jinja2": "LIGGGHTS decks",
    "matplotlib": "pictures on the r–z plane",
    "meshio": "mesh files",
    "numba": "averaging",
    "numpy": "everything",
    "pint": "units in the case",
    "psutil": "processes and free memory",
    "pyamg": "fields in space that conserve",
    "pydantic": "reading the case",
    "pymetis": "the fluid solve",
    "pyvista": "pictures in 3-D, VTK files",
    "pyyaml": "reading the case",
    "rich": "progress on the terminal",
    "scikit-fem": "the fluid solve",
    "scipy": "homogenizing, the fluid solve",
    "shapely": "drawings, points inside the vessel",
}
"""Every Python package that granpipe depends on, and what for."""

DEBIAN = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libXcursor.so.1": "libxcursor1",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libXrender.so.1": "libxrender1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
    "libEGL.so.1": "libegl1",
}
"""Debian's package for every shared library that Python wheels leave to the system."""

_GMSH = "import gmsh; print(gmsh.__version__)"

# Mesa's surfaceless platform, 0x31DD, is what off-screen pictures fall back on where there is no X server.
_EGL = """
import ctypes
egl = ctypes.CDLL("libEGL.so.1")
egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
egl.eglQueryString.restype = ctypes.c_char_p
display = ctypes.c_void_p(egl.eglGetPlatformDisplay(0x31DD, None, None))
assert egl.eglInitialize(display, None, None), "EGL is there, but has no surfaceless display"
print(egl.eglQueryString(display, 0x3054).decode(), egl.eglQueryString(display, 0x3053).decode())
"""


@dataclass(frozen=True)
class Finding:
    """One thing that a run may need.

    Parameters
    ----------
    name : what was looked for
    found : its version or amount; None where it is missing or does not work
    needed_for : what cannot be done without it
    remedy : how to get it, and why it did not work where that is known
    """

    name: str
    found: str | None
    needed_for: str
    remedy: str


def check(folder: Path | None = None) -> list[Finding]:
    """Look at everything; `folder` is where results would go (default: the present one)."""
    here = [_python(), *(_package(name) for name in PACKAGES), *_surroundings(folder or Path()), _cores()]
    return [*_try(*_TRIED), *here]


def findings_text(findings: Sequence[Finding]) -> str:
    """One line for each finding: what is there, or what it would be needed for and how to get it."""
    width = max(len(one.name) for one in findings)
    states = (one.found or f"missing; needed for {one.needed_for}; {one.remedy}" for one in findings)
    return "\n".join(f"{one.name:<{width}}  {state}" for one, state in zip(findings, states, strict=True))


def require(*names: str) -> None:
    """RunError if one of these does not work (names of findings: LIGGGHTS, mpirun, gmsh library, EGL library).

    To be called before a run: without EGL, for one, VTK ends the whole process when it draws, after all the work.
    """
    missing = [finding for finding in _try(*names) if finding.found is None]
    if missing:
        raise RunError(
            "; ".join(f"{one.name} is missing, needed for {one.needed_for}: {one.remedy}" for one in missing)
        )


def _try(*names: str) -> list[Finding]:
    with ThreadPoolExecutor(len(names)) as pool:
        return list(pool.map(lambda name: _TRIED[name](), names))


def _python() -> Finding:
    version = platform.python_version() if sys.version_info >= (3, 11) else None
    return Finding("Python", version, "everything", f"Python 3.11 or newer; this is {platform.python_version()}")


def _package(name: str) -> Finding:
    try:
        found = metadata.version(name)
    except metadata.PackageNotFoundError:
        found = None
    return Finding(name, found, PACKAGES[name], f"run: {sys.executable} -m pip install {name}")


def _liggghts() -> Finding:
    remedy = "run: apt-get install --no-install-recommends liggghts"
    found = None
    try:
        line = liggghts_version(TIMEOUT)
        version = re.search(r"LIGGGHTS-\S+ [\w.]+", line)
        found = version.group() if version else line
    except RunError as error:
        remedy = str(error)
    return Finding("LIGGGHTS", found, "particle runs (model: dem)", remedy)


def _mpirun() -> Finding:
    text, error = _output(["mpirun", "--version"])
    found = text.splitlines()[0] if text else None
    remedy = "run: apt-get install --no-install-recommends openmpi-bin" + (f" ({error})" if error else "")
    return Finding("mpirun", found, "particle runs on more than one core", remedy)


def _gmsh() -> Finding:
    found, error = _output([sys.executable, "-c", _GMSH])
    return Finding("gmsh library", found, "wall surfaces and meshes", _remedy(error))


def _egl() -> Finding:
    found, error = _output([sys.executable, "-c", _EGL])
    return Finding("EGL library", found, "pictures in 3-D on a machine without display", _remedy(error))


def _disk(folder: Path) -> Finding:
    free = shutil.disk_usage(folder.resolve()).free
    amount = f"{free / 1e9:.1f} GB free in {folder.resolve()}"
    found = amount if free >= DISK_WANTED else None
    return Finding("disk", found, "snapshots and results", f"{amount}; make room or choose another --results folder")


def _surroundings(folder: Path) -> list[Finding]:
    """What the place and the process bring: disk, file locks, room for libraries, a folder for their caches."""
    return [_disk(folder), _locks(folder), _address_space(), _caches()]


def _locks(folder: Path) -> Finding:
    found: str | None = "work"
    remedy = ""
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".granpipe-") as scratch, shared(Path(scratch) / "lock"):
            pass
    except OSError as error:
        found, remedy = None, f"the folder cannot be written ({error.strerror}); choose another --results folder"
    except RunError as error:
        found, remedy = None, str(error)
    return Finding("file locks", found, f"results in {folder.resolve()}, safe from other processes", remedy)


def _address_space() -> Finding:
    found: str | None = "enough"
    remedy = ""
    try:
        require_memory()
    except RunError as error:
        found, remedy = None, str(error)
    return Finding("address space", found, "the libraries of a run", remedy)


def _caches() -> Finding:
    folder = cache_folder()
    found = str(folder) if can_be_written(folder) else f"{folder} cannot be written; a temporary folder is used instead"
    return Finding("caches", found, "a quick start", "")


def _cores() -> Finding:
    return Finding("cores", str(len(os.sched_getaffinity(0))), "speed", "")


def _remedy(error: str) -> str:
    """What to install, judged by the loader's complaint."""
    library = re.search(r"(lib[\w+-]+\.so\.\d+): cannot open shared object", error)
    package = DEBIAN.get(library.group(1)) if library else None
    return f"run: apt-get install --no-install-recommends {package} ({error})" if package else error


def _output(command: list[str]) -> tuple[str | None, str]:
    """What a program prints if it succeeds, otherwise None; and the last line of its complaint."""
    try:
        done = subprocess.run(
            command,
            env=python_environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, f"{command[0]} did not answer within {TIMEOUT:g} s"
    except OSError as error:
        return None, f"{command[0]}: {error.strerror}"
    complaint = (done.stderr.strip().splitlines() or [""])[-1]
    return (done.stdout.strip() or None, complaint) if done.returncode == 0 else (None, complaint)


_TRIED: dict[str, Callable[[], Finding]] = {
    "LIGGGHTS": _liggghts,
    "mpirun": _mpirun,
    "gmsh library": _gmsh,
    "EGL library": _egl,
}
"""What is tried by running it, by the name of its finding."""
