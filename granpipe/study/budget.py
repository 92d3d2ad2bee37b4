"""The parts of an error, the options that no other beats, and which of them to recommend."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Annotated

from pydantic import Field, PositiveInt
from scipy.special import chdtri

Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]

TOLERANCES = (0.02, 0.05, 0.1, 0.2)
"""Total errors for which a setting is recommended."""

SAME_LENGTH = 1.001
"""Times of two fillings that differ by less are the same: they are told in four digits."""

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


Measure = Callable[[Option], float]
"""Of an option's error."""


def upper_bound(section: str = "whole") -> Measure:
    """The 95 % bound of the error."""
    return lambda option: option.error(section).upper


def estimate(section: str = "whole") -> Measure:
    """The error itself."""
    return lambda option: option.error(section).value


def pareto(options: Iterable[Option], section: str = "whole") -> list[Option]:
    """Options that no other beats in both time and proven error (the upper bound), the cheapest first.

    Of options that differ in their filling alone the worst counts.
    """
    front: list[Option] = []
    usual = worst_fillings(options, upper_bound(section))
    for option in sorted(usual, key=lambda o: (o.core_seconds, o.error(section).upper)):
        if not front or option.error(section).upper < front[-1].error(section).upper:
            front.append(option)
    return front


def worst_fillings(options: Iterable[Option], measure: Measure) -> list[Option]:
    """Options but for those to which another filling of the same settings says something worse.

    Another filling counts where it ran as long: by its longest average that is no longer. Where it has no field by
    then, or was not averaged with this method, the option is left out.

    Parameters
    ----------
    measure : of the error
    """
    alike: dict[frozenset[tuple[str, str | float]], list[Option]] = {}
    for option in options:
        alike.setdefault(_settings(option), []).append(option)
    return [option for some in alike.values() for option in some if _is_worst(option, some, measure)]


def _is_worst(option: Option, alike: Sequence[Option], measure: Measure) -> bool:
    """Whether no other filling among these has a larger error, nor is without a field."""
    for filling in {other.changes.get("dem.seed") for other in alike} - {option.changes.get("dem.seed")}:
        others = [other for other in alike if other.changes.get("dem.seed") == filling]
        if max(map(_time, others)) * SAME_LENGTH < _time(option):
            continue
        reached = SAME_LENGTH * _time(option)
        sooner = [other for other in others if other.method == option.method and _time(other) <= reached]
        if not sooner or measure(max(sooner, key=_time)) > measure(option):
            return False
    return True


def _time(option: Option) -> float:
    """Simulated time of its run [s]; 0 where no number tells it, as of a hybrid with a unit or `auto`."""
    time = _value(option.changes.get("dem.max_time", ""))
    return time if isinstance(time, float) else 0.0


def _settings(option: Option) -> frozenset[tuple[str, str | float]]:
    """What makes an option's runs what they are, but for their filling and length; numbers as such."""
    averaging = ("dem.seed", "dem.max_time", "homogenize.")
    return frozenset((key, _value(text)) for key, text in option.changes.items() if not key.startswith(averaging))


def _value(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


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
    fields = [option for option in options if option.method != PLAIN]
    for proven, measure in ((True, upper_bound(section)), (False, estimate(section))):
        good = [option for option in worst_fillings(fields, measure) if measure(option) <= tolerance]
        if good:
            return Advice(tolerance, min(good, key=lambda o: o.core_seconds), proven)
    return Advice(tolerance, None, proven=False)
