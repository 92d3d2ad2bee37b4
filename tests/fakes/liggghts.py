"""A stand-in for LIGGGHTS: works off granpipe's decks for a straight pipe in milliseconds, and misbehaves on command.

The bed is a lattice, denser than the bed that a filling begins with. It sinks with the plate, one velocity everywhere;
new layers enter above as it goes down. All of it follows from the step number, so a run that was interrupted ends
exactly as one that was not.

Put on PATH by `install`. The environment variable FAKE_LIGGGHTS commands a fault, "kind" while filling or "kind@n" in
the middle of segment n of production; FAKE_PAUSE is a pause before each segment [s].
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from fakes.analytic_flow import binary_snapshot

VERSION = "LIGGGHTS (Version LIGGGHTS-PUBLIC 3.8.0, a stand-in for tests)"
CLOSENESS = 0.985  # of the lattice: an overlap of 1.5 %
RESTART_BYTES = 20_000
BOX = np.array([[-1.0, 1.0]] * 3)

HIGHER = 1.15
"""Height of the lattice over that up to the top of the feed: it has to hold the particles of the packed bed."""


def install(folder: Path) -> Path:
    """Make `folder`/liggghts, an executable; returns the folder, to be put first on PATH."""
    program = folder / "liggghts"
    tests = Path(__file__).parents[1]
    program.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(tests)!r})\n"
        "from fakes.liggghts import main\nmain(sys.argv[1:])\n"
    )
    program.chmod(0o755)
    return folder


class Bed:
    """The lattice, from the numbers of the deck."""

    def __init__(self, deck: str) -> None:
        def number(pattern: str, default: float | None = None) -> float:
            found = re.search(pattern, deck)
            assert found or default is not None, pattern
            return float(found[1]) if found else default

        self.radius = number(r"radius constant (\S+)")
        self.speed = -number(r"fix\s+sinking all move/mesh mesh plate linear 0\.0 0\.0 ([^\s\"]+)", 0.0)
        self.start_speed = -number(r"fix\s+starting all move/mesh mesh plate linear 0\.0 0\.0 ([^\s\"]+)", 0.0)
        self.start_segments = int(number(r"\{segment\} == (\d+)", 1)) - 1
        self.step_time = number(r"timestep\s+(\S+)")
        self.thermo = int(number(r"thermo\s+(\d+)"))
        self.dump = int(number(r"dump\s+snapshots all custom (\d+)", 0))
        self.segment = int(number(r"label\s+segments\n(?:if .*\n)?run\s+(\d+)", 0))
        feed = re.search(r"region\s+feed cylinder z 0\.0 0\.0 (\S+) (\S+) (\S+)", deck)
        lows = re.findall(r"region\s+fill\d+ cylinder z 0\.0 0\.0 \S+ (\S+)", deck)
        self.top = float(feed[3])
        self.floor = min(map(float, lows)) if lows else None
        self.spacing = 2 * self.radius * CLOSENESS
        half = int(float(feed[1]) / self.spacing) + 1
        column, row = (each.ravel() for each in np.meshgrid(*[np.arange(-half, half + 1)] * 2))
        x, y = (column + 0.5 * (row % 2)) * self.spacing, row * np.sqrt(0.75) * self.spacing
        inside = np.hypot(x, y) <= float(feed[1])
        layer = np.column_stack([x[inside], y[inside]])
        # every other layer lies in the hollows of the one below
        self.hollow = self.spacing * np.array([0.5, 0.5 / np.sqrt(3)])
        self.layer = layer - 0.5 * self.hollow
        self.rise = np.sqrt(2 / 3) * self.spacing

    def travel(self, step: int) -> float:
        """Of the plate, which may be faster in the first segments."""
        fast = min(step, self.start_segments * self.segment)
        return self.step_time * (self.start_speed * fast + self.speed * (step - fast))

    def layers(self, step: int) -> int:
        """How many have entered by then."""
        travel = self.travel(step)
        return int(HIGHER * (self.top - self.floor) / self.rise) + int(travel / self.rise + 1e-9)

    def particles(self, step: int) -> np.ndarray:
        """Rows of a snapshot."""
        count, per = self.layers(step), len(self.layer)
        travel = self.travel(step)
        values = np.empty((count * per, 9))
        values[:, 0] = np.arange(1, len(values) + 1)
        values[:, 1] = 1
        number = np.repeat(np.arange(count), per)
        values[:, 2:4] = np.tile(self.layer, (count, 1)) + (number % 2)[:, None] * self.hollow
        values[:, 4] = self.floor + self.radius + number * self.rise - travel
        fast = 0 < step <= self.start_segments * self.segment
        values[:, 5:8] = 0.0, 0.0, -(self.start_speed if fast else self.speed)
        values[:, 8] = self.radius
        return values


class Run:
    """What is printed and written; a fault, once it is due, shows in all of it."""

    def __init__(self, bed: Bed, fault: str) -> None:
        self.bed, self.fault = bed, fault
        self.due = False
        self.shown = 0

    def row(self, step: int) -> None:
        """Insertions since the last row, then the row."""
        count = self.bed.layers(step) * len(self.bed.layer)
        if self.shown and count > self.shown:
            self.insertion(count - self.shown, step)
        self.shown = count
        energy, lost = 1e-6, 0
        if self.due:
            self.misbehave()
            energy = {"blow-up": 1e9, "nan": float("nan")}.get(self.fault, energy)
            lost = int(self.fault == "lost")
        print(f"{step:8d} {count - lost:8d} {energy:14.8g} {time.process_time():14.8g}", flush=True)

    def insertion(self, count: int, step: int) -> None:
        print(f"INFO: Particle insertion feed: inserted {count} particle templates (mass 1.0e+00) at step {step}")

    def misbehave(self) -> None:
        """The faults that end or stop the process."""
        if self.fault == "hang":
            time.sleep(3600)
        elif self.fault == "early":
            sys.exit(0)
        elif self.fault == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        elif self.fault == "error":
            print("ERROR: Lost atoms: original 10 current 9 (./src/thermo.cpp:437)", flush=True)
            os._exit(1)
        while self.fault == "endless":
            print("Neighbor list overflow, boost neigh_modify one or page " * 20)
        while self.fault == "fat":
            np.ones(20_000_000)
            self.fat = [*getattr(self, "fat", []), np.ones(20_000_000)]
            time.sleep(0.02)

    def snapshot(self, path: Path, step: int) -> None:
        values = self.bed.particles(step)
        if self.due:
            values = self.damaged(values)
        data = binary_snapshot(step, BOX, values)
        if self.due and self.fault == "truncated":
            data = data[: len(data) // 2]
        path.write_bytes(data)

    def damaged(self, values: np.ndarray) -> np.ndarray:
        """The faults that particles show."""
        if self.fault == "outside":
            values[5, 2] = 1.2 * np.hypot(*values[:, 2:4].T).max() + 2 * self.bed.radius
        elif self.fault == "fast":
            values[5, 7] = -100.0
        elif self.fault == "soft":
            values[:, 2:4] *= 0.9
        elif self.fault == "not a number":
            values[5, 2] = np.nan
        return values


def main(arguments: list[str]) -> None:
    """Work off ``-in DECK -log FILE -var name value …``."""
    print(VERSION)
    options = [(arguments[i + 1], arguments[i + 2]) for i, word in enumerate(arguments) if word == "-var"]
    deck = Path(arguments[arguments.index("-in") + 1]).read_text()
    kind, _, segment = os.environ.get("FAKE_LIGGGHTS", "").partition("@")
    if "write_dump" in deck:
        fill(Run(Bed(deck), "" if segment else kind))
    elif "read_restart" in deck:
        variables = dict(options)
        produce(Run(Bed(deck), kind), int(variables["first"]), int(variables["last"]), int(segment or 0))


def fill(run: Run) -> None:
    bed = run.bed
    placed = int(re.search(r"^(\d+) atoms$", Path("bed.data").read_text(), re.MULTILINE)[1])
    print(f"{0:8d} {placed:8d} {0:14.8g} {0:14.8g}", flush=True)
    run.insertion(len(bed.particles(0)) - placed, 1)
    run.due = bool(run.fault)
    for step in range(bed.thermo, 5 * bed.thermo, bed.thermo):
        run.row(step)
    print("granpipe: not settled" if run.fault == "restless" else "granpipe: settled at 1e-9 J/kg")
    if run.fault == "restless":
        return
    run.snapshot(Path("settled.bin"), 0)
    write_restart(Path("settled.restart"), 0, bed.floor)
    print("granpipe: done", flush=True)


def produce(run: Run, first: int, last: int, fault_segment: int) -> None:
    bed = run.bed
    start, bed.floor = read_restart(Path("start.restart"))
    run.row(start)
    run.snapshot(Path(f"snapshot.{start}.bin"), start)
    for number in range(first, last + 1):
        time.sleep(float(os.environ.get("FAKE_PAUSE", "0")))
        middle = (number - 0.5) * bed.segment
        for step in stops(bed, (number - 1) * bed.segment, number * bed.segment):
            run.due = bool(run.fault) and number >= fault_segment and step >= middle
            if step % bed.dump == 0:
                run.snapshot(Path(f"snapshot.{step}.bin"), step)
            run.row(step)
        write_restart(Path(f"segment.{number}.restart"), number * bed.segment, bed.floor)
        print(f"granpipe: segment {number}", flush=True)
    print("granpipe: done", flush=True)


def stops(bed: Bed, start: int, end: int) -> Iterator[int]:
    """Steps at which something is printed or written."""
    every = {*range(0, end + 1, bed.thermo), *range(0, end + 1, bed.dump), end}
    return (step for step in sorted(every) if step > start)


def write_restart(path: Path, step: int, floor: float) -> None:
    part = path.with_suffix(".part")
    part.write_text(f"{step} {floor!r}".ljust(RESTART_BYTES))
    part.replace(path)


def read_restart(path: Path) -> tuple[int, float]:
    """Step and floor; a file that is not whole makes it print for ever, as it does the original."""
    text = path.read_text(errors="replace")
    while len(text) != RESTART_BYTES:
        print("Restart file read error " * 40)
    step, floor = text.split()
    return int(step), float(floor)
