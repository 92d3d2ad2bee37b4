"""Dumps that a user has, read and summed in segments, and what is told of the field that they give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from granpipe.dem.snapshot import Snapshot
from granpipe.field import Field, Grid, Mask
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import enclosed
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.dump_checks import held_solids
from granpipe.pipeline.dump_survey import JUMP, Survey
from granpipe.pipeline.dump_window import Request, window
from granpipe.pipeline.extra_fields import ExtraSums
from granpipe.pipeline.gates import Gate, run_notes
from granpipe.progress import counted

_SEGMENTS = 40
_CHANGE = 0.05  # of the solids, during the average


@dataclass(frozen=True)
class Homogenized:
    """A field, and how it was made.

    sampling : how the flow was sampled, with the reason
    method : what was made of the average, with the reason
    gates : measured figures with limits
    notes : what the user should keep in mind
    figures : more figures
    """

    field: Field
    sampling: str
    method: str
    gates: tuple[Gate, ...]
    notes: tuple[str, ...]
    figures: dict[str, Any]

    @property
    def failed(self) -> list[Gate]:
        """Gates that mark the field."""
        return [gate for gate in self.gates if not gate.passed]


def most_segments(request: Request) -> int:
    """How many segments are held at once; each is a grid in space."""
    return 2 * LEAST_BLOCKS if request.frame.plane == "xyz" else _SEGMENTS


def summed_dumps(
    request: Request, grid: Grid, found: Survey, summed: ExtraSums | None = None
) -> tuple[Collector, list[Sums]]:
    """The dumps in segments of equal numbers of samples."""
    by_path = not found.unfollowed
    jump = JUMP * found.diameter if by_path else None
    extras = summed.extras if summed else ()
    collector = Collector(grid, "displacement" if by_path else "velocity", jump=jump, extras=extras)
    samples = len(found.times) - by_path
    length = -(-samples // most_segments(request))
    segments: list[Sums] = []
    count = -1 if by_path else 0
    for time, snapshot in window(request):
        if not len(snapshot):
            continue
        at_rest = {} if found.has_velocities else dict.fromkeys(("vx", "vy", "vz"), 0.0)
        collector.add(time, snapshot.having(**at_rest) if at_rest else snapshot)
        count += 1
        if summed is not None and count > 0:  # the first of a pair belongs to no segment
            collector.observe(summed.seen(snapshot))
        if count == length:
            segments.append(collector.take())
            count = 0
    if count:
        segments = [*segments[:-1], merge([*segments[-1:], collector.take()])]
    return collector, segments


def told_of(
    field: Field, method: str, gates: list[Gate], found: Survey, collector: Collector, figures: dict[str, Any]
) -> Homogenized:
    """The result with its figures and notes."""
    first, last = found.solids_within[0], found.solids_within[-1]
    total, within, held = found.mean(found.solids), found.mean(found.solids_within), held_solids(field)
    notes = run_notes(figures)
    if found.empty:
        notes.append(
            f"left out: {counted(len(found.empty), 'snapshot')} without particles (first at step {found.empty[0]})"
        )
    if abs(last - first) > _CHANGE * max(first, last):
        notes.append(f"the solids change from {first:.3g} to {last:.3g} m³ during the average (--start, --stop)")
    if total - held > 1e-6 * total:
        notes.append(f"{1 - held / total:.2%} of the solids lie outside the field")
    if collector.jumps:
        notes.append(f"{collector.jumps} jumps farther than particles move are taken as leaving and entering")
    figures = figures | {
        "snapshots": len(found.times),
        "averaged_from_s": found.times[0],
        "averaged_to_s": found.times[-1],
        "particles": found.particles,
        "sauter_diameter_m": found.diameter,
        "solids_m3": total,
        "solids_between_the_levels_m3": within,
        "solids_in_the_field_m3": held,
        "bulk_packing": field.bulk_packing,
        "jumps": collector.jumps,
        "empty_snapshots": len(found.empty),
    }
    reason = found.unfollowed
    sampling = f"velocities in the snapshots: {reason}" if reason else "displacement between snapshots"
    return Homogenized(field, sampling, method, tuple(gates), tuple(notes), figures)


def inside_outline(outline: Outline) -> Callable[[Snapshot], Mask]:
    """Tells which particles are centred between axis (or left wall), wall and obstacles."""
    axial = outline.measure.axial
    walls = [outline.wall] if axial else [outline.wall, outline.left]
    pairs = [(wall[:-1], wall[1:]) for wall in walls]
    pairs += [(polygon, np.roll(polygon, -1, axis=0)) for polygon in outline.obstacles.values()]
    edges = np.concatenate([np.stack(pair, axis=1) for pair in pairs])

    def inside(snapshot: Snapshot) -> Mask:
        x, y, z = snapshot.position.T
        return enclosed(np.column_stack([outline.measure.across(x, y), z]), edges)

    return inside
