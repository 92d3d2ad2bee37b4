"""The doctor: names what is there and what is missing, quickly, whatever the programs it asks do."""

import errno
import re
import shutil
import stat
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from granpipe.errors import RunError
from granpipe.system import doctor
from granpipe.system.doctor import Finding, check, require

ROOT = Path(__file__).parents[2]


def program(folder: Path, name: str, script: str) -> None:
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def bin_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder on the PATH, with programs that answer at once; a Python among them tries the libraries."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program(folder, "liggghts", 'echo "LIGGGHTS (Version LIGGGHTS-PUBLIC 3.8.0, compiled today by me)"')
    program(folder, "mpirun", 'echo "mpirun (Open MPI) 4.1.4"')
    program(folder, "python", "echo 4.13.1")
    monkeypatch.setattr(sys, "executable", str(folder / "python"))
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_every_dependency_is_looked_up() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(doctor.PACKAGES) == {re.split(r"[<>=~! ]", line)[0] for line in project["dependencies"]}


def test_setup_installs_every_library_that_the_doctor_names() -> None:
    lines = [tuple(line.split()) for line in (ROOT / ".ci/setup").read_text().splitlines()]
    assert {line for line in lines if len(line) == 2 and ".so." in line[0]} == set(doctor.DEBIAN.items())


@pytest.mark.parametrize("linked", [True, False])
def test_setup_empties_no_folder_that_is_not_its_own(tmp_path: Path, linked: bool) -> None:
    if subprocess.run([ROOT / ".ci/setup", "missing"], capture_output=True, check=True).stdout.strip():
        pytest.skip("the set-up would install packages")
    checkout, other = tmp_path / "checkout", tmp_path / "other"
    (checkout / ".ci").mkdir(parents=True)
    for name in (".ci/setup", "requirements.lock", "pyproject.toml"):
        shutil.copy(ROOT / name, checkout / name)
    if linked:
        other.mkdir()
        (checkout / ".venv").symlink_to(other)
    else:
        (checkout / ".venv").mkdir()
    (checkout / ".venv/mine").write_text("kept")
    done = subprocess.run([checkout / ".ci/setup"], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "is not emptied" in done.stderr
    assert (checkout / ".venv/mine").read_text() == "kept"


def finding(name: str, folder: Path | None = None) -> Finding:
    return next(one for one in check(folder) if one.name == name)


@pytest.mark.usefixtures("bin_folder")
def test_what_is_there_is_found_with_its_version(tmp_path: Path) -> None:
    found = {one.name: one.found for one in check(tmp_path)}
    assert found["LIGGGHTS"] == "LIGGGHTS-PUBLIC 3.8.0"
    assert found["mpirun"] == "mpirun (Open MPI) 4.1.4"
    assert found["gmsh library"] == found["EGL library"] == "4.13.1"
    assert re.match(r"\d+\.\d+", found["numpy"] or "")
    assert None not in found.values()
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]  # trying the locks leaves nothing


@pytest.mark.usefixtures("bin_folder")
def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    assert finding("file locks", tmp_path).found == "work"
    monkeypatch.setattr("fcntl.flock", unsupported)
    missing = finding("file locks", tmp_path)
    assert missing.found is None
    assert "choose a folder on another one with --results" in missing.remedy


@pytest.mark.usefixtures("bin_folder")
def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    missing = finding("file locks", tmp_path / "file")
    assert missing.found is None
    assert "choose another --results folder" in missing.remedy


@pytest.mark.usefixtures("bin_folder")
def test_too_small_an_address_space_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resource.getrlimit", lambda _: (500_000_000, -1))
    missing = finding("address space", tmp_path)
    assert missing.found is None
    assert "ulimit -v" in missing.remedy


@pytest.mark.usefixtures("bin_folder")
def test_caches_that_cannot_be_written_go_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert "a temporary folder is used instead" in str(finding("caches", tmp_path).found)


def test_missing_programs_come_with_the_package_that_holds_them(bin_folder: Path) -> None:
    (bin_folder / "liggghts").unlink()
    (bin_folder / "mpirun").unlink()
    for name, package in (("LIGGGHTS", "liggghts"), ("mpirun", "openmpi-bin")):
        missing = finding(name)
        assert missing.found is None
        assert f"install --no-install-recommends {package}" in missing.remedy


def test_programs_that_hang_or_crash_count_as_missing(bin_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TIMEOUT", 1.0)
    program(bin_folder, "liggghts", "exec /bin/sleep 30")
    program(bin_folder, "mpirun", "echo no licence >&2; exit 1")
    program(bin_folder, "python", "kill -ABRT $$")
    start = time.monotonic()
    found = {one.name: one for one in check()}
    assert time.monotonic() - start < 5
    assert found["LIGGGHTS"].found is None
    assert "did not answer within 1 s" in found["LIGGGHTS"].remedy
    assert found["mpirun"].found is None
    assert "no licence" in found["mpirun"].remedy
    assert found["gmsh library"].found is None


def test_a_file_that_is_no_program_counts_as_missing(bin_folder: Path) -> None:
    (bin_folder / "liggghts").write_bytes(b"\x7fELF, but no more")
    assert "does not start: Exec format error" in finding("LIGGGHTS").remedy


@pytest.mark.parametrize(
    ("complaint", "remedy"),
    [
        (
            "OSError: libXft.so.2: cannot open shared object file: No such file or directory",
            "run: apt-get install --no-install-recommends libxft2 ",
        ),
        ("ImportError: something else", "ImportError: something else"),
    ],
)
def test_a_library_that_cannot_be_loaded_is_traced_to_its_package(
    complaint: str, remedy: str, bin_folder: Path
) -> None:
    program(bin_folder, "python", f"echo '{complaint}' >&2; exit 1")
    missing = finding("gmsh library")
    assert missing.found is None
    assert missing.remedy.startswith(remedy)


@pytest.mark.usefixtures("bin_folder")
def test_too_little_disk_is_a_finding_with_the_amount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert finding("disk", tmp_path).found is not None
    monkeypatch.setattr(doctor, "DISK_WANTED", 1e18)
    full = finding("disk", tmp_path)
    assert full.found is None
    assert "GB free" in full.remedy


@pytest.mark.usefixtures("bin_folder")
def test_an_absent_package_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(doctor.PACKAGES, "granpipe-nonexistent", "nothing")
    missing = finding("granpipe-nonexistent")
    assert missing.found is None
    assert "pip install granpipe-nonexistent" in missing.remedy


def test_what_a_run_requires_is_refused_with_every_remedy(bin_folder: Path) -> None:
    require("LIGGGHTS", "mpirun", "EGL library")
    program(bin_folder, "python", "echo 'OSError: libEGL.so.1: cannot open shared object file' >&2; exit 1")
    (bin_folder / "mpirun").unlink()
    with pytest.raises(RunError, match=r"mpirun is missing.*openmpi-bin.*EGL library is missing.*libegl1"):
        require("LIGGGHTS", "mpirun", "EGL library")
