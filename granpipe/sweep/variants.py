"""Variants: a case plus changes of dotted keys. The one engine for whatever runs many cases."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated

from pydantic import Field

from granpipe.case.values import Name

MAX_NAME = 64
"""Longest name of a variant; it becomes the name of its case and of its folder."""

_PLAIN = re.compile(r"\d+(\.\d+)?|[A-Za-z][A-Za-z0-9]*")
"""Values that a file name tells without loss, once the point is an underscore."""

_UNSAFE = re.compile(r"[^A-Za-z0-9]+")

Axis = Mapping[str, Sequence[str]]
"""Keys that change together (zipped), and their values as YAML text: equally many for each key."""


@dataclass(frozen=True)
class Variant:
    """A case plus changes: dotted keys and their values as YAML text, as in ``--set``.

    `name` is safe as a file name.
    """

    name: Annotated[str, Field(pattern=f"^{Name.pattern}$")]
    changes: dict[str, str]


def crossed(axes: Iterable[Axis]) -> Iterator[Variant]:
    """Every combination of the axes' values, the last axis changing fastest; nothing without axes."""
    columns = [[dict(zip(axis, values, strict=True)) for values in zip(*axis.values(), strict=True)] for axis in axes]
    for parts in product(*columns) if columns else ():
        changes = {key: text for part in parts for key, text in part.items()}
        yield Variant(name_of(changes), changes)


def name_of(changes: Mapping[str, str]) -> str:
    """A name that follows from the changes alone, so that it stays when others are added: ``friction-0_2-seed-3``.

    Different changes of the same keys have different names: where letters and digits cannot tell all of a value, six
    digits of a hash are appended.
    """
    short = _short_keys(list(changes))
    words = [word for key, text in changes.items() for word in (short[key], _UNSAFE.sub("_", text).strip("_"))]
    name = "-".join(word for word in words if word)
    if len(name) <= MAX_NAME and all(_PLAIN.fullmatch(text) for text in changes.values()):
        return name
    return f"{name[: MAX_NAME - 7]}-{_hash(changes)}"


def _short_keys(keys: list[str]) -> dict[str, str]:
    """The last part of each key; as many more before it as tell it from the others."""

    def tail(key: str, length: int) -> str:
        return "_".join(_UNSAFE.sub("_", part).strip("_") for part in key.split(".")[-length:])

    def shortest(key: str) -> str:
        lengths = range(1, key.count(".") + 2)
        unique = (tail(key, n) for n in lengths if sum(tail(other, n) == tail(key, n) for other in keys) == 1)
        return next(unique, tail(key, len(lengths)))

    return {key: shortest(key) for key in keys}


def _hash(changes: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(changes)).encode()).hexdigest()[:6]


def spaced(first: str, last: str, number: int) -> list[str]:
    """`number` values at equal distances from `first` to `last`, both included; ValueError tells what is wrong.

    The ends are numbers, both with the same unit or both without: ``10 mm`` to ``30 mm``. Whole ends at whole distances
    give whole numbers, as seeds need them.
    """
    (low, unit), (high, other) = _number_and_unit(first), _number_and_unit(last)
    if unit != other:
        raise ValueError(f"must both have the same unit, not `{unit}` and `{other}`")
    step = (high - low) / (number - 1) if number > 1 else 0.0
    values = [low + step * index for index in range(number)]
    return [f"{value:.12g}{f' {unit}' if unit else ''}" for value in values]


def _number_and_unit(text: str) -> tuple[float, str]:
    match = re.fullmatch(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(\S.*)?", text.strip())
    if match is None:
        raise ValueError(f"`{text}` is not a number with or without unit")
    return float(match[1]), match[2] or ""
