"""Uncertainty of inputs: what the case knows only as a range, by the case at both ends of it.

A small design of runs: the case itself, and for each input one run at either end of its range with everything else
unchanged. The difference of the two ends over the width of the range is the linear sensitivity ∂U/∂x (a central
difference). A range without a preference has the standard uncertainty u_x = width/√12, and the input adds
u = |∂U/∂x| u_x to the standard uncertainty of the field; inputs are taken as independent of each other.
Source: ASME V&V 20-2009, section 3 (sensitivity coefficients); JCGM 100:2008 (GUM), 4.3.7.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.errors import CaseError
from granpipe.study.axes import Refusal, StudyVariant
from granpipe.sweep.variants import Variant, name_of

INPUT = "input "
"""How the axis of a point at the end of an input's range begins; key and range follow."""

RANGE_SHARE = 1 / math.sqrt(12)
"""Standard uncertainty of a value that is anywhere in a range, over the width of the range."""

_PARTS = ("material.", "contact.")
_NO_INPUTS = {"contact.model", "contact.rolling_model", "contact.youngs_modulus", "contact.characteristic_velocity"}


@dataclass(frozen=True)
class Input:
    """A key of the case that is known only as a range; its ends as YAML, the lower one first."""

    key: str
    ends: tuple[str, str]

    @property
    def axis(self) -> str:
        """Of its points."""
        return f"{INPUT}{self.key}={self.ends[0]}..{self.ends[1]}"

    @classmethod
    def of(cls, axis: str) -> Input:
        """Of the axis of one of its points."""
        key, _, text = axis.removeprefix(INPUT).partition("=")
        low, _, high = text.partition("..")
        return cls(key, (low, high))


def read_inputs(words: Iterable[str], case: Case) -> tuple[Input, ...]:
    """``key=low..high`` → inputs of a case.

    Raises
    ------
    CaseError : no range, no such key, not a property of the material or its contacts, or a value that the key refuses
    """
    found: list[Input] = []
    for word in words:
        key, given, text = word.partition("=")
        low, dots, high = (part.strip() for part in text.partition(".."))
        key = key.strip()
        place = f"--inputs {word}"
        if not (given and dots and low and high):
            raise CaseError("no range; write such as contact.friction=0.6..0.8", place=place)
        if not key.startswith(_PARTS) or key in _NO_INPUTS:
            raise CaseError(
                f"{key} is not a property of the solids or of their contacts that is measured: give such as "
                "material.density, contact.friction, contact.wall.friction; the numerical settings are --axis",
                place=place,
            )
        if key in {one.key for one in found}:
            raise CaseError(f"{key} is given twice", place=place)
        try:
            values = [_number(varied(case, {key: end}), key) for end in (low, high)]
            if not values[0] < values[1]:
                raise CaseError(f"{low} is not below {high}; write the lower end first")
        except CaseError as error:
            raise CaseError(error.message, place=place) from None
        found.append(Input(key, (low, high)))
    return tuple(found)


def _number(case: Case, key: str) -> float:
    value: object = case
    for part in key.split("."):
        value = getattr(value, part, None)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CaseError(f"{key} is not a number, so it has no range")
    return float(value)


def input_variants(case: Case, inputs: Sequence[Input], refusal: Refusal) -> Iterator[StudyVariant]:
    """The points at both ends of each range.

    Raises
    ------
    CaseError : the scene does not allow one
    """
    for one in inputs:
        for end in one.ends:
            changes = {one.key: end}
            variant = Variant(name_of(changes), changes)
            if (error := refusal(variant)) is not None:
                raise CaseError(error.message, place=f"--inputs {one.key}={one.ends[0]}..{one.ends[1]}")
            if varied(case, changes).model_dump() != case.model_dump():
                yield StudyVariant(one.axis, variant)
