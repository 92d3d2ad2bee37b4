"""What a DEM run costs, by its settings; and whether it is long enough for an average."""

from __future__ import annotations

import math

from granpipe.case.schema import Case
from granpipe.dem.settings import BYTES_PER_PARTICLE, RATE, Settings
from granpipe.errors import CaseError
from granpipe.progress import duration_text
from granpipe.system.rates import RANK_GAIN

FILL_TIME = 2.5
"""Filling takes about this many times the free fall through the vessel where the bed is to come to rest (measured: 2 to
4; see docs/validation/filling.md)."""

LEAST_SEGMENTS = 4
"""The ψ fit weighs the average by how segments differ; up to half of them may be transient."""


def check_duration(case: Case, settings: Settings, cores: int) -> None:
    """CaseError for a production that is too short for an average."""
    averaged = settings.segments - settings.segments_left_out
    if case.homogenize.method == "psi" and averaged < LEAST_SEGMENTS:
        segment = settings.segment_steps * settings.time_step
        steps = (settings.segments_left_out + LEAST_SEGMENTS) * settings.segment_steps
        time = duration_text(wall_seconds(case, settings, steps, cores))
        raise CaseError(
            f"{settings.length.time:g} s is {averaged} segments of {segment:.3g} s; the ψ fit needs {LEAST_SEGMENTS}: "
            f"simulate {LEAST_SEGMENTS * segment:.2g} s or more, which takes about {time} to compute, or set "
            "homogenize.method: gaussian",
            ("dem", "max_time"),
        )
    start = case.homogenize.start
    if start != "auto" and start >= settings.length.time:
        raise CaseError(
            f"must be below the time of production, which is {settings.length.time:g} s: give a longer "
            "dem.max_time, or leave the start out",
            ("homogenize", "start"),
        )


def particle_steps(case: Case, settings: Settings, steps: int) -> float:
    """Of all replicas with so many steps of production, filling included."""
    return case.dem.replicas * settings.particles * (steps + _fill_steps(settings))


def wall_seconds(case: Case, settings: Settings, steps: int, cores: int) -> float:
    """Wall time of that [s]."""
    together = min(case.dem.replicas, max(1, cores // settings.ranks))
    return particle_steps(case, settings, steps) / (together * assumed_rate(settings.ranks))


def assumed_rate(ranks: int) -> float:
    """Particle-steps per second that `Plan.seconds` goes by."""
    return RATE * ranks * (RANK_GAIN if ranks > 1 else 1.0)


def _fill_steps(settings: Settings) -> float:
    if settings.fall_steps:
        return settings.fall_steps
    height = settings.feed_top - settings.plate_z
    return FILL_TIME * math.sqrt(2 * height / settings.gravity) / settings.time_step


def disk_bytes(case: Case, settings: Settings) -> float:
    """Most bytes on disk at once: restart files (about 500 bytes a particle, contacts included) and snapshots."""
    restart = 8 * BYTES_PER_PARTICLE * settings.particles
    snapshots = BYTES_PER_PARTICLE * settings.particles
    kept = {"none": 3, "thinned": settings.segments, "all": settings.steps // settings.dump_every}
    return float(3 * restart + kept[case.dem.keep_snapshots] * snapshots)
