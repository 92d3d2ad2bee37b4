"""The variants of a study: cheaper and more expensive than the case, along one axis at a time, and combined."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from granpipe.case.reader import varied
from granpipe.case.schema import Case
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

THICKNESSES = (0.5, 1.5)
"""Thicknesses of the slice of a slab over that of the case."""

_OTHER = 1000  # apart from the seeds of replicas

BASE = "base"
"""Name of the point that is the case itself."""

SEED, FILLINGS = "seed", "fillings"
"""Axes of other fillings: of the case, and of the points along other axes, which are its values."""

CHEAP, BEST, FINEST_SPEED = "cheap", "best", "finest_speed"
"""Axes of combined points: coarsest and fastest; finest, in two fillings; finest at every plate speed."""

_COMBINED = (CHEAP, BEST, FINEST_SPEED)

_KEYS = {
    "model": "model",
    "coarse_grain_factor": "dem.coarse_grain_factor",
    "mass_scaling": "dem.mass_scaling",
    "youngs_modulus": "contact.youngs_modulus",
    "time_step": "dem.time_step",
    "reservoir_height": "dem.reservoir_height",
    "facets": "dem.facets",
    "thickness": "dem.thickness",
    "plate_speed": "dem.plate_speed",
    "replicas": "dem.replicas",
    SEED: "dem.seed",
    "ranks": "dem.ranks",
}
"""Axis → key of the case."""

POINT = "point"
"""Axis of points with several changes, as the user gives them."""

_SETTINGS = (*_KEYS.values(), "dem.max_time")
"""What such a point may change: none of these changes the vessel or the material."""

LIMITED = ("coarse_grain_factor", "mass_scaling", "youngs_modulus", "time_step", "plate_speed")
"""Axes that have a limit: what a filling adds to their points would be taken for what they do."""


@dataclass(frozen=True)
class Basis:
    """What the planner settled for the case, which the study varies.

    Parameters
    ----------
    youngs_modulus : [Pa]
    time_step : [s]
    plate_speed : [m/s]; 0 where the outlet is open
    reservoir_height : [m]
    facets : of the wall per turn; 0 in a slab
    thickness : of the slice of a slab [m]; 0 of a body of revolution, and between front and back walls
    model : dem, hybrid or fluid
    models : which of these the scene allows
    cores : that a point may keep busy
    max_time : of production [s]
    mass_scaled : whether the smallest particles are heavier than the material's
    """

    youngs_modulus: float
    time_step: float
    plate_speed: float
    reservoir_height: float
    facets: int
    model: str
    models: tuple[str, ...]
    cores: int = 1
    max_time: float = 0.0
    thickness: float = 0.0
    mass_scaled: bool = False


@dataclass(frozen=True)
class StudyVariant:
    """A point of the study before it is run: the axis along which it differs from the case, and how."""

    axis: str
    variant: Variant


Refusal = Callable[[Variant], CaseError | None]
"""Why the scene does not allow a variant (a gap, a model, a wrong value); None where it does."""

Axes = Mapping[str, Sequence[str]]
"""Axis → the values that the user gave, as YAML; none for the usual ones."""


def read_axes(words: Iterable[str]) -> Axes:
    """``name`` or ``name=value,value`` → axes.

    Raises
    ------
    CaseError : no such axis, or no values after the equals sign
    """
    found: dict[str, list[str]] = {}
    for word in words:
        name, given, text = word.partition("=")
        if name not in (*_KEYS, *_COMBINED, FILLINGS):
            known = ", ".join((*_KEYS, *_COMBINED, FILLINGS))
            raise CaseError(f"{name} is not an axis; choose from {known}", place="--axis")
        if given and name in _COMBINED:
            raise CaseError(f"{name} follows from the other axes; it takes no values", place="--axis")
        values = [value for value in map(str.strip, text.split(",")) if value]
        if given and not values:
            raise CaseError(f"no values in {word!r}; write such as {name}=1,2 or {name} alone", place="--axis")
        if name == FILLINGS and (wrong := [value for value in values if value not in LIMITED]):
            message = f"{wrong[0]} is not an axis to be repeated; choose from {', '.join(LIMITED)}"
            raise CaseError(message, place=f"--axis {word}")
        found.setdefault(name, []).extend(values)
    return found


def read_point(words: str) -> dict[str, str]:
    """``key=value,key=value`` → changes of the case.

    Raises
    ------
    CaseError : no value, no setting of the run, or one that is given twice
    """
    found: dict[str, str] = {}
    for word in words.split(","):
        key, _, value = (part.strip() for part in word.partition("="))
        if not value:
            raise CaseError(f"no value in {word!r}; write such as {_SETTINGS[1]}=1", place=f"--point {words}")
        if key not in _SETTINGS:
            message = f"{key} is no setting that a point may change; choose from {', '.join(_SETTINGS)}"
            raise CaseError(message, place=f"--point {words}")
        if key in found:
            raise CaseError(f"{key} is given twice", place=f"--point {words}")
        found[key] = value
    return found


def point_variants(case: Case, points: Iterable[Mapping[str, str]], refusal: Refusal) -> Iterator[StudyVariant]:
    """The points with several changes.

    Raises
    ------
    CaseError : a value is wrong, or the scene does not allow it
    """
    for changes in points:
        place = f"--point {','.join(f'{key}={value}' for key, value in changes.items())}"
        whole = partial(Variant, name_of(changes), dict(changes))
        yield StudyVariant(POINT, _given(case, changes, whole, refusal, place))


def _given(
    case: Case, changes: Mapping[str, str], make: Callable[[], Variant], refusal: Refusal, place: str
) -> Variant:
    """A variant that the user gave; CaseError with its place where it cannot be.

    Parameters
    ----------
    changes : that were given
    make : the variant with all that goes with them
    """
    try:
        variant = make()
        if varied(case, changes).model_dump() == case.model_dump():
            raise CaseError("this is the case itself; that is the point base")
        error = refusal(variant)
    except CaseError as wrong:
        error = wrong
    if error is not None:
        raise CaseError(error.message, place=place) from None
    return variant


def study_variants(case: Case, basis: Basis, refusal: Refusal, axes: Axes | None = None) -> tuple[StudyVariant, ...]:
    """Every point, the case itself first.

    Of the usual values those that the scene does not allow are left out; for values of the user that is a CaseError.

    Parameters
    ----------
    axes : to go along these alone, with these values; CaseError where nothing is possible along one
    """
    axes = axes or {}
    single, usual = [StudyVariant("", Variant(BASE, {}))], _usual(case, basis)
    for axis in (axis for axis in usual if not axes.get(axis)):
        for value in usual[axis]:
            variant = _variant(case, basis, axis, value)
            if refusal(variant) is None:
                single.append(StudyVariant(axis, variant))
    for axis in (axis for axis in usual if axes.get(axis)):
        for value in dict.fromkeys(axes[axis]):
            made = partial(_variant, case, basis, axis, value)
            variant = _given(case, {_KEYS[axis]: value}, made, refusal, f"--axis {axis}={value}")
            single.append(StudyVariant(axis, variant))
    repeated = _repeated(axes)
    more = [*_combined(case, single), *_fillings(single, repeated)]
    variants = [*single, *(one for one in more if refusal(one.variant) is None)]
    if not axes:
        return tuple(variants)
    for axis in axes:
        if not any(one.axis == axis for one in variants):
            raise CaseError(f"this case allows no variant along {axis}", place="--axis")
    kept = {"", *axes, *repeated, *([SEED] if repeated else [])}
    return tuple(one for one in variants if one.axis in kept)


def _repeated(axes: Axes) -> Sequence[str]:
    """The axes whose points are run in other fillings too, only where that is asked for: it takes as long again."""
    if FILLINGS not in axes:
        return ()
    return axes[FILLINGS] or [axis for axis in LIMITED if axis in axes] or LIMITED


def _variant(case: Case, basis: Basis, axis: str, value: str) -> Variant:
    changes = _changes(case, basis, axis, value)
    return Variant(name_of({_KEYS[axis]: changes[_KEYS[axis]]}), changes)  # what follows is not in the name


def _usual(case: Case, basis: Basis) -> dict[str, list[str]]:
    """Axis → its values."""
    found = {"model": [model for model in basis.models if model != basis.model]}
    if basis.model == "fluid":
        return found
    factors = {max(1.0, case.dem.coarse_grain_factor * share) for share in SIZES} - {case.dem.coarse_grain_factor}
    found |= {
        "coarse_grain_factor": [_text(factor) for factor in sorted(factors)],
        "mass_scaling": ["none"] if basis.mass_scaled else [],
        "youngs_modulus": [_text(factor * basis.youngs_modulus) for factor in STIFFNESSES],
        "time_step": [_text(factor * basis.time_step) for factor in STEPS],
        "reservoir_height": [_text(factor * basis.reservoir_height) for factor in RESERVOIRS],
        "replicas": ["2"],
        "seed": [str(case.dem.seed + _OTHER)],
    }
    if basis.facets:
        found["facets"] = [str(4 * round(factor * basis.facets / 4)) for factor in FACETS]
    if basis.thickness:
        found["thickness"] = [_text(factor * basis.thickness) for factor in THICKNESSES]
    if basis.plate_speed > 0:
        found["plate_speed"] = [_text(factor * basis.plate_speed) for factor in SPEEDS]
    if basis.cores > 1:
        found["ranks"] = ["2"]
    return found


def _changes(case: Case, basis: Basis, axis: str, value: str) -> dict[str, str]:
    """What a value of an axis changes, and what has to go with it."""
    changes = {_KEYS[axis]: value}
    time = basis.max_time if case.dem.max_time == "auto" else float(case.dem.max_time)
    start = 0.0 if case.homogenize.start == "auto" else float(case.homogenize.start)
    if axis == "replicas":  # together they average as long as the case does
        count = varied(case, changes).dem.replicas
        changes["dem.max_time"] = _text(start + (time - start) / count)
    elif axis == "plate_speed":  # equal travel
        if (speed := varied(case, changes).dem.plate_speed) == "auto":
            raise CaseError("auto is not a value of this axis; give a speed, in m/s or with its unit")
        ratio = float(speed) / basis.plate_speed
        changes["dem.max_time"] = _text(time / ratio)
        if start:
            changes["homogenize.start"] = _text(start / ratio)
    elif axis == "ranks":  # another filling, for what is in the store would be taken whatever the ranks
        changes["dem.seed"] = str(case.dem.seed + 2 * _OTHER)
    return changes


def _combined(case: Case, single: Sequence[StudyVariant]) -> Iterator[StudyVariant]:
    """Coarsest with fastest, which is the cheapest; finest in two fillings, which is the best; finest at every speed.

    What a plate's speed does depends on the particles' size: a layer that flows down a free surface goes by its flow
    rate over d √(g d) (GDR MiDi, On dense granular flows, 2004), so that it is not to be had from coarse ones.
    """

    def factor(variant: Variant) -> float:
        return varied(case, variant.changes).dem.coarse_grain_factor

    def speed(variant: Variant) -> float:
        return float(varied(case, variant.changes).dem.plate_speed)

    sizes = [one.variant for one in single if one.axis in ("", "coarse_grain_factor")]
    speeds = [one.variant for one in single if one.axis == "plate_speed"]
    if speeds and (size := max(sizes, key=factor)).changes:
        fast = max(speeds, key=speed)
        yield StudyVariant(CHEAP, Variant(f"{size.name}-{fast.name}", size.changes | fast.changes))
    if (size := min(sizes, key=factor)).changes:
        yield StudyVariant(BEST, Variant(f"{size.name}-replicas-2", size.changes | {"dem.replicas": "2"}))
        for one in speeds:
            yield StudyVariant(FINEST_SPEED, Variant(f"{size.name}-{one.name}", size.changes | one.changes))


def repeated_axis(changes: Mapping[str, str]) -> str:
    """The axis along which a point in another filling lies; none where it is the case itself."""
    return next((axis for axis in LIMITED if _KEYS[axis] in changes), "")


def _fillings(single: Sequence[StudyVariant], repeated: Sequence[str]) -> Iterator[StudyVariant]:
    """The points along some axes in the other fillings that the case itself is run in."""
    for one in (one.variant for one in single if one.axis in repeated):
        for other in (other.variant for other in single if other.axis == SEED):
            yield StudyVariant(FILLINGS, Variant(f"{one.name}-{other.name}", one.changes | other.changes))


def affordable(
    variants: Sequence[StudyVariant], cost: Callable[[StudyVariant], float], budget: float
) -> tuple[list[StudyVariant], list[StudyVariant]]:
    """Variants within a budget and those dropped, the most expensive first; the case itself stays.

    Parameters
    ----------
    cost : of a variant, in the unit of the budget
    """
    costs = {one.variant.name: cost(one) for one in variants}
    kept, dropped = list(variants), []
    while sum(costs[one.variant.name] for one in kept) > budget and len(kept) > 1:
        costliest = max(kept[1:], key=lambda one: costs[one.variant.name])
        kept.remove(costliest)
        dropped.append(costliest)
    return kept, dropped


def _text(value: float) -> str:
    """As YAML, four digits."""
    text = f"{value:.4g}"
    return repr(float(text)) if "e" in text else text
