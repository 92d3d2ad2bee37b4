"""Kinds of case values: how a number, a choice or a name is read, what it accepts, and how the schema says so.

Each kind is pydantic metadata that reads the raw YAML value itself, so that every message is one sentence about what
must stand there.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NoReturn, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from granpipe.case.units import ANGLE, NUMBER, Dimension, UnitError, accepted, flow_in_si, in_si
from granpipe.errors import KeyPath

MAX_INTEGER = 2**31 - 1
MAX_POINTS = 10_000  # of one wall or obstacle
MAX_COORDINATE = 1e4  # m
_MOST_ANY_UNIT = 1e9  # coordinates in whatever unit


def refuse(message: str, key: KeyPath = (), show_value: bool = True) -> NoReturn:
    """Reject a value with one sentence; `key` points below the value being validated."""
    raise PydanticCustomError("refused", "{text}", {"text": message, "key": key, "show_value": show_value})


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean …?` for the nearest known word, or the list of all."""
    words = list(known)
    near = difflib.get_close_matches(word, words, n=1, cutoff=0.6)
    return f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(words)}"


class Kind:
    """Base of the kinds: `read` turns the raw value into the resolved one or refuses it."""

    def read(self, value: Any) -> Any:
        raise NotImplementedError

    def schema(self) -> dict[str, Any]:
        raise NotImplementedError

    def accepts(self) -> str:
        """What may stand here, for documentation."""
        raise NotImplementedError

    def write(self, value: Any) -> Any:
        """The resolved value as plain data that `read` reads again."""
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read,
            serialization=core_schema.plain_serializer_function_ser_schema(self.write, when_used="unless-none"),
        )

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return self.schema()


@dataclass(frozen=True)
class Quantity(Kind):
    """A number with or without unit, within bounds; `auto` where granpipe can choose."""

    dimension: Dimension = NUMBER
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    auto: bool = False

    def read(self, value: Any) -> float | Literal["auto"]:
        if self.auto and value == "auto":
            return "auto"
        try:
            number = in_si(value, self.dimension)
        except UnitError as error:
            refuse(f"{error}, or auto" if self.auto else str(error))
        if not self._inside(number):
            refuse(f"must be {self.bounds()}{self._percent(value, number)}")
        return number

    def _percent(self, value: Any, number: float) -> str:
        """The remedy where a share was given as a bare percentage."""
        share = self.dimension is NUMBER and 1 in (self.at_most, self.below) and 2 <= number <= 100
        return f"; for a percentage write {number:g} %" if share and value == number else ""

    def write(self, value: Any) -> Any:
        bare = self.dimension.bare or not isinstance(value, float)
        return value if bare else f"{value!r} {self.dimension.unit}"

    def _inside(self, number: float) -> bool:
        return not (
            (self.above is not None and number <= self.above)
            or (self.at_least is not None and number < self.at_least)
            or (self.below is not None and number >= self.below)
            or (self.at_most is not None and number > self.at_most)
        )

    def bounds(self) -> str:
        """``in (0, 1]``, ``above 0 m`` and the like; empty without bounds."""
        low = self.above if self.above is not None else self.at_least
        high = self.below if self.below is not None else self.at_most
        unit = f" {self.dimension.unit}" if self.dimension.unit else ""
        if self.dimension is ANGLE:
            low, high = (None if bound is None else math.degrees(bound) for bound in (low, high))
            unit = " deg"
        if low is not None and high is not None:
            left, right = "(" if self.above is not None else "[", ")" if self.below is not None else "]"
            return f"in {left}{low:g}, {high:g}{right}{unit}"
        if low is not None:
            return f"{'above' if self.above is not None else 'at least'} {low:g}{unit}"
        if high is not None:
            return f"{'below' if self.below is not None else 'at most'} {high:g}{unit}"
        return ""

    def accepts(self) -> str:
        text = accepted(self.dimension)
        text = f"{text}; {self.bounds()}" if self.bounds() else text
        return f"{text}; or `auto`" if self.auto else text

    def schema(self) -> dict[str, Any]:
        number: dict[str, Any] = {"type": "number"}
        names = {"exclusiveMinimum": self.above, "minimum": self.at_least}
        names |= {"exclusiveMaximum": self.below, "maximum": self.at_most}
        number |= {name: bound for name, bound in names.items() if bound is not None}
        text = {"type": "string", "pattern": r"^[+-]?[0-9.]", "maxLength": 64}
        auto = [{"const": "auto"}] if self.auto else []
        return {"anyOf": [*([number] if self.dimension.bare else []), text, *auto]}


