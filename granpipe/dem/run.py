"""The LIGGGHTS process: started with limits, watched, ended with everything it started.

LIGGGHTS is trusted only if it exited 0 and printed the last line of its deck. Its output goes line by line into a file
(through a pipe its last words would be lost), and it dies with granpipe. What it may write, hold in memory and keep
silent for is limited: the kernel caps each file, the rest is looked at while it runs.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import resource
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from granpipe.errors import RunError
from granpipe.system.children import DieWithParent
from granpipe.system.interrupts import suspended_too
from granpipe.system.programs import find_program

DONE = "granpipe: done"
"""Last line of a deck of granpipe that was worked off."""

_POLL = 0.2  # s
_BLOCK = 1 << 22  # bytes of output taken in at a time
_MEMORY_EVERY = 2.0  # s
_DEAD = {psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD}

_LEAST_FILE = 256 * 1024**2  # bytes; Open MPI's own shared files take some megabytes
_LEAST_OUTPUT = 32 * 1024**2  # bytes
_STEP_OUTPUT = 100  # bytes a step; 1 to 10 were seen
_FILE_BYTES = 20_000  # a particle; restart files were seen to take 500 to 1000, contacts included
_RANK_MEMORY = 500_000_000  # bytes; an empty rank takes 60 MB
_PARTICLE_MEMORY = 50_000  # bytes
_LEAST_SILENCE = 120.0  # s; a machine that others use may be slow for a while
_SLOWER = 50  # times slower than expected, or than ever seen, is no longer running

_MEANINGS = {
    "not full": "the vessel did not become full; a smaller dem.reservoir_height or a larger vessel may help",
    "not settled": "the bed did not come to rest; make dem.time_step smaller, or leave it at auto",
}
"""What granpipe's own decks say before they give up."""

_LOST = re.compile(r"ERROR.*(Lost atoms|Out of range atoms|Non-numeric)")
_LOST_REMEDY = "; particles have left the vessel: make dem.time_step smaller, or contact.youngs_modulus larger"

_INSERTED = re.compile(r"INFO: Particle insertion \w+: inserted (\d+) particle templates")
_SEGMENT = re.compile(r"granpipe: segment (\d+)")


def processor_grid(ranks: int) -> tuple[int, int, int]:
    """Split of the box that is balanced by symmetry: through the axis first, then along it."""
    x = 2 if ranks % 2 == 0 else 1
    y = 2 if ranks % 4 == 0 else 1
    return x, y, ranks // (x * y)


@dataclass
class Status:
    """What the output has told so far; insertions and discharge [kg] count from the start of this process.

    `discharged` are particles that were taken out, `discharged_mass` is what has passed the catcher.
    """

    step: int = 0
    particles: int = 0
    kinetic_energy: float = 0.0
    inserted: int = 0
    short_insertions: int = 0
    discharged: int = 0
    discharged_mass: float = 0.0
    segment: int = 0
    done: bool = False
    message: str = ""
    _before: tuple[int, float] | None = None

    def read(self, line: str) -> bool:
        """Take in one line of LIGGGHTS' output; True for a row of the thermo table.

        Insertions are printed before the row that counts their particles, so at each row all numbers belong together.
        """
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
            return self._thermo(line.split())
        return False

    def _thermo(self, words: list[str]) -> bool:
        """A row of the thermo table: step atoms ke [discharge: count, deleted, mass] cpu."""
        if len(words) not in (4, 7) or not (words[0].isdigit() and words[1].isdigit()):
            return False
        try:
            energy, *discharge, _ = map(float, words[2:])
        except ValueError:
            return False
        self.step, self.particles, self.kinetic_energy = int(words[0]), int(words[1]), energy
        if discharge and math.isfinite(discharge[1]):
            self._count_discharge(int(discharge[1]), discharge[2])
        return True

    def _count_discharge(self, deleted: int, mass: float) -> None:
        """LIGGGHTS counts on from where the restart file stops; the first row comes before the first step."""
        if self._before is None:
            self._before = deleted, mass
        self.discharged, self.discharged_mass = deleted - self._before[0], mass - self._before[1]


