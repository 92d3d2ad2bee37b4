"""The ladder of a study: cheaper and dearer variants of a case, one axis at a time, and what tells most together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from granpipe.case import Case
from granpipe.errors import CaseError
from granpipe.study.variants import Variant, name_of

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

_OTHER = 1000  # apart from the seeds of replicas

BASE = "base"
"""Name of the point that is the case itself."""

CHEAP, BEST = "cheap", "best"
"""Axes of the two points at the ends of sizes and speeds together."""


@dataclass(frozen=True)
class Basis:
    """What the planner settled for the case, of which the ladder varies.

    Parameters
    ----------
    youngs_modulus : [Pa]
    time_step : [s]
    plate_speed : [m/s]; 0 where the outlet is open
    reservoir_height : [m]
    model : dem, hybrid or fluid
    models : which of these the scene allows
    cores : that a point may keep busy
    """

    youngs_modulus: float
    time_step: float
    plate_speed: float
    reservoir_height: float
    model: str
    models: tuple[str, ...]
    cores: int = 1


@dataclass(frozen=True)
class Rung:
    """A point of the ladder: along which axis it departs from the case, and how."""

    axis: str
    variant: Variant


Fits = Callable[[Variant], bool]


def ladder(case: Case, basis: Basis, fits: Fits) -> tuple[Rung, ...]:
    """Every point, the case itself first; `fits` says whether the scene allows a variant (gaps, models)."""
    rungs = [Rung("", Variant(BASE, {}))]
    for axis, changes in _single(case, basis):
        first = next(iter(changes))  # what follows from it need not be in the name
        variant = Variant(name_of({first: changes[first]}), changes)
        if fits(variant):
            rungs.append(Rung(axis, variant))
    rungs += [rung for rung in _combined(case, rungs) if fits(rung.variant)]
    return tuple(rungs)


def _single(case: Case, basis: Basis) -> Iterator[tuple[str, dict[str, str]]]:
    """One axis at a time."""
    for model in basis.models:
        if model != basis.model:
            yield "model", {"model": model}
    if basis.model == "fluid":
        return
    factors = {max(1.0, case.dem.coarse_grain_factor * part) for part in SIZES} - {case.dem.coarse_grain_factor}
    for factor in sorted(factors):
        yield "coarse_grain_factor", {"dem.coarse_grain_factor": _text(factor)}
    for part in STIFFNESSES:
        yield "youngs_modulus", {"contact.youngs_modulus": _text(part * basis.youngs_modulus)}
    for part in STEPS:
        yield "time_step", {"dem.time_step": _text(part * basis.time_step)}
    for part in RESERVOIRS:
        yield "reservoir_height", {"dem.reservoir_height": _text(part * basis.reservoir_height)}
    if basis.plate_speed > 0:
        for part in SPEEDS:
            yield "plate_speed", _at_speed(case, part, basis.plate_speed)
    yield "replicas", {"dem.replicas": "2", "dem.max_time": _text(_halved(case))}
    yield "seed", {"dem.seed": str(case.dem.seed + _OTHER)}
    if basis.cores > 1:  # another filling, for what is in the store would be taken whatever the ranks
        yield "ranks", {"dem.ranks": "2", "dem.seed": str(case.dem.seed + 2 * _OTHER)}


def _halved(case: Case) -> float:
    """Production time of each of two replicas that together average as long as the case does."""
    start = 0.0 if case.homogenize.start == "auto" else float(case.homogenize.start)
    return start + 0.5 * (case.dem.max_time - start)


def _at_speed(case: Case, part: float, speed: float) -> dict[str, str]:
    """Another plate speed at equal travel."""
    changes = {"dem.plate_speed": _text(part * speed), "dem.max_time": _text(case.dem.max_time / part)}
    if case.homogenize.start != "auto":
        changes["homogenize.start"] = _text(float(case.homogenize.start) / part)
    return changes


def _combined(case: Case, single: Sequence[Rung]) -> Iterator[Rung]:
    """Coarsest with fastest, which is the cheapest; finest with slowest, which is the best."""

    def factor(variant: Variant) -> float:
        return float(variant.changes.get("dem.coarse_grain_factor", case.dem.coarse_grain_factor))

    sizes = [rung.variant for rung in single if rung.axis in ("", "coarse_grain_factor")]
    speeds = [rung.variant for rung in single if rung.axis == "plate_speed"]
    if len(speeds) < len(SPEEDS):
        return
    fast, slow = speeds
    for axis, size, speed in ((CHEAP, max(sizes, key=factor), fast), (BEST, min(sizes, key=factor), slow)):
        if size.changes:
            yield Rung(axis, Variant(f"{size.name}-{speed.name}", size.changes | speed.changes))


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


def check_axes(rungs: Sequence[Rung], wanted: Sequence[str]) -> list[Rung]:
    """The rungs along some axes alone, all where none is named; CaseError for an axis that there is not."""
    known = dict.fromkeys(rung.axis for rung in rungs if rung.axis)
    for axis in wanted:
        if axis not in known:
            raise CaseError(f"{axis} is no axis of this study; there are {', '.join(known)}", place="--axis")
    return [rung for rung in rungs if not rung.axis or not wanted or rung.axis in wanted]


def _text(value: float) -> str:
    """As YAML, four digits."""
    text = f"{value:.4g}"
    return repr(float(text)) if "e" in text else text
