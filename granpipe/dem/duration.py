"""How long production lasts, and how far the plate may sink.

Two lengths are told apart: the time that is simulated, and the room for it below the outlet. The room decides the box
and the walls, and so what is filled; it follows from vessel and particles alone, so that a longer time continues the
same run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from granpipe.dem.contact import two_digits_up

LEAST_TRAVEL = 6.0
"""Mean travel of the widest section in Sauter diameters, at least: half of it may be transient. Measured after 3 d: the
test reactor had a statistical error of 4.8 % in its worst section; after 7.7 d the smoke scene 3.2 %."""

LEAST_TURNOVER = 0.25
"""Part of the vessel's content that the plate takes away, at least: a bed that begins to flow dilates by one or two
parts in a hundred, which must be little against the flow (the test reactor needed 0.17)."""

NOISE = 0.1
"""Statistical error after a travel of one diameter; it falls with the square root of the travel (measured: 0.083 on the
test reactor, 0.088 on the smoke scene)."""

TRANSIENT = 2.0
"""Time of a run over the time that is averaged, where the plate has one speed."""

STEADY = 1.4
"""The same after a faster start, without the start itself."""

SNAPSHOT_TRAVEL = 0.1
"""Plate travel between snapshots, in Sauter diameters: a throat moves several times faster than the plate."""

START_TURNOVER = 1 / 12
"""Part of the vessel's content that the plate takes away in a faster start: how far the flow has developed is a matter
of travel, not of time. The data are steady after 0.08 to 0.11 of it (the smoke scene, the test reactor)."""

LEAST_START = 1.0
"""Travel of a faster start in Sauter diameters, at least: contacts follow within some strain of the bed."""

LEAST_START_SEGMENTS = 6
"""The same in segments: fewer do not make a speed."""

AFTER_START = 0.1
"""Travel after a faster start that is not averaged, in Sauter diameters, whatever the data say: speeds follow the
plate's at once. More leaves the test reactor's field no nearer to the truth (`benchmarks/onset.py after`)."""

RESERVE = 2.0
"""`auto` over the time that an error is expected to need: a run ends when it is reached."""

ROOM = 8.0
"""Room for the plate over the least travel: it costs nothing but empty cells of LIGGGHTS' bins."""

MOST_SEGMENTS = 1024
"""Segments that fill the room: a segment is one interval between snapshots, or more of them where that would make more
segments than this, so that memory and disk that their sums take do not grow with the run."""


@dataclass(frozen=True)
class Duration:
    """How long a run lasts; times in s of simulated time at the plate's final speed.

    Parameters
    ----------
    time : of production, at the most, a faster start not counted
    least : the shortest that is expected to give a field
    expected : what the error asked for is expected to need; 0 where none is asked for
    room : in which the plate would sink through all the room that the box has
    start_travel : of the plate in a faster start, what is not averaged after it included [m]; 0 without one
    longest : that the room leaves after the start
    """

    time: float
    least: float
    expected: float
    room: float
    start_travel: float
    longest: float

    @property
    def needed(self) -> float:
        """The shortest time to be advised."""
        return max(self.least, self.expected)

    @property
    def warning(self) -> str:
        """What is to be said of a time that is too short, with a better one; empty where it is long enough."""
        if self.time >= 0.9 * self.needed:
            return ""
        why = "for the error asked for" if self.expected > self.least else "for a steady field"
        return f"{self.time:.3g} s may be too short {why}: try {two_digits_up(self.needed):g} s or auto"


def duration(
    given: float | None,
    error: float | None,
    speed: float,
    ratio: float,
    filled: float,
    diameter: float,
    start: float = 0.0,
) -> Duration:
    """Choose or judge the time of production.

    Parameters
    ----------
    given : time of the case [s]; None to choose
    error : statistical error that the case asks for; None where it asks for none
    speed : mean speed of the bed in the outlet [m/s]
    ratio : free area of the widest section over that of the outlet
    filled : volume of the vessel over the outlet's area [m]
    diameter : Sauter diameter of the particles [m]
    start : travel of the plate at a higher speed, before anything is averaged [m]; 0 for none
    """
    travel = max(LEAST_TRAVEL * diameter * ratio, LEAST_TURNOVER * filled)
    least = (travel - start) / speed
    averaged = 0.0 if error is None else (NOISE / error) ** 2 * diameter * ratio / speed
    expected = (STEADY if start else TRANSIENT) * averaged
    chosen = two_digits_up(max(least, RESERVE * expected))
    time, room = chosen if given is None else given, two_digits_up(ROOM * travel / speed)
    before = start + AFTER_START * diameter if start else 0.0
    while room < time + before / speed:
        room *= 2
    return Duration(time, least, expected, room, before, room - before / speed)


def start_pays(length: Duration, speed: float, diameter: float, most_segments: int = MOST_SEGMENTS) -> bool:
    """Whether a faster start, which the length of a run holds, saves more than what is left out after it.

    Parameters
    ----------
    speed : final speed of the plate [m/s]
    diameter : Sauter diameter of the particles [m]
    most_segments : that the room is cut into
    """
    start = length.start_travel - AFTER_START * diameter
    segment = max(SNAPSHOT_TRAVEL * diameter, speed * length.room / most_segments)
    return start >= max(LEAST_START * diameter, LEAST_START_SEGMENTS * segment)


def dumps_per_segment(room: float, interval: float, most: int = MOST_SEGMENTS) -> int:
    """Snapshots in a segment, `interval` [s] apart, for a run that may fill its room [s] with so many segments."""
    return max(1, math.ceil(room / interval / most))