@dataclass(frozen=True)
class Limits:
    """What LIGGGHTS may use before it is ended.

    Parameters
    ----------
    file_bytes : largest size of any one file that it writes; room for the MPI library's shared files included
    output_bytes : of all that it prints
    memory_bytes : of all its ranks together, shared pages counted in each
    silence : time without a new row of the thermo table [s], unless rows have come more slowly before
    """

    file_bytes: int = 2 * 1024**3
    output_bytes: int = 512 * 1024**2
    memory_bytes: int = 1 << 62
    silence: float = 600.0

    @classmethod
    def of(cls, particles: int, ranks: int, steps: int, seconds_per_row: float) -> Limits:
        """Limits of a run of a planned size.

        Parameters
        ----------
        seconds_per_row : expected time from one row of the thermo table to the next [s]
        """
        return cls(
            file_bytes=max(_LEAST_FILE, _FILE_BYTES * particles),
            output_bytes=_LEAST_OUTPUT + _STEP_OUTPUT * steps,
            memory_bytes=_RANK_MEMORY * ranks + _PARTICLE_MEMORY * particles,
            silence=max(_LEAST_SILENCE, _SLOWER * seconds_per_row),
        )


class Liggghts:
    """One run of LIGGGHTS in a folder; a context manager that leaves no process behind.

    Parameters
    ----------
    deck : name of the deck in `folder`
    folder : working folder; ``output.txt`` and ``log.liggghts`` appear there
    ranks : MPI ranks
    variables : values for ``${name}`` in the deck
    limits : what it may use
    """

    def __init__(
        self, deck: str, folder: Path, ranks: int, variables: Mapping[str, int], limits: Limits | None = None
    ) -> None:
        self.folder, self.ranks, self.limits = folder, ranks, limits or Limits()
        self.command = _command(deck, ranks, variables)
        self.status = Status()
        self._output = folder / "output.txt"
        self._read = 0
        self._tail = ""
        self._spent: dict[int, float] = {}
        self.paused = False
        self._beside = contextlib.ExitStack()

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
                preexec_fn=_InChild(self.limits.file_bytes, self.ranks),
            )
        self._beside.enter_context(suspended_too(lambda: self._signal(signal.SIGSTOP), self._go_on))
        return self

    def __exit__(self, *_: object) -> None:
        self._beside.close()
        self.stop()

    def pause(self, wanted: bool) -> None:
        """Let LIGGGHTS stand still, or go on: it must not run far ahead of who follows it."""
        if wanted != self.paused:
            self.paused = wanted
            self._signal(signal.SIGSTOP if wanted else signal.SIGCONT)

    def _go_on(self) -> None:
        if not self.paused:
            self._signal(signal.SIGCONT)

    def _signal(self, number: signal.Signals) -> None:
        """Send a signal to LIGGGHTS; mpirun stays awake, to end its ranks when granpipe is killed."""
        for process in self.members():
            if self.ranks == 1 or process != self._process.pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, number)

    def wait(self, check_row: Callable[[Status], None] = lambda _: None) -> Iterator[Status]:
        """Yield the status a few times a second until the process ends; RunError unless it ends well.

        Parameters
        ----------
        check_row : called with the status at each row of the thermo table
        """
        watch = _Watch(self)
        while self._process.poll() is None:
            self._take_in(check_row)
            watch.look()
            yield self.status
            time.sleep(_POLL)
        while self._read < min(self._output.stat().st_size, self.limits.output_bytes):
            self._take_in(check_row)
        yield self.status
        self._check()

    def _take_in(self, check_row: Callable[[Status], None]) -> None:
        """Read what has been printed since the last call, though not more than a block."""
        with self._output.open("rb") as output:
            output.seek(self._read)
            data = output.read(_BLOCK)
        self._read += len(data)
        *lines, self._tail = (self._tail + data.decode(errors="replace")).split("\n")
        for line in lines:
            if self.status.read(line):
                check_row(self.status)

    def stop(self) -> None:
        """End everything that was started, politely first."""
        for stop_signal, patience in ((signal.SIGTERM, 3.0), (signal.SIGKILL, 10.0)):
            for process in self.members():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, stop_signal)
                    os.kill(process, signal.SIGCONT)
            end = time.monotonic() + patience
            while time.monotonic() < end:
                self._process.poll()
                if not self.members():
                    return
                time.sleep(_POLL / 10)

    def members(self) -> list[int]:
        """Processes of this run, ranks of mpirun (which have groups of their own) included; the dead left out."""
        found = []
        for process in psutil.pids():
            with contextlib.suppress(OSError, psutil.Error):
                if os.getsid(process) == self._process.pid and psutil.Process(process).status() not in _DEAD:
                    found.append(process)
        return found

    def processor_seconds(self) -> float:
        """Processor time that all ranks together have taken until they were last looked at [s]."""
        return sum(self._spent.values())

    def measure(self, members: Sequence[int]) -> None:
        """Note what the processes have taken so far; those that have ended keep what they had."""
        for process in members:
            with contextlib.suppress(psutil.Error):
                times = psutil.Process(process).cpu_times()
                self._spent[process] = times.user + times.system

    def endless(self) -> str:
        """That it has printed more than it may; empty where it has not."""
        printed = self._output.stat().st_size
        if printed <= self.limits.output_bytes:
            return ""
        return f"it printed {printed / 1e6:.0f} MB: it repeats itself without end"

    def fail(self, how: str, reason: str) -> RunError:
        """The error that tells how the run ended, why, by which command, and its last lines."""
        last = "\n  ".join(line[:200] for line in self._last_lines()[-5:])
        return RunError(
            f"LIGGGHTS {how} at step {self.status.step}: {reason}\n"
            f"command: {shlex.join(self.command)}\nit said last:\n  {last}"
        )

    def _last_lines(self) -> list[str]:
        with self._output.open("rb") as output:
            output.seek(max(0, self._output.stat().st_size - 20_000))
            return output.read().decode(errors="replace").splitlines()

    def _check(self) -> None:
        code = self._process.returncode
        if code == 0 and self.status.done:
            return
        log = self._last_lines()
        own = [line.strip() for line in log if "ERROR" in line]
        how = f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"
        if code == -signal.SIGXFSZ or any("File size limit" in line for line in log):
            own = [f"a file outgrew its cap of {self.limits.file_bytes / 1e9:.3g} GB"]
        if endless := self.endless():  # so fast that it ended before it was looked at
            own = [endless]
        reason = own[-1] if own else _MEANINGS.get(self.status.message, "it did not reach the end of its deck")
        raise self.fail(how, reason + (_LOST_REMEDY if _LOST.search(reason) else ""))


