"""The doctor: names what is there and what is missing, quickly, whatever the programs it asks do."""

import errno
import re
import stat
import time
import tomllib
from pathlib import Path

import pytest

from granpipe.errors import RunError
from granpipe.system import doctor
from granpipe.system.doctor import check, require

ROOT = Path(__file__).parents[2]


def program(folder: Path, name: str, script: str) -> None:
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def bin_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder on the PATH, but for the system's tools."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program(folder, "liggghts", 'echo "LIGGGHTS (Version LIGGGHTS-PUBLIC 3.8.0, compiled today by me)"')
    program(folder, "mpirun", 'echo "mpirun (Open MPI) 4.1.4"')
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_every_dependency_is_looked_up() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(doctor.PACKAGES) == {re.split(r"[<>=~! ]", line)[0] for line in project["dependencies"]}


def test_setup_installs_every_library_that_the_doctor_names() -> None:
    lines = [tuple(line.split()) for line in (ROOT / ".ci/setup").read_text().splitlines()]
    assert {line for line in lines if len(line) == 2 and ".so." in line[0]} == set(doctor.DEBIAN.items())


def finding(name: str, folder: Path) -> doctor.Finding:
    return next(one for one in doctor._surroundings(folder) if one.name == name)


def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    assert finding("file locks", tmp_path).found == "work"
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("fcntl.flock", unsupported)
    missing = finding("file locks", tmp_path)
    assert missing.found is None
    assert "choose a folder on another one with --results" in missing.remedy


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    missing = doctor._locks(tmp_path / "absent")
    assert missing.found is None
    assert "choose another --results folder" in missing.remedy


def test_too_small_an_address_space_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resource.getrlimit", lambda _: (500_000_000, -1))
    missing = finding("address space", tmp_path)
    assert missing.found is None
    assert "ulimit -v" in missing.remedy


def test_caches_that_cannot_be_written_go_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert "a temporary folder is used instead" in str(finding("caches", tmp_path).found)


@pytest.mark.usefixtures("bin_folder")
def test_versions_are_read_from_what_programs_say_of_themselves() -> None:
    assert doctor._liggghts().found == "LIGGGHTS-PUBLIC 3.8.0"
    assert doctor._mpirun().found == "mpirun (Open MPI) 4.1.4"


def test_missing_programs_come_with_the_package_that_holds_them(bin_folder: Path) -> None:
    (bin_folder / "liggghts").unlink()
    (bin_folder / "mpirun").unlink()
    for missing, package in ((doctor._liggghts(), "liggghts"), (doctor._mpirun(), "openmpi-bin")):
        assert missing.found is None
        assert f"install --no-install-recommends {package}" in missing.remedy


def test_programs_that_hang_or_crash_count_as_missing(bin_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TIMEOUT", 1.0)
    monkeypatch.setattr(doctor, "_GMSH", "import os; os.abort()")
    program(bin_folder, "liggghts", "exec /bin/sleep 30")
    program(bin_folder, "mpirun", "echo no licence >&2; exit 1")
    start = time.monotonic()
    found = {one.name: one for one in check()}
    assert time.monotonic() - start < 5
    assert found["LIGGGHTS"].found is None
    assert "did not answer within 1 s" in found["LIGGGHTS"].remedy
    assert found["mpirun"].found is None
    assert "no licence" in found["mpirun"].remedy
    assert found["gmsh library"].found is None


def test_a_library_that_cannot_be_loaded_is_traced_to_its_package() -> None:
    complaint = "OSError: libXft.so.2: cannot open shared object file: No such file or directory"
    assert doctor._remedy(complaint).startswith("run: apt-get install --no-install-recommends libxft2 ")
    assert doctor._remedy("ImportError: something else") == "ImportError: something else"


def test_too_little_disk_is_a_finding_with_the_amount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._disk(tmp_path).found is not None
    monkeypatch.setattr(doctor, "DISK_WANTED", 1e18)
    full = doctor._disk(tmp_path)
    assert full.found is None
    assert "GB free" in full.remedy


def test_an_absent_package_is_missing_and_a_present_one_has_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(doctor.PACKAGES, "granpipe-nonexistent", "nothing")
    assert doctor._package("granpipe-nonexistent").found is None
    assert re.match(r"\d+\.\d+", doctor._package("numpy").found or "")


def test_what_a_run_requires_is_refused_with_every_remedy(bin_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_EGL", "raise OSError('libEGL.so.1: cannot open shared object file')")
    require("LIGGGHTS", "mpirun")
    (bin_folder / "mpirun").unlink()
    with pytest.raises(RunError, match=r"mpirun is missing.*openmpi-bin.*EGL library is missing.*libegl1"):
        require("LIGGGHTS", "mpirun", "EGL library")