@dataclass(frozen=True)
class Whole(Kind):
    """A whole number within bounds; `auto` where granpipe can choose."""

    at_least: int
    at_most: int = MAX_INTEGER
    auto: bool = False

    def read(self, value: Any) -> int | Literal["auto"]:
        if self.auto and value == "auto":
            return "auto"
        if not isinstance(value, int) or isinstance(value, bool) or not self.at_least <= value <= self.at_most:
            refuse(f"must be {self.accepts()}")
        return value

    def accepts(self) -> str:
        text = f"a whole number from {self.at_least} to {self.at_most}"
        return f"{text}, or `auto`" if self.auto else text

    def schema(self) -> dict[str, Any]:
        number = {"type": "integer", "minimum": self.at_least, "maximum": self.at_most}
        return {"anyOf": [number, {"const": "auto"}]} if self.auto else number


@dataclass(frozen=True)
class Series(Kind):
    """A list of numbers of one kind: exactly `length`, or at least as many where `more`."""

    item: Quantity = Quantity()
    length: int = 1
    more: bool = False

    def read(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)) or not self._enough(len(value)):
            refuse(f"must be {self.accepts()}")
        return tuple(_read_item(self.item, item, index) for index, item in enumerate(value))

    def write(self, value: Any) -> Any:
        return list(value)

    def _enough(self, number: int) -> bool:
        return number >= self.length if self.more else number == self.length

    def accepts(self) -> str:
        count = f"{self.length} or more" if self.more else str(self.length)
        return f"a list of {count}: {self.item.accepts()}"

    def schema(self) -> dict[str, Any]:
        highest = {} if self.more else {"maxItems": self.length}
        return {"type": "array", "items": self.item.schema(), "minItems": self.length} | highest


def _read_item(kind: Kind, item: Any, index: int) -> Any:
    try:
        return kind.read(item)
    except PydanticCustomError as error:
        refuse(error.message(), (index, *(error.context or {}).get("key", ())))


@dataclass(frozen=True)
class Points(Kind):
    """Points [r, z] as plain numbers in the outline's unit; a closed polygon does not repeat its first point."""

    at_least: int
    closed: bool = False

    def read(self, value: Any) -> tuple[tuple[float, float], ...]:
        if not isinstance(value, (list, tuple)) or len(value) > MAX_POINTS:
            refuse(f"must be {self.accepts()}")
        points = tuple(self._point(point, index) for index, point in enumerate(value))
        if self.closed and len(points) > 1 and points[0] == points[-1]:
            points = points[:-1]
        if len(points) < self.at_least:
            refuse(f"must be {self.accepts()}")
        return points

    def write(self, value: Any) -> Any:
        return [list(point) for point in value]

    def _point(self, point: Any, index: int) -> tuple[float, float]:
        plain = isinstance(point, (list, tuple)) and len(point) == 2 and all(_is_number(x) for x in point)
        if not plain:
            comma = isinstance(point, (list, tuple)) and len(point) in (3, 4) and all(_is_number(x) for x in point)
            unit = "decimals are written with a point" if comma else "outline.unit says their unit"
            refuse(f"must be a point [r, z] of two plain numbers; {unit}", (index,))
        r, z = float(point[0]), float(point[1])
        if max(abs(r), abs(z)) > MAX_COORDINATE:
            refuse(f"must not have a coordinate beyond {MAX_COORDINATE:g} m", (index,))
        return r, z

    def accepts(self) -> str:
        return f"a list of {self.at_least} or more points [r, z] in `outline.unit`"

    def schema(self) -> dict[str, Any]:
        point = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
        return {"type": "array", "items": point, "minItems": self.at_least}


class Place(Kind):
    """A point [x, y, z] as plain numbers in the vessel's unit."""

    def read(self, value: Any) -> tuple[float, float, float]:
        plain = isinstance(value, (list, tuple)) and len(value) == 3 and all(_is_number(x) for x in value)
        if not plain or max(abs(x) for x in value) > _MOST_ANY_UNIT:
            refuse(f"must be {self.accepts()}")
        x, y, z = map(float, value)
        return x, y, z

    def write(self, value: Any) -> Any:
        return list(value)

    def accepts(self) -> str:
        return "a point [x, y, z] of three plain numbers in `vessel.unit`"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}


class Levels(Kind):
    """An upper and a lower level as plain numbers in the outline's unit."""

    def read(self, value: Any) -> tuple[float, float]:
        plain = isinstance(value, (list, tuple)) and len(value) == 2 and all(_is_number(z) for z in value)
        if not plain or max(abs(z) for z in value) > MAX_COORDINATE:
            refuse(f"must be {self.accepts()}")
        return float(value[0]), float(value[1])

    def write(self, value: Any) -> Any:
        return list(value)

    def accepts(self) -> str:
        return "[upper, lower], two plain numbers in `outline.unit`"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