class _Watch:
    """Looks at a running process now and then: how much it prints, how long it is silent, what memory it takes."""

    def __init__(self, run: Liggghts) -> None:
        self.run, self.limits = run, run.limits
        self.step, self.quiet, self.longest = -1, 0.0, 0.0
        self.looked = time.monotonic()
        self.measured = -math.inf
        self.members: list[int] = []

    def look(self) -> None:
        """RunError if a limit is broken."""
        now = time.monotonic()
        # what granpipe itself does in between, or its sleep, is no silence of LIGGGHTS
        self.quiet += 0.0 if self.run.paused else min(now - self.looked, 5 * _POLL)
        self.looked = now
        self._progress()
        if endless := self.run.endless():
            raise self.run.fail("was stopped", endless)
        if now > self.measured + _MEMORY_EVERY:
            self.measured = now
            self.members = self.run.members()
            self._memory()
        self.run.measure(self.members)

    def _progress(self) -> None:
        if self.run.status.step != self.step:
            self.longest = max(self.longest, self.quiet)
            self.step, self.quiet = self.run.status.step, 0.0
        allowed = max(self.limits.silence, _SLOWER * self.longest)
        if self.quiet > allowed:
            raise self.run.fail(
                "was stopped",
                f"no new step for {self.quiet:.0f} s, {allowed:.0f} s allowed: it hangs; run again, it resumes "
                "(if it hangs again, try dem.ranks: 1)",
            )

    def _memory(self) -> None:
        taken = sum(map(_resident, self.members))
        if taken > self.limits.memory_bytes:
            raise self.run.fail(
                "was stopped",
                f"it takes {taken / 1e6:.0f} MB of memory, {self.limits.memory_bytes / 1e6:.0f} MB are more than a run "
                "of this size needs: particles pile up, or the neighbour lists overflow (dem.time_step, contact)",
            )


def _resident(process: int) -> int:
    """Memory that a process holds [bytes]; 0 where it has ended."""
    with contextlib.suppress(psutil.Error):
        return int(psutil.Process(process).memory_info().rss)
    return 0


class _InChild:
    """Runs in the child before LIGGGHTS does: dies with its parent, caps its files, writes no core."""

    def __init__(self, file_cap: int, ranks: int) -> None:
        self.file_cap = file_cap
        # mpirun has ranks to end; a stopped process none
        self.die_with_parent = DieWithParent(signal.SIGKILL if ranks == 1 else signal.SIGTERM)

    def __call__(self) -> None:
        self.die_with_parent()
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_cap, self.file_cap))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _command(deck: str, ranks: int, variables: Mapping[str, int]) -> list[str]:
    grid = dict(zip(("px", "py", "pz"), processor_grid(ranks), strict=True))
    values = [word for name, value in (grid | dict(variables)).items() for word in ("-var", name, str(value))]
    program = [find_program("stdbuf"), "-oL", find_program("liggghts"), "-in", deck, "-log", "log.liggghts", *values]
    if ranks == 1:
        return program
    # the planner never asks for more ranks than cores; mpirun counts whole cores and would refuse hardware threads
    placement = ["--map-by", ":OVERSUBSCRIBE", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "0"]
    return [find_program("mpirun"), "-np", str(ranks), *placement, *program]
