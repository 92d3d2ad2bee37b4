"""Why segments give no field, told in numbers: an arch, a feed that does not keep up, or too short a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np

from granpipe.dem.contact import two_digits_up
from granpipe.dem.filling import PACKING
from granpipe.dem.health import ArchError
from granpipe.dem.settings import Settings
from granpipe.errors import DataError
from granpipe.field import Array, level_flow
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Sums, merge
from granpipe.pipeline.gates import STORAGE
from granpipe.pipeline.production import Production
from granpipe.planning.plan import Plan

Cause = Literal["arch", "feed", "short"]

HELD = 0.2
"""Flow of a level over that of the plate below which something holds the solids up there."""

SCARCE = 0.8
"""The same at the inlet: less does not replace what the plate takes away."""

EMPTIED = 0.7
"""Solids in the uppermost tenth of the vessel at the end, over those at the start, below which the feed is too slow."""

ROOMY = 10.0
"""Width of an opening over d90 at which arches are not expected."""

MOST_MORE = 10.0
"""Longest time to be advised, over the time of the run: what would need more is not short but stuck."""


class NoFieldError(DataError):
    """A run has ended, or was stopped, whose segments give no field.

    `story` is what they tell all the same, `kept` the folder where that has been written.
    """

    def __init__(self, message: str, story: Story) -> None:
        super().__init__(message)
        self.message, self.story = message, story
        self.kept: Path | None = None

    def __str__(self) -> str:
        kept = f"; report and pictures in {self.kept}" if self.kept else ""
        evidence = f"\nevidence: {self.evidence}" if self.evidence else ""
        return f"{self.message}; {self.story.text}{kept}{evidence}"


@dataclass(frozen=True)
class Levels:
    """Flow through every level over that of the plate, (nz+1,) each.

    Parameters
    ----------
    flow : of the plate, solids [m³/s]
    z : of the levels [m]
    whole, late : on average over the whole run, and over its last third
    gathers : solids that gather in the row below each level over the flow of the plate, over the whole run; (nz,)
    """

    flow: float
    z: Array
    whole: Array
    late: Array
    gathers: Array


@dataclass(frozen=True)
class Story:
    """What a run without a field tells.

    Parameters
    ----------
    plan : of the run
    productions : what there is of it
    reason : why there is no field
    cause : what kind of fault it is
    text : the cause in words and numbers, and what to do
    levels : flow through every level
    """

    plan: Plan
    productions: tuple[Production, ...]
    reason: str
    cause: Cause
    text: str
    levels: Levels


def no_field(reason: str, plan: Plan, productions: Sequence[Production], segments: Sequence[Sums]) -> NoFieldError:
    """The error of a run whose segments give no field, for a reason that the averaging told."""
    one_run = _at_final_speed([sums for sums in segments if sums.run == segments[0].run], plan.dem)
    levels = _levels(one_run, plan)
    cause, text = diagnose(one_run, levels, plan)
    return NoFieldError(reason, Story(plan, tuple(productions), reason, cause, text, levels))


def held_up(error: ArchError, plan: Plan, productions: Sequence[Production], segments: Sequence[Sums]) -> NoFieldError:
    """The error of a run that was stopped because hardly anything passed an opening any more."""
    level = int(np.abs(segments[0].grid.z_edges - error.z).argmin())
    by_run = groupby(segments, key=lambda sums: sums.run)
    runs = [_at_final_speed(list(run), plan.dem) for _, run in by_run]
    worst = min(runs, key=lambda run: float(np.mean(run[-1].level_flow[:, level])))
    levels = _levels(worst, plan)
    text = f"{error.remedy}; hardly any pass it since {_since(worst, level, levels):.3g} s"
    told = NoFieldError(error.seen, Story(plan, tuple(productions), error.seen, "arch", text, levels))
    told.evidence = error.evidence
    return told


def diagnose(segments: Sequence[Sums], levels: Levels, plan: Plan) -> tuple[Cause, str]:
    """What kind of fault it is, and what to do about it."""
    outline, settings = plan.simulated, plan.dem
    held = np.flatnonzero(levels.late < HELD)
    emptied = _emptied(segments, outline)
    if emptied < EMPTIED and levels.late[-1] < SCARCE:
        speed = max(levels.late[-1], 0.1) * settings.plate_speed
        slower = "" if settings.open_outlet else f": dem.plate_speed of {speed:.2g} m/s or less"
        return "feed", (
            f"the filling runs out: the inlet brings {levels.late[-1]:.0%} of what leaves, and the top holds "
            f"{emptied:.0%} of what it held; let it flow more slowly{slower}, or widen the inlet"
        )
    if len(held):
        return "arch", _arch(levels, int(held[0]), _since(segments, int(held[0]), levels), plan)
    return "short", _too_short(segments, levels, settings)


def _arch(levels: Levels, level: int, since: float, plan: Plan) -> str:
    """Where the solids are held up, since when, and how wide it would have to be."""
    z, d90 = float(levels.z[level]), plan.dem.classes.d90
    narrow = find_openings(plan.simulated) if plan.space is None else plan.space.openings
    openings = [one for one in narrow if one.z <= z + one.gap]
    where = f"z = {z:.4g} m"
    remedy = "look there for a place too narrow for the particles"
    if openings:
        near = min(openings, key=lambda one: abs(one.z - z))
        where += f", near the {near.name} of {near.gap / d90:.2g} particle diameters"
        remedy = f"make it {ROOMY * d90:.3g} m wide ({ROOMY:g} diameters), or take smaller particles or less friction"
    return f"an arch holds the solids up at {where}: since {since:.3g} s hardly any pass it; {remedy}"


def _too_short(segments: Sequence[Sums], levels: Levels, settings: Settings) -> str:
    """How long the run should be."""
    ran = _ran(segments)
    needed = time_needed(segments, levels)
    if needed > MOST_MORE * ran:
        needed, sure = MOST_MORE * ran, "at least "
    else:
        sure = ""
    needed = two_digits_up(max(needed, settings.length.least if ran < settings.length.least else 0.0))
    worst = float(np.abs(np.cumsum(levels.gathers)).max())
    return (
        f"the run of {ran:.3g} s is too short: {worst:.0%} of the flow fills or empties the vessel; try {sure}"
        f"dem.max_time: {needed:g} s ({needed - ran:.2g} s more, which continues this run)"
    )


def _at_final_speed(segments: list[Sums], settings: Settings) -> list[Sums]:
    """The segments of one run after a faster start; all where it did not get beyond that."""
    return [sums for sums in segments if sums.start >= settings.average_from * (1 - 1e-9)] or segments


def _ran(segments: Sequence[Sums]) -> float:
    """Time of production without a faster start [s], which is what `dem.max_time` counts."""
    return segments[-1].stop - segments[0].start


def time_needed(segments: Sequence[Sums], levels: Levels) -> float:
    """Time [s] after which what gathers should be within the gate of the storage.

    From its decrease between the two halves of the run, which is taken as exponential; where it does not decrease, as
    1/t: a certain volume that is filled once.
    """
    limit, ran, half = STORAGE.high, _ran(segments), max(1, len(segments) // 2)
    early, late = (_storage(part) / levels.flow for part in (segments[:half], segments[half:] or segments))
    if late <= limit:
        return 1.3 * ran  # the average has only to begin later
    by_volume = ran * late / limit
    if not 0 < late < 0.9 * early:
        return by_volume
    return max(1.3 * ran, min(by_volume, ran * math.log(limit / early) / math.log(late / early)))


def _storage(segments: Sequence[Sums]) -> float:
    """Largest rate at which solids gather below any level [m³/s]."""
    sums = merge(segments)
    return float(np.abs(np.cumsum(sums.row_gain)).max() / sums.duration)


def _plate_flow(plan: Plan) -> float:
    """Solids that leave [m³/s]: by the plate, or by the free discharge that is expected."""
    settings, outline = plan.dem, plan.simulated
    return PACKING * settings.inlet_speed * outline.inlet_area


def _levels(segments: Sequence[Sums], plan: Plan) -> Levels:
    """Flow through every level; what should have left above it, through outlets that lie higher, is counted as well."""
    whole, late, flow = merge(segments), merge(segments[2 * len(segments) // 3 :]), _plate_flow(plan)
    grid = whole.grid
    left = np.zeros(len(grid.z_edges))
    for outlet in () if plan.space is None else plan.space.outlets:
        left += outlet.share * (grid.z_edges < outlet.opening.z - 0.5 * grid.cell)
    return Levels(
        flow=flow,
        z=grid.z_edges,
        whole=level_flow(whole.mean_flux[1], grid) / flow + left,
        late=level_flow(late.mean_flux[1], grid) / flow + left,
        gathers=whole.row_gain / whole.duration / flow,
    )


def _since(segments: Sequence[Sums], level: int, levels: Levels) -> float:
    """When the flow through a level ceased for the last time [s]."""
    flows = [float(np.mean(one.level_flow[:, level])) / levels.flow for one in segments]
    passing = [one.stop for one, share in zip(segments, flows, strict=True) if share >= HELD]
    return passing[-1] if passing else segments[0].start


def _emptied(segments: Sequence[Sums], outline: Outline) -> float:
    """Solids in the uppermost tenth of the vessel in the last segment over those in the first."""
    top = segments[0].grid.z_edges[:-1] > outline.z_top - 0.1 * (outline.z_top - outline.z_bottom)
    first, last = (float(one.mean_volume[top].sum()) for one in (segments[0], segments[-1]))
    return last / first if first > 0 else 1.0
