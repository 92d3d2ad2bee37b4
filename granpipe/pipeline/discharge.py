"""Free discharge: the rate of the average with its standard error, beside LIGGGHTS' own count."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from granpipe.field import level_flow
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import plug_levels
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, standard_error
from granpipe.pipeline.gates import DISCHARGE, Gate
from granpipe.pipeline.records import SegmentRecord


@dataclass(frozen=True)
class Discharge:
    """Rate of a free discharge.

    Parameters
    ----------
    kg_per_s : of the average, through the levels next to the outlet
    standard_error : of it [kg/s]; None where there are too few segments
    counted_kg_per_s : what LIGGGHTS counted at its catcher while that average was made; None where it counted nothing
    """

    kg_per_s: float
    standard_error: float | None
    counted_kg_per_s: float | None

    def times(self, factor: float) -> Discharge:
        """That of a vessel which is so many times as deep."""
        known = {name: value * factor for name, value in asdict(self).items() if value is not None}
        return replace(self, **known)

    @property
    def gates(self) -> tuple[Gate, ...]:
        """Whether both agree."""
        if self.counted_kg_per_s is None:
            return ()
        apart = abs(self.kg_per_s / self.counted_kg_per_s - 1)
        high = max(DISCHARGE.high, 2 * (self.standard_error or 0.0) / self.kg_per_s)
        return (replace(DISCHARGE, high=high).gate(apart),)

    @property
    def figures(self) -> dict[str, Any]:
        """For ``provenance.json``."""
        return asdict(self)

    def __str__(self) -> str:
        return describe(self.figures)


def describe(figures: Mapping[str, float | None]) -> str:
    """The figures of a discharge in words."""
    error, counted = figures["standard_error"], figures["counted_kg_per_s"]
    text = f"{figures['kg_per_s']:.4g}" + ("" if error is None else f" ± {error:.2g}") + " kg/s"
    return text if counted is None else f"{text}; LIGGGHTS' own counter: {counted:.4g} kg/s"


def measure_discharge(
    steady: Sequence[Sums],
    z_range: tuple[float, float],
    density: float,
    reports: Mapping[int, Sequence[SegmentRecord]],
    time_step: float,
) -> Discharge:
    """The discharge rate of an average.

    Parameters
    ----------
    steady : segments of the average
    z_range : levels next to the outlet [m]
    density : of the solids [kg/m³]
    reports : of each run by its number, what its segments noted of themselves
    time_step : [s]
    """

    def rate(sums: Sums) -> float:
        levels = plug_levels(sums.grid, z_range)
        return density * float(level_flow(sums.mean_flux[1], sums.grid)[levels].mean())

    error = None
    if len(steady) >= LEAST_BLOCKS:
        error = float(standard_error(np.array([rate(block) for block in blocks(steady)])))
    starts = {sums.run: sums.start for sums in reversed(steady)}
    counted = [
        pair
        for run, start in starts.items()
        for pair in _counted(reports[run], (start + 0.5 * steady[0].duration) / time_step)
    ]
    time = sum(steps for _, steps in counted) * time_step
    return Discharge(rate(merge(steady)), error, sum(mass for mass, _ in counted) / time if time > 0 else None)


def _counted(reports: Sequence[SegmentRecord], first_step: float) -> Iterator[tuple[float, float]]:
    """Mass [kg] and steps between the ends of neighbouring segments of the average, by one process each."""
    for one, other in pairwise(reports):
        same_process = other.wall_seconds > one.wall_seconds
        if same_process and one.counted_to_step >= first_step - 1:
            yield (
                other.discharged_mass_kg - one.discharged_mass_kg,
                other.counted_to_step - one.counted_to_step,
            )
