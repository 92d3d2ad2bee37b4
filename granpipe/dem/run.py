"""The LIGGGHTS process: started with limits, watched, ended with everything it started.

LIGGGHTS is trusted only if it exited 0 and printed the last line of its deck. Its output goes line by line into a file
(through a pipe its last words would be lost), every file it writes is capped in size, and it dies with granpipe.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from granpipe.errors import RunError

DONE = "granpipe: done"
"""Last line of a deck of granpipe that was worked off."""

_POLL = 0.2  # s
_PR_SET_PDEATHSIG = 1
_INSERTED = re.compile(r"INFO: Particle insertion \w+: inserted (\d+) particle templates")
_SEGMENT = re.compile(r"granpipe: segment (\d+)")


def liggghts_version(timeout: float = 10) -> str:
    """First line that LIGGGHTS prints of itself; RunError where it is missing or does not start."""
    binary = _binary("liggghts")
    done = subprocess.run(
        [binary, "-in", os.devnull, "-log", "none"], capture_output=True, text=True, timeout=timeout, check=False
    )
    line = next((line for line in done.stdout.splitlines() if "LIGGGHTS" in line), "")
    if not line:
        raise RunError(f"{binary} does not start: {(done.stderr or done.stdout).strip()[:200]}")
    return line.strip()


def _binary(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        package = {"liggghts": "liggghts", "mpirun": "openmpi-bin"}.get(name, name)
        raise RunError(f"{name} is not installed; run: apt-get install --no-install-recommends {package}")
    return path


def processor_grid(ranks: int) -> tuple[int, int, int]:
    """Split of the box that is balanced by symmetry: through the axis first, then along it."""
    x = 2 if ranks % 2 == 0 else 1
    y = 2 if ranks % 4 == 0 else 1
    return x, y, ranks // (x * y)


@dataclass
class Status:
    """What the output has told so far."""

    step: int = 0
    particles: int = 0
    kinetic_energy: float = 0.0
    inserted: int = 0
    short_insertions: int = 0
    discharged: int = 0
    segment: int = 0
    done: bool = False
    message: str = ""

    def read(self, line: str) -> None:
        """Take in one line of LIGGGHTS' output."""
        if insertion := _INSERTED.match(line):
            self.inserted += int(insertion[1])
        elif "Less insertions than requested" in line:
            self.short_insertions += 1
        elif segment := _SEGMENT.match(line):
            self.segment = int(segment[1])
        elif line.startswith(DONE):
            self.done = True
        elif line.startswith("granpipe: "):
            self.message = line.removeprefix("granpipe: ").strip()
        else:
            self._thermo(line.split())

    def _thermo(self, words: list[str]) -> None:
        """A row of the thermo table: step atoms ke [discharge: count, deleted] cpu."""
        if len(words) not in (4, 6) or not words[0].isdigit():
            return
        with contextlib.suppress(ValueError):
            self.step, self.particles = int(words[0]), int(words[1])
            self.kinetic_energy = float(words[2])
            if len(words) == 6:
                self.discharged = int(float(words[4]))


class Liggghts:
    """One run of LIGGGHTS in a folder; a context manager that leaves no process behind.

    Parameters
    ----------
    deck : name of the deck in `folder`
    folder : working folder; ``output.txt`` and ``log.liggghts`` appear there
    ranks : MPI ranks
    variables : values for ``${name}`` in the deck
    file_cap : largest size of any one file that it may write [bytes]
    """

    def __init__(
        self, deck: str, folder: Path, ranks: int, variables: Mapping[str, int], file_cap: int = 2 * 1024**3
    ) -> None:
        self.folder, self.ranks, self.file_cap = folder, ranks, file_cap
        self.command = _command(deck, ranks, variables)
        self.status = Status()
        self._output = folder / "output.txt"
        self._read = 0
        self._tail = ""

    def __enter__(self) -> Liggghts:
        environment = os.environ | {
            "OMP_NUM_THREADS": "1",
            "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "OMPI_MCA_btl_vader_single_copy_mechanism": "none",  # containers often forbid cross-memory attach
        }
        with self._output.open("wb") as output:
            self._process = subprocess.Popen(
                self.command,
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_Limits(self.file_cap, os.getpid()),
            )
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def lines(self) -> Iterator[str]:
        """New complete lines of the output since the last call; `status` follows them."""
        with self._output.open("rb") as output:
            output.seek(self._read)
            data = output.read(1 << 20)
        self._read += len(data)
        *complete, self._tail = (self._tail + data.decode(errors="replace")).split("\n")
        for line in complete:
            self.status.read(line)
            yield line

    def wait(self) -> Iterator[Status]:
        """Yield the status a few times a second until the process ends; RunError unless it ended well."""
        running = True
        while running:
            running = self._process.poll() is None
            for _ in self.lines():
                pass
            yield self.status
            if running:
                time.sleep(_POLL)
        while any(True for _ in self.lines()):
            pass
        self._check()

    def stop(self) -> None:
        """End the whole process group, politely first."""
        for stop_signal, patience in ((signal.SIGTERM, 3.0), (signal.SIGKILL, 10.0)):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, stop_signal)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(patience)
                if stop_signal is signal.SIGTERM and not _group_alive(self._process.pid):
                    return

    def _check(self) -> None:
        code = self._process.returncode
        if code == 0 and self.status.done:
            return
        log = self._output.read_bytes()[-20_000:].decode(errors="replace").splitlines()
        own = [line.strip() for line in log if "ERROR" in line]
        how = f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"
        if code == -signal.SIGXFSZ or any("File size limit" in line for line in log):
            own = [f"a file outgrew its cap of {self.file_cap / 1e9:.3g} GB"]
        reason = own[-1] if own else self.status.message or "it did not reach the end of its deck"
        last = "\n  ".join(log[-5:])
        raise RunError(
            f"LIGGGHTS {how} at step {self.status.step}: {reason}\n"
            f"command: {shlex.join(self.command)}\noutput: {self._output}\n  {last}"
        )


class _Limits:
    """Runs in the child before LIGGGHTS does: dies with its parent, caps its files, writes no core."""

    def __init__(self, file_cap: int, parent: int) -> None:
        self.file_cap, self.parent = file_cap, parent
        self.libc = ctypes.CDLL(None)  # loaded here: importing after a fork is not safe

    def __call__(self) -> None:
        self.libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != self.parent:
            os._exit(1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_cap, self.file_cap))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _command(deck: str, ranks: int, variables: Mapping[str, int]) -> list[str]:
    grid = dict(zip(("px", "py", "pz"), processor_grid(ranks), strict=True))
    values = [word for name, value in (grid | dict(variables)).items() for word in ("-var", name, str(value))]
    program = [_binary("stdbuf"), "-oL", _binary("liggghts"), "-in", deck, "-log", "log.liggghts", *values]
    if ranks == 1:
        return program
    # the planner never asks for more ranks than cores; mpirun counts whole cores and would refuse hardware threads
    placement = ["--map-by", ":OVERSUBSCRIBE", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "0"]
    return [_binary("mpirun"), "-np", str(ranks), *placement, *program]


def _group_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
