"""The ladder of a study: cheaper and dearer variants of a case, one axis at a time, and what tells most together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from granpipe.case import Case
from granpipe.errors import CaseError
from granpipe.sweep.variants import Variant, name_of

SIZES = (1.5, 1.25, 0.75, 0.5)
"""Coarse-grain factors over that of the case."""

SPEEDS = (2.0, 0.5)
"""Plate speeds over that of the case, at equal travel."""

STIFFNESSES = (0.3, 10.0)
"""Young's moduli over that of the case."""

STEPS = (1.5, 0.5)
"""Time steps over that of the case."""

RESERVOIRS = (0.5, 2.0)
"""Reservoir heights over that of the case."""

FACETS = (0.5, 2.0)
"""Facets of the wall per turn over those of the case."""

_OTHER = 1000  # apart from the seeds of replicas

BASE = "base"
"""Name of the point that is the case itself."""

CHEAP, BEST = "cheap", "best"
"""Axes of the two points at the ends: coarsest and fastest; finest, in two fillings."""

_KEYS = {
    "model": "model",
    "coarse_grain_factor": "dem.coarse_grain_factor",
    "youngs_modulus": "contact.youngs_modulus",
    "time_step": "dem.time_step",
    "reservoir_height": "dem.reservoir_height",
    "facets": "dem.facets",
    "plate_speed": "dem.plate_speed",
    "replicas": "dem.replicas",
    "seed": "dem.seed",
    "ranks": "dem.ranks",
}
"""Axis → key of the case."""


@dataclass(frozen=True)
class Basis:
    """What the planner settled for the case, of which the ladder varies.

    Parameters
    ----------
    youngs_modulus : [Pa]
    time_step : [s]
    plate_speed : [m/s]; 0 where the outlet is open
    reservoir_height : [m]
    facets : of the wall per turn
    model : dem, hybrid or fluid
    models : which of these the scene allows
    cores : that a point may keep busy
    """

    youngs_modulus: float
    time_step: float
    plate_speed: float
    reservoir_height: float
    facets: int
    model: str
    models: tuple[str, ...]
    cores: int = 1


@dataclass(frozen=True)
class Rung:
    """A point of the ladder: along which axis it departs from the case, and how."""

    axis: str
    variant: Variant


Fits = Callable[[Variant], bool]
Axes = Mapping[str, Sequence[str]]
"""Axis → the values that the user gave, as YAML; none for those of the ladder."""


def read_axes(words: Iterable[str]) -> Axes:
    """``name`` or ``name=value,value`` → axes; CaseError for one that there is not."""
    found: dict[str, list[str]] = {}
    for word in words:
        name, _, values = word.partition("=")
        if name not in (*_KEYS, CHEAP, BEST):
            raise CaseError(f"{name} is no axis; there are {', '.join((*_KEYS, CHEAP, BEST))}", place="--axis")
        if values and name in (CHEAP, BEST):
            raise CaseError(f"{name} follows from the other axes; it takes no values", place="--axis")
        found.setdefault(name, []).extend(filter(None, map(str.strip, values.split(","))))
    return found


def ladder(case: Case, basis: Basis, fits: Fits, axes: Axes | None = None) -> tuple[Rung, ...]:
    """Every point, the case itself first.

    Parameters
    ----------
    fits : says whether the scene allows a variant (gaps, models)
    axes : to go along these alone, with these values; CaseError where one has none that the scene allows
    """
    axes = axes or {}
    single = [Rung("", Variant(BASE, {}))]
    for axis, value in _single(case, basis, axes):
        changes = _changes(case, basis, axis, value)
        variant = Variant(name_of({_KEYS[axis]: changes[_KEYS[axis]]}), changes)  # what follows is not in the name
        if fits(variant):
            single.append(Rung(axis, variant))
    rungs = [*single, *(rung for rung in _combined(case, single) if fits(rung.variant))]
    if not axes:
        return tuple(rungs)
    for axis in axes:
        if not any(rung.axis == axis for rung in rungs):
            raise CaseError(f"nothing along {axis} is possible here, or it has no other value", place="--axis")
    return tuple(rung for rung in rungs if not rung.axis or rung.axis in axes)


