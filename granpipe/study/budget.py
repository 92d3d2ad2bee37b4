"""The parts of an error, the options that no other beats, and which of them to recommend."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Annotated

from pydantic import Field, PositiveInt
from scipy.special import chdtri

Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]

TOLERANCES = (0.02, 0.05, 0.1, 0.2)
"""Total errors for which a setting is recommended."""

PLAIN = "raw"
"""The plain average: shown to compare with, but no run gives it as its field, so it is not advised."""


def percent(value: float) -> str:
    """With one decimal; two digits below that."""
    return f"{value:.1%}" if value >= 0.001 or value == 0 else f"{100 * value:.2g}%"


@dataclass(frozen=True)
class ErrorBound:
    """One part of an error, noise taken off, and its 95 % upper bound."""

    value: Size
    upper: Size

    @property
    def resolved(self) -> bool:
        """Whether it is larger than its own uncertainty."""
        return 2 * self.value**2 > self.upper**2

    def __str__(self) -> str:
        if self.upper == 0:
            return "0"
        return percent(self.value) if self.resolved else f"unresolved, below {percent(self.upper)}"


@dataclass(frozen=True)
class Option:
    """One way to make the field: a point of the study, a method, and how much of its run is averaged.

    Parameters
    ----------
    point : name of the point
    method : how the average is made a field
    travel : plate travel averaged, in outlet diameters
    seconds : wall time of its stages
    cores : how many cores they kept busy
    statistical : section → standard error of the field
    blocks : how many independent blocks that rests on; infinite where there is no noise
    systematic : section → what is left of the difference from the limit without noise
    from_reference : section → the same, from the reference alone; none where that is of the study itself
    changes : of the case, that make this point; the averaging time among them
    """

    point: str
    method: str
    travel: Size
    seconds: Size
    cores: PositiveInt
    statistical: Mapping[str, Size]
    blocks: Annotated[float, Field(gt=1)]
    systematic: Mapping[str, ErrorBound]
    changes: Mapping[str, str] = field(default_factory=dict)
    from_reference: Mapping[str, ErrorBound] = field(default_factory=dict)

    def against_reference(self) -> Option:
        """The same option, its error against the reference alone."""
        return replace(self, systematic=self.from_reference)

    @property
    def core_seconds(self) -> float:
        """Time of one core that it takes."""
        return self.seconds * self.cores

    def error(self, section: str = "whole") -> ErrorBound:
        """Total error: both parts are independent, so their squares add.

        A standard error from n blocks is itself known only so well: (n − 1) s²/σ² is χ² of n − 1.
        """
        noise, rest = self.statistical[section], self.systematic[section]
        return ErrorBound(hypot(noise, rest.value), hypot(noise * sure_factor(self.blocks), rest.upper))


def sure_factor(blocks: float) -> float:
    """By how much a standard error from so many independent blocks may be too small, at 95 %."""
    if math.isinf(blocks):
        return 1.0
    return float(math.sqrt((blocks - 1) / chdtri(blocks - 1, 0.95)))


def pareto(options: Iterable[Option], section: str = "whole") -> list[Option]:
    """Options that no other beats in both time and proven error (the upper bound), the cheapest first."""
    front: list[Option] = []
    for option in sorted(options, key=lambda o: (o.core_seconds, o.error(section).upper)):
        if not front or option.error(section).upper < front[-1].error(section).upper:
            front.append(option)
    return front


def worst_fillings(options: Iterable[Option], section: str = "whole") -> list[Option]:
    """Of options that differ in their filling alone the one with the highest error, where all these fillings give one.

    A filling without a field after a time has no option of that length: then that length is no option at all. Nor is a
    method that was tried on one of several fillings alone.
    """
    points: dict[object, set[str]] = {}
    alike: dict[object, list[Option]] = {}
    for option in options:
        points.setdefault(_runs(option), set()).add(option.point)
        changes = frozenset(item for item in option.changes.items() if item[0] != "dem.seed")
        alike.setdefault((option.method, changes), []).append(option)
    return [
        max(some, key=lambda option: option.error(section).upper)
        for some in alike.values()
        if {option.point for option in some} == points[_runs(some[0])]
    ]


def _runs(option: Option) -> frozenset[tuple[str, str]]:
    """What makes an option's runs what they are, but for their filling and length."""
    averaging = ("dem.seed", "dem.max_time", "homogenize.")
    return frozenset(item for item in option.changes.items() if not item[0].startswith(averaging))


@dataclass(frozen=True)
class Advice:
    """The cheapest option for a tolerance; `proven` where its upper bound keeps it, not only its estimate."""

    tolerance: float
    option: Option | None
    proven: bool


def advise(options: Sequence[Option], tolerance: float, section: str = "whole") -> Advice:
    """The cheapest option within the tolerance, by its 95 % bound if there is one, else by its estimate.

    Of options that differ in their filling alone the worst counts, not the one that happens to be near the truth.
    """
    usual = worst_fillings([option for option in options if option.method != PLAIN], section)
    for proven in (True, False):
        good = [o for o in usual if (e := o.error(section)) and (e.upper if proven else e.value) <= tolerance]
        if good:
            return Advice(tolerance, min(good, key=lambda o: o.core_seconds), proven)
    return Advice(tolerance, None, proven=False)
