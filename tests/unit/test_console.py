"""What a terminal of 80 columns shows, seen through a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from granpipe.cli import main
from granpipe.errors import RunError
from granpipe.pipeline import run as pipeline_run

SHOW = """
import time
from granpipe.console import Console
with Console() as console:
    console.stage("settle"); console.stage("settle", "done before"); console.stage("settle")
    console.stage("produce, replica 12")
    for _ in range(3):
        console.update(0.42, "12 min 05 s left, error 5.2 % (" + ", ".join(f"section{n} 4.{n}" for n in range(9)) + ")")
        time.sleep(0.2)
"""


def shown(command: list[str], answer: bytes = b"", columns: int = 80, cwd: Path | None = None) -> str:
    """What a command writes on a terminal; `answer` is typed at once."""
    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    with subprocess.Popen(
        command, stdin=follower, stdout=follower, stderr=follower, close_fds=True, cwd=cwd,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "", "PYTHONPATH": os.pathsep.join(sys.path)},
    ):  # fmt: skip
        os.close(follower)
        os.write(leader, answer)
        text, end = b"", time.monotonic() + 60
        while time.monotonic() < end:
            try:
                text += (part := os.read(leader, 4096))
            except OSError:
                break
            if not part:
                break
    os.close(leader)
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.decode())


def test_bar_share_and_time_left_stay_on_80_columns() -> None:
    lines = re.split(r"[\r\n]+", shown([sys.executable, "-c", SHOW]))
    bars = [line for line in lines if "42%" in line]
    assert bars
    for line in bars:
        assert len(line.rstrip()) <= 80
        assert "━" in line
        assert "12 min 05 s left" in line


def test_a_stage_is_named_once_and_again_where_it_is_repeated() -> None:
    lines = re.split(r"[\r\n]+", shown([sys.executable, "-c", SHOW]))
    assert [line.strip() for line in lines if line.startswith("settle")] == ["settle", "settle, again"]


LONG = ["contact.youngs_modulus=1e10", "dem.max_time=1000 s", "figures=[]"]


def test_somebody_at_a_terminal_is_asked_before_a_long_run(tiny: Path) -> None:
    sets = [word for one in LONG for word in ("--set", one)]
    text = shown([sys.executable, "-m", "granpipe", "run", str(tiny), *sets], b"n\n", cwd=tiny.parent)
    assert "forecast: about" in text
    assert "begin?" in text
    assert "not begun" in text


def test_nobody_is_asked_where_stdin_is_no_terminal(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[bool] = []

    def pretend(*_: object, agreed: Callable[[float], bool]) -> None:
        answers.append(agreed(1e7))
        raise RunError("enough")

    monkeypatch.setattr(pipeline_run, "run_case", pretend)
    assert CliRunner().invoke(main, ["run", str(tiny)]).exit_code == 3
    assert answers == [True]