class OneOf(Kind):
    """One of a few words, given as a `Literal`."""

    def __init__(self, literal: Any) -> None:
        self.words: tuple[str, ...] = get_args(literal)

    def read(self, value: Any) -> str:
        if value not in self.words:
            near = f"; {did_you_mean(value, self.words)}" if isinstance(value, str) and _near(value, self.words) else ""
            refuse(f"must be {self.accepts()}{near}")
        return str(value)

    def accepts(self) -> str:
        return " | ".join(self.words)

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.words)}


def _near(word: str, words: Iterable[str]) -> bool:
    return bool(difflib.get_close_matches(word, list(words), n=1))


class SomeOf(OneOf):
    """A list of different words out of a few."""

    def read(self, value: Any) -> Any:
        if not isinstance(value, (list, tuple)):
            refuse(f"must be {self.accepts()}")
        for index, word in enumerate(value):
            if word not in self.words or word in value[:index]:
                reason = "given twice" if word in self.words else f"must be one of {' | '.join(self.words)}"
                refuse(reason, (index,))
        return tuple(value)

    def accepts(self) -> str:
        return f"a list of {', '.join(self.words)} (each at most once)"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": {"enum": list(self.words)}, "uniqueItems": True}


class Name(Kind):
    """Text that is safe as a file name."""

    pattern = r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}"

    def read(self, value: Any) -> str:
        text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
        if not isinstance(text, str) or not re.fullmatch(self.pattern, text):
            refuse(f"must be {self.accepts()}")
        return text

    def accepts(self) -> str:
        return "letters, digits, `_` and `-`, first a letter or digit, at most 64"

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "pattern": f"^{self.pattern}$"}


class Identifier(Name):
    """Text that is safe as a name inside decks and meshes, too."""

    pattern = r"[A-Za-z][A-Za-z0-9_]{0,31}"

    def accepts(self) -> str:
        return "letters, digits and `_`, first a letter, at most 32"


class File(Kind):
    """Path of a file; it reaches no deck and no shell."""

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not 0 < len(value) <= 1000 or "\0" in value:
            refuse(f"must be {self.accepts()}")
        return value

    def accepts(self) -> str:
        return "the path of a file"

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "minLength": 1, "maxLength": 1000}


@dataclass(frozen=True)
class Flow(Kind):
    """A volume or mass flow, as its unit tells; `make` builds the resolved value from number and dimension."""

    make: Callable[[float, Dimension], Any]

    def read(self, value: Any) -> Any:
        try:
            number, dimension = flow_in_si(value)
        except UnitError as error:
            refuse(str(error))
        if not 0 < number < math.inf:
            refuse("must be above 0 and finite")
        return self.make(number, dimension)

    def write(self, value: Any) -> str:
        return str(value)

    def accepts(self) -> str:
        return "a volume flow of bulk such as 1 m^3/h, or a mass flow such as 2 t/h or 0.5 kg/s"

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "maxLength": 64}


@dataclass(frozen=True)
class Short:
    """Metadata of a field whose group of keys has a short form: what may stand in place of the group."""

    kind: Kind

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [self.kind.schema(), handler(core)]}


def _refuse_decimal_comma(data: Mapping[str, Any], key: str) -> None:
    """Say what is wrong where YAML took the digits after a decimal comma, as in {friction: 0,3}, for a key."""
    keys = list(data)
    before = keys[keys.index(key) - 1] if keys.index(key) else None
    digits = isinstance(key, str) and re.match(r"\d", key) and data[key] is None
    if digits and before is not None and re.fullmatch(r"[+-]?\d+", str(data[before])):
        refuse(f"decimals are written with a point: {before}: {data[before]}.{key}", (key,), show_value=False)


class Group(BaseModel):
    """A group of keys. Frozen; unknown keys are refused before anything else is said about the group."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    short: ClassVar[str] = ""  # the key that a value standing in place of the group is read as
    remedy: ClassVar[str] = ""  # what to do where a group is given wrongly

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, cls):
            return data
        if cls.short and not isinstance(data, Mapping):
            return {cls.short: data}
        if data is None:  # a key with nothing below it but comments
            data = {}
        if not isinstance(data, Mapping):
            refuse(cls.remedy or f"must be a group of keys: {', '.join(cls.model_fields)}")
        for key in data:
            if key not in cls.model_fields:
                _refuse_decimal_comma(data, key)
                help_ = cls.remedy or did_you_mean(str(key), cls.model_fields)
                refuse(f"unknown key; {help_}", (key,), show_value=False)
        for name, field in cls.model_fields.items():
            if field.is_required() and name not in data:
                refuse(f"missing; give it: {field.description}", (name,), show_value=False)
        return data
