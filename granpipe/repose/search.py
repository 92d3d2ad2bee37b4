"""The search: heaps over the whole plane of friction, then more of them near the pairs that give the angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.settings import RATE
from granpipe.errors import CaseError
from granpipe.fluid.bulk_friction import bulk_friction_law
from granpipe.pipeline.gates import Gate, Limit
from granpipe.planning.bulk_friction import repose_of
from granpipe.progress import Progress, counted, duration_text
from granpipe.repose.heap import DISCARDED, DROPS, FILL_ANGLE, Pair
from granpipe.repose.heaps import Asked, HeapRecord, Heaps
from granpipe.repose.response import LEAST, MOST, Crossing, Response, fit
from granpipe.system.rates import Rates

FRICTIONS, ROLLINGS = (0.15, 0.4, 0.9), (0.02, 0.12, 0.4)
"""Of the first heaps, every one with every other: the same for all angles, so that a second angle finds them done."""

NEAR = 6
"""Heaps near the pairs that give the angle."""

FLATTEST, STEEPEST = math.radians(10), FILL_ANGLE
"""Angles of repose that are looked for at all: spheres without friction lie flatter, none stand steeper."""

MISFIT = Limit(
    "scatter of heaps about the fitted surface, over that of the slopes of one heap",
    "repose",
    "The surface must follow the heaps as well as one heap repeats itself.",
    high=2.5,
    remedy="the sizes may be too different; try a narrower material.size",
)


MOTION = Limit(
    "mean kinetic energy of the liveliest heap at rest, in particle weights times diameters",
    "repose",
    "A heap that still flows is not at its angle of repose.",
    high=0.01,
)

GATES = (MISFIT, MOTION)


@dataclass(frozen=True)
class Found:
    """What a search has found.

    Parameters
    ----------
    angle, angle_error : asked for, and its standard error [rad]
    valley : pairs that give the angle, by rising sliding friction
    best : the recommended pair
    frictions : 95 % range of the sliding friction at the rolling friction of the recommended pair
    kept : whether the sliding friction is that of the case
    expected : angle that shear cells and the surfaces below widenings let expect for that pair [rad]
    """

    angle: float
    angle_error: float
    asked: tuple[Asked, ...]
    records: tuple[HeapRecord, ...]
    response: Response
    valley: tuple[Crossing, ...]
    best: Crossing
    frictions: tuple[float, float]
    kept: bool
    expected: float

    @property
    def failed(self) -> tuple[Gate, ...]:
        """Gates that do not hold."""
        motion = max(energy for record in self.records for energy in record.motion[DISCARDED:])
        gates = MISFIT.gate(self.response.scatter / self.noise), MOTION.gate(motion)
        return tuple(gate for gate in gates if not gate.passed)

    @property
    def noise(self) -> float:
        """Standard error of the slope of one heap, from the scatter of its own slopes."""
        variance = np.mean([record.scatter**2 for record in self.records])
        return math.sqrt(float(variance) / (DROPS - DISCARDED))


def search(
    case: Case, angle: float, angle_error: float, heaps: Heaps, rates: Rates | None, cores: int, progress: Progress
) -> Found:
    """Find the friction pairs whose heaps have an angle of repose.

    Parameters
    ----------
    angle, angle_error : measured, and its standard error [rad]

    Raises
    ------
    CaseError : no friction of the contacts gives this angle, or the case has no rolling friction
    RunError : LIGGGHTS failed
    """
    check(case, angle)
    slope, error = math.tan(angle), angle_error / math.cos(angle) ** 2
    first = [Asked(Pair(friction, rolling), 1) for friction in FRICTIONS for rolling in ROLLINGS]
    share = heaps.particle_steps(first)
    if share > 0:
        rate = RATE if rates is None else rates.of(1)
        whole = share * (1 + NEAR / len(heaps.missing(first)))
        progress.note(
            f"forecast: about {duration_text(whole / rate / min(cores, NEAR))} for "
            f"{len(heaps.missing(first)) + NEAR} heaps on {counted(cores, 'core')}"
        )
    records = heaps.run(first, "heaps")
    response = _fitted(first, records)
    _check_reach(response, angle)
    near = [Asked(pair, 2 + number) for number, pair in enumerate(_spread(_valley(response, slope, error)))]
    records += heaps.run(near, "heaps near the angle")
    asked = [*first, *near]
    response = _fitted(asked, records)
    _check_reach(response, angle)
    valley = _valley(response, slope, error)
    best = min(valley, key=lambda one: abs(one.pair.friction - case.contact.friction))
    if (own := response.crossing(case.contact.friction, slope, error)) is not None:
        best = own
    law = bulk_friction_law()
    return Found(
        angle=angle,
        angle_error=angle_error,
        asked=tuple(asked),
        records=tuple(records),
        response=response,
        valley=tuple(valley),
        best=best,
        frictions=response.frictions(best.pair.rolling, slope, error),
        kept=own is not None,
        expected=repose_of(law.internal(best.pair.friction, best.pair.rolling)),
    )


def check(case: Case, angle: float) -> None:
    """Refuse at once what no heaps can answer.

    Raises
    ------
    CaseError : the angle, or a case without rolling friction
    """
    if not FLATTEST <= angle <= STEEPEST:
        raise CaseError(
            f"an angle of repose of {math.degrees(angle):.3g}° is not one of spheres with friction: they lie at "
            f"{math.degrees(FLATTEST):.0f}° to {math.degrees(STEEPEST):.0f}°",
            place="--angle",
        )
    if case.contact.rolling_model == "none":
        raise CaseError(
            "is none, but the angle is set by sliding and rolling friction; choose epsd2",
            ("contact", "rolling_model"),
        )


def _fitted(asked: Sequence[Asked], records: Sequence[HeapRecord]) -> Response:
    return fit([one.pair for one in asked], [record.slope for record in records])


def _check_reach(response: Response, angle: float) -> None:
    low, high = response.reach
    if not low < math.tan(angle) < high:
        ends = [f"{math.degrees(math.atan(slope)):.1f}°" for slope in (low, high)]
        raise CaseError(
            f"{math.degrees(angle):.3g}° is outside what friction reaches: heaps of these particles stand at {ends[0]} "
            f"(friction {LEAST.friction:g}, rolling_friction {LEAST.rolling:g}) to {ends[1]} (friction "
            f"{MOST.friction:g}, rolling_friction {MOST.rolling:g})",
            place="--angle",
        )


def _valley(response: Response, slope: float, error: float) -> list[Crossing]:
    """Pairs that give the slope, at sliding frictions of two digits."""
    frictions = np.round(np.arange(LEAST.friction, MOST.friction + 1e-9, 0.02), 2)
    found = [response.crossing(float(friction), slope, error) for friction in frictions]
    return [one for one in found if one is not None]


def _spread(valley: Sequence[Crossing]) -> list[Pair]:
    """Some pairs of the valley, evenly along it, to three digits so that they read well."""
    points = np.array([[one.pair.friction, one.pair.rolling] for one in valley])
    extent = np.array([MOST.friction - LEAST.friction, MOST.rolling - LEAST.rolling])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points / extent, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], NEAR + 2)[1:-1] if way[-1] > 0 else np.zeros(NEAR)
    return [Pair(*(float(f"{np.interp(one, way, column):.3g}") for column in points.T)) for one in at]
