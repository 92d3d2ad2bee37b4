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
"""Time of a run over the time that is averaged."""

RESERVE = 2.0
"""`auto` over the time that an error is expected to need: a run ends when it is reached."""

ROOM = 8.0
"""Room for the plate over the shortest sensible run: it costs nothing but empty cells of LIGGGHTS' bins."""

MOST_SEGMENTS = 1024
"""Segments that fill the room: a segment is one interval between snapshots, or more of them where that would make more
segments than this, so that memory and disk that their sums take do not grow with the run."""


@dataclass(frozen=True)
class Duration:
    """How long a run lasts; times in s of simulated time.

    Parameters
    ----------
    time : of production, at the most
    least : the shortest that is expected to give a field
    expected : what the error asked for is expected to need; 0 where none is asked for
    room : what the box has room for
    """

    time: float
    least: float
    expected: float
    room: float

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
    given: float | None, error: float | None, speed: float, ratio: float, filled: float, diameter: float
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
    """
    least = max(LEAST_TRAVEL * diameter * ratio, LEAST_TURNOVER * filled) / speed
    travel = 0.0 if error is None else TRANSIENT * (NOISE / error) ** 2
    expected = travel * diameter * ratio / speed
    chosen = two_digits_up(max(least, RESERVE * expected))
    time, room = chosen if given is None else given, two_digits_up(ROOM * least)
    while room < time:
        room *= 2
    return Duration(time, least, expected, room)


def dumps_per_segment(room: float, interval: float) -> int:
    """Snapshots in a segment, `interval` [s] apart, for a run that may fill its room [s]."""
    return max(1, math.ceil(room / interval / MOST_SEGMENTS))