def _single(case: Case, basis: Basis, axes: Axes) -> Iterator[tuple[str, str]]:
    """Axis and value, one axis at a time; the values that the user gave instead of the usual ones."""
    for axis, usual in _usual(case, basis).items():
        yield from ((axis, value) for value in axes.get(axis) or usual)


def _usual(case: Case, basis: Basis) -> dict[str, list[str]]:
    """Axis → its values."""
    found = {"model": [model for model in basis.models if model != basis.model]}
    if basis.model == "fluid":
        return found
    factors = {max(1.0, case.dem.coarse_grain_factor * part) for part in SIZES} - {case.dem.coarse_grain_factor}
    found |= {
        "coarse_grain_factor": [_text(factor) for factor in sorted(factors)],
        "youngs_modulus": [_text(part * basis.youngs_modulus) for part in STIFFNESSES],
        "time_step": [_text(part * basis.time_step) for part in STEPS],
        "reservoir_height": [_text(part * basis.reservoir_height) for part in RESERVOIRS],
        "facets": [str(4 * round(part * basis.facets / 4)) for part in FACETS],
        "replicas": ["2"],
        "seed": [str(case.dem.seed + _OTHER)],
    }
    if basis.plate_speed > 0:
        found["plate_speed"] = [_text(part * basis.plate_speed) for part in SPEEDS]
    if basis.cores > 1:
        found["ranks"] = ["2"]
    return found


def _changes(case: Case, basis: Basis, axis: str, value: str) -> dict[str, str]:
    """What a value of an axis changes, and what has to go with it."""
    changes = {_KEYS[axis]: value}
    start = 0.0 if case.homogenize.start == "auto" else float(case.homogenize.start)
    if axis == "replicas":  # together they average as long as the case does
        count = case.varied(changes).dem.replicas
        changes["dem.max_time"] = _text(start + (case.dem.max_time - start) / count)
    elif axis == "plate_speed":  # equal travel
        part = float(case.varied(changes).dem.plate_speed) / basis.plate_speed
        changes["dem.max_time"] = _text(case.dem.max_time / part)
        if start:
            changes["homogenize.start"] = _text(start / part)
    elif axis == "ranks":  # another filling, for what is in the store would be taken whatever the ranks
        changes["dem.seed"] = str(case.dem.seed + 2 * _OTHER)
    return changes


def _combined(case: Case, single: Sequence[Rung]) -> Iterator[Rung]:
    """Coarsest with fastest, which is the cheapest; finest in two fillings, which is the best."""

    def of(axis: str, key: str, usual: float) -> list[tuple[float, Variant]]:
        rungs = [rung.variant for rung in single if rung.axis in ("", axis)]
        return sorted(((float(v.changes.get(key, usual)), v) for v in rungs), key=lambda pair: pair[0])

    sizes = of("coarse_grain_factor", "dem.coarse_grain_factor", case.dem.coarse_grain_factor)
    speeds = [rung.variant for rung in single if rung.axis == "plate_speed"]
    if speeds and (size := sizes[-1][1]).changes:
        fast = max(speeds, key=lambda variant: float(case.varied(variant.changes).dem.plate_speed))
        yield Rung(CHEAP, Variant(f"{size.name}-{fast.name}", size.changes | fast.changes))
    if (size := sizes[0][1]).changes:
        yield Rung(BEST, Variant(f"{size.name}-replicas-2", size.changes | {"dem.replicas": "2"}))


def affordable(rungs: Sequence[Rung], cost: Callable[[Rung], float], budget: float) -> tuple[list[Rung], list[Rung]]:
    """Rungs that a budget allows and those that it does not, the dearest dropped first, the case itself never.

    Parameters
    ----------
    cost : of a rung, in the unit of the budget
    """
    costs = {rung.variant.name: cost(rung) for rung in rungs}
    kept, dropped = list(rungs), []
    while sum(costs[rung.variant.name] for rung in kept) > budget and len(kept) > 1:
        dearest = max(kept[1:], key=lambda rung: costs[rung.variant.name])
        kept.remove(dearest)
        dropped.append(dearest)
    return kept, dropped


def _text(value: float) -> str:
    """As YAML, four digits."""
    text = f"{value:.4g}"
    return repr(float(text)) if "e" in text else text
