"""The job script of a sweep, run by bash with stand-ins for its programs: a signal at any moment is not lost."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from granpipe.progress import Silent
from granpipe.sweep import slurm
from granpipe.sweep.file import Profile
from granpipe.sweep.folder import Folder
from granpipe.sweep.jobs import submit
from granpipe.sweep.points import Point

WORKER = """#!/bin/bash
echo begun >> worker
trap 'echo told >> worker; exit 130' TERM
[ "$STUBBORN" ] && trap - TERM
for i in {1..100}; do sleep 0.05; done
echo whole >> worker
"""

ENVIRONMENT = {"SLURM_ARRAY_TASK_ID": "1", "SLURM_ARRAY_JOB_ID": "7", "SLURM_RESTART_COUNT": "0"}


def started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setup: tuple[str, ...] = (), **more: str
) -> subprocess.Popen[str]:
    """The script at work in a folder, where `worker` and `requeued` tell what was called."""
    scripts: list[Path] = []
    monkeypatch.setattr(slurm, "submit", lambda path, *_: (scripts.append(path), "7")[1])
    monkeypatch.setattr(slurm, "queue", list)
    monkeypatch.setattr(slurm, "largest_array", lambda: 1000)
    monkeypatch.setattr(slurm, "is_here", lambda: True)
    (tmp_path / "sweep").mkdir()
    profile = Profile.model_validate({"time": "1 h"} | ({"setup": list(setup)} if setup else {}))
    submit(Folder(tmp_path / "sweep"), [Point("p", 1, True)], profile, Silent())
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in (("worker", WORKER), ("scontrol", "#!/bin/bash\necho $@ > requeued\n")):
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    text = scripts[0].read_text()
    lines = [
        f'granpipe=("{programs / "worker"}")' if line.startswith("granpipe=(") else line for line in text.split("\n")
    ]
    (tmp_path / "job.sh").write_text("\n".join(lines))
    path = f"{programs}:{os.environ['PATH']}"
    return subprocess.Popen(
        ["bash", "job.sh"], cwd=tmp_path, env=os.environ | ENVIRONMENT | {"PATH": path} | more, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def wait_for(path: Path) -> None:
    end = time.monotonic() + 10
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.01)
    assert path.exists()


@pytest.mark.parametrize(("number", "requeued"), [(signal.SIGUSR1, True), (signal.SIGTERM, False)])
@pytest.mark.parametrize("stubborn", ["", "yes"])
def test_a_signal_ends_the_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, requeued: bool, stubborn: str
) -> None:
    process = started(tmp_path, monkeypatch, STUBBORN=stubborn)
    wait_for(tmp_path / "worker")
    time.sleep(0.2)
    process.send_signal(number)
    said, _ = process.communicate(timeout=20)
    assert process.returncode == (143 if stubborn else 130), said
    assert (tmp_path / "requeued").exists() is requeued
    assert "whole" not in (tmp_path / "worker").read_text()


@pytest.mark.parametrize(("number", "requeued"), [(signal.SIGUSR1, True), (signal.SIGTERM, False)])
def test_a_signal_while_modules_are_loaded_starts_no_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, requeued: bool
) -> None:
    process = started(tmp_path, monkeypatch, ("touch loading", "sleep 1"))
    wait_for(tmp_path / "loading")
    process.send_signal(number)
    said, _ = process.communicate(timeout=20)
    assert process.returncode == 130, said
    assert (tmp_path / "requeued").exists() is requeued
    assert not (tmp_path / "worker").exists()


def test_the_script_substitutes_no_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # bash 5.2 loses about one of 300 signals that come within a millisecond of the start if it reads $(…) meanwhile
    started(tmp_path, monkeypatch).kill()
    assert not re.search(r"\$\([^(]|`", re.sub("#.*", "", (tmp_path / "job.sh").read_text()))


def test_signals_at_many_moments_around_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    process = started(tmp_path, monkeypatch, ("touch loading",))
    process.communicate(timeout=20)
    for step in range(12):
        for name in ("loading", "worker", "requeued"):
            (tmp_path / name).unlink(missing_ok=True)
        again = subprocess.Popen(process.args, cwd=tmp_path, env=os.environ | ENVIRONMENT, stdout=subprocess.DEVNULL)
        wait_for(tmp_path / "loading")
        time.sleep(0.003 * step)
        again.send_signal(signal.SIGUSR1)
        assert again.wait(10) in (130, 143)
        assert "whole" not in ((tmp_path / "worker").read_text() if (tmp_path / "worker").exists() else "")
