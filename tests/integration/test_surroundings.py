"""Whatever surrounds a command, it works or is refused before the work begins."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from fakes.runs import listen_to_interrupts

from granpipe.system.surroundings import can_be_written

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"
COMMAND = [sys.executable, "-m", "granpipe"]
JUPYTER = "module://matplotlib_inline.backend_inline"
RUN = [*COMMAND, "run", str(HOPPER), "--set", "figures=[rz]", "--set", "export=[]"]


def in_shell(command: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """The outcome of a shell command in a folder; `"$@"` in it is the run of a small fluid case."""
    return subprocess.run(
        ["bash", "-c", command, "bash", *RUN],
        cwd=folder, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def assert_done(folder: Path) -> None:
    names = {path.name for path in (folder / "results" / "hopper").iterdir()}
    assert {"field.npz", "provenance.json", "manifest.json", "figures"} <= names


@pytest.mark.parametrize(
    ("command", "environment"),
    [
        ("echo 'text.usetex: True' > matplotlibrc; \"$@\"", {"MPLBACKEND": JUPYTER}),
        ('"$@" 2>&-', {"MPLBACKEND": "nonsense"}),
        ('"$@" >&- 2>&- <&-', {}),
        ('"$@" 2> /dev/full', {}),
        ('{ "$@"; echo $? > status; } 2>&1 | true; exit $(cat status)', {}),
    ],
    ids=["Jupyter and usetex", "stderr closed, no such back end", "all streams closed", "log full", "reader gone"],
)
def test_a_run_is_done(tmp_path: Path, command: str, environment: dict[str, str]) -> None:
    done = in_shell(command, tmp_path, **environment)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert_done(tmp_path)


def test_a_result_that_does_not_get_through_is_told(tmp_path: Path) -> None:
    done = in_shell('"$@" > /dev/full', tmp_path)
    assert (done.returncode, "Traceback" in done.stderr) == (3, False), done.stderr
    assert "<stdout>: No space left on device" in done.stderr
    assert_done(tmp_path)


def test_a_lost_reader_does_not_hide_a_failed_gate(tmp_path: Path) -> None:
    command = '{ "$@" --set fluid.order=2 --set name=/bad; echo $? > status; } 2>&1 | true; exit $(cat status)'
    assert in_shell(command, tmp_path).returncode == 2


def test_caches_go_elsewhere_where_home_cannot_be_written(tmp_path: Path) -> None:
    script = "import granpipe.system.surroundings as s, os; s.prepare(); print(os.environ['NUMBA_CACHE_DIR'])"
    (tmp_path / "file").touch()
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "file" / "cache")},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    folder = Path(done.stdout.strip())
    assert folder.name.startswith("granpipe-")
    assert not folder.exists()  # gone with the process


def test_calibrate_is_refused_before_it_measures(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = subprocess.run(
        [*COMMAND, "calibrate"], env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "file" / "cache")},
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 3
    assert re.search(r"not writable; give a writable folder in XDG_CACHE_HOME", done.stderr)
    assert "settle" not in done.stderr


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ('ulimit -v 400000; "$@"', "the limit on address space is 410 MB"),
        ('PATH=/nowhere; "$@" --set model=dem', "liggghts is not installed"),
        ("printf 'font.size: \\xff' > matplotlibrc; \"$@\"", "matplotlibrc: not UTF-8 text"),
        ("\"$@\" --results $'\\xff'", "its path is not UTF-8 text; rename it"),
    ],
)
def test_what_a_run_lacks_is_told_before_the_work(command: str, told: str, tmp_path: Path) -> None:
    done = in_shell(command, tmp_path)
    assert (done.returncode, told in done.stderr) == (3, True), done.stderr
    assert "fluid" not in done.stderr
    assert "walls" not in done.stderr


def test_an_interrupt_while_python_imports_leaves_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "click.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    search = os.pathsep.join([str(tmp_path), str(HOPPER.parents[1])])
    done = subprocess.run(
        [*COMMAND, "--version"],
        env=os.environ | {"PYTHONPATH": search},
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=listen_to_interrupts,
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_nothing_is_imported_from_the_folder_that_granpipe_works_in(tmp_path: Path) -> None:
    """A gmsh.py of the user's once ran in the place of the library, and was missed by `granpipe doctor`."""
    (tmp_path / "gmsh.py").write_text("open('ran', 'w')")
    script = "import subprocess, sys; from granpipe.system.programs import python_environment as own; "
    script += "subprocess.run([sys.executable, '-c', 'import gmsh; gmsh.__version__'], env=own(), check=True)"
    subprocess.run([sys.executable, "-P", "-c", script], cwd=tmp_path, check=True, capture_output=True)
    assert not (tmp_path / "ran").exists()


def test_a_home_that_may_not_be_read_holds_no_caches(monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(self: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "exists", denied)
    assert not can_be_written(Path("home/.cache"))
