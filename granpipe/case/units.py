"""Numbers with units into SI: ``3 cm``, ``3[cm]``, ``1[m^3/h]``, ``2 t/h``, ``30 deg``, ``5 %``, ``2/3``.

Number and unit are matched by strict patterns before anything evaluates them (pint alone would compute ``9**9**9``).
Everyday units come from a small table, since importing pint and building its registry costs most of a second; any
other unit is looked up in pint.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import cache
from typing import Any

MAX_LENGTH = 64  # characters of a number with its unit; longer text is refused unread

Powers = tuple[float, float, float, float]  # of metre, kilogram, second, radian

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_QUANTITY = re.compile(rf"({_NUMBER})\s*(?:\[\s*([^\[\]]*?)\s*\]|([^\d\s\[\]/+.*^-][^\[\]]*?)|(/\s*{_NUMBER}))?\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d")
_FACTOR = re.compile(r"([^\W\d_]+|°|%)(?:(?:\^|\*\*)?(-?[1-9])|([²³]))?")
_OPERATOR = re.compile(r"\s*([*/·]|\s)\s*")


@dataclass(frozen=True)
class Dimension:
    """A kind of quantity: what it is called, its SI unit, an example, and its powers of m, kg, s and rad."""

    name: str
    unit: str
    example: str
    powers: Powers = field(repr=False)

    @property
    def bare(self) -> bool:
        """Whether a number without unit is accepted (as SI). Not so for angles: degrees or radians?"""
        return not self.powers[3]


NUMBER = Dimension("a number", "", "0.5 or 50 %", (0, 0, 0, 0))
LENGTH = Dimension("a length", "m", "3 cm", (1, 0, 0, 0))
TIME = Dimension("a time", "s", "20 s", (0, 0, 1, 0))
SPEED = Dimension("a speed", "m/s", "5 cm/s", (1, 0, -1, 0))
DENSITY = Dimension("a density", "kg/m^3", "1000 kg/m^3", (-3, 1, 0, 0))
PRESSURE = Dimension("a pressure", "Pa", "10 MPa", (-1, 1, -2, 0))
ANGLE = Dimension("an angle", "rad", "30 deg", (0, 0, 0, 1))
VOLUME_FLOW = Dimension("a volume flow", "m^3/s", "1 m^3/h", (3, 0, -1, 0))
MASS_FLOW = Dimension("a mass flow", "kg/s", "2 t/h", (0, 1, -1, 0))

_EVERYDAY: dict[str, tuple[float, Powers]] = {
    **{name: (scale, (1, 0, 0, 0)) for name, scale in {"m": 1, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6}.items()},
    **{name: (scale, (0, 1, 0, 0)) for name, scale in {"kg": 1, "g": 1e-3, "t": 1000}.items()},
    **{name: (scale, (0, 0, 1, 0)) for name, scale in {"s": 1, "ms": 1e-3, "min": 60, "h": 3600, "d": 86400}.items()},
    **{name: (scale, (-1, 1, -2, 0)) for name, scale in {"Pa": 1, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}.items()},
    **{name: (scale, (0, 0, 0, 1)) for name, scale in {"rad": 1, "deg": math.pi / 180, "°": math.pi / 180}.items()},
    "l": (1e-3, (3, 0, 0, 0)),
    "%": (0.01, (0, 0, 0, 0)),
}


class UnitError(ValueError):
    """The text is no number with a unit, or one of another dimension; says what is accepted."""


def tidy(value: float) -> float:
    """Round to 15 digits, so that ``35 cm`` and ``0.35`` are the same number (and the same case)."""
    return float(f"{value:.15g}")


def accepted(dimension: Dimension) -> str:
    """What may stand for a quantity, for messages and documentation."""
    if not dimension.unit:
        return f"{dimension.name} such as {dimension.example}"
    if not dimension.bare:
        return f"{dimension.name} with its unit, such as {dimension.example}"
    return f"{dimension.name} such as {dimension.example}, or a number in {dimension.unit}"


def in_si(value: Any, dimension: Dimension) -> float:
    """The SI value of a YAML scalar, a number or text.

    Raises
    ------
    UnitError : it is not a finite quantity of the given dimension
    """
    number, scale, powers = _parsed(value, dimension)
    if powers is not None and powers != dimension.powers:
        raise UnitError(f"must be {accepted(dimension)}")
    if powers is None and not dimension.bare:
        raise UnitError(f"must be {accepted(dimension)}")
    result = tidy(number * scale)
    if not math.isfinite(result):
        raise UnitError(f"must be finite: {accepted(dimension)}")
    return result


def flow_in_si(value: Any) -> tuple[float, Dimension]:
    """A flow rate in m³/s or kg/s, and which of the two it is by its unit.

    Raises
    ------
    UnitError : it is neither
    """
    expected = "must be a flow with its unit, such as 1 m^3/h (of bulk) or 2 t/h"
    if not isinstance(value, str):
        raise UnitError(expected)
    for dimension in (VOLUME_FLOW, MASS_FLOW):
        number, scale, powers = _parsed(value, dimension)
        if powers == dimension.powers:
            return tidy(number * scale), dimension
    raise UnitError(expected)


def _parsed(value: Any, dimension: Dimension) -> tuple[float, float, Powers | None]:
    """Number, scale to SI and powers (None without a unit)."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _as_float(value), 1.0, None
    match = _QUANTITY.fullmatch(value.strip()) if isinstance(value, str) and len(value) <= MAX_LENGTH else None
    if match is None:
        raise UnitError(f"must be {accepted(dimension)}")
    if _DECIMAL_COMMA.match(match[0]):
        raise UnitError(f"must be {accepted(dimension)}; write decimals with a point")
    number, bracketed, plain, divisor = match.groups()
    if divisor:
        return _ratio(float(number), float(divisor[1:])), 1.0, None
    unit = bracketed if bracketed is not None else plain
    return (float(number), *unit_in_si(unit)) if unit else (float(number), 1.0, None)


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _ratio(dividend: float, divisor: float) -> float:
    return dividend / divisor if divisor else math.inf


@cache
def unit_in_si(unit: str) -> tuple[float, Powers]:
    """Scale and powers of a product of units such as ``kg/m^3``; UnitError if one is unknown."""
    try:
        return _product(unit)
    except OverflowError:
        raise UnitError(f"`{unit}` is too large a unit") from None


def _product(unit: str) -> tuple[float, Powers]:
    scale, powers, sign, position = 1.0, (0.0, 0.0, 0.0, 0.0), 1, 0
    while True:
        match = _FACTOR.match(unit, position)
        if match is None:
            raise UnitError(f"`{unit}` is not a unit that granpipe reads (write for instance kg/m^3)")
        name, power, superscript = match.groups()
        exponent = sign * int(power or {"²": 2, "³": 3}.get(superscript, 1))
        size, dims = _EVERYDAY.get(name) or _from_pint(name)
        scale *= size**exponent
        powers = tuple(p + exponent * q for p, q in zip(powers, dims, strict=True))  # type: ignore[assignment]
        position = match.end()
        if position == len(unit):
            return scale, powers
        operator = _OPERATOR.match(unit, position)
        if operator is None:
            raise UnitError(f"`{unit}` is not a unit that granpipe reads (write for instance kg/m^3)")
        sign = -1 if operator[1] == "/" else 1
        position = operator.end()


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def _from_pint(name: str) -> tuple[float, Powers]:
    """Scale and powers of one unit outside the table of everyday units, by pint."""
    if name in ("ton", "tons"):
        raise UnitError(f"`{name}` is 907 kg to some and 1016 kg to others; write t for 1000 kg, or lb")
    registry = _registry()
    try:
        base = registry.Quantity(1.0, name).to_base_units()
    except Exception as error:  # pint and the tokenizer below it raise many kinds for text that is no unit
        raise UnitError(f"`{name}` is not a known unit") from error
    units = dict(base.unit_items())
    names = ("meter", "kilogram", "second", "radian")
    if set(units) - set(names):
        raise UnitError(f"`{name}` is not a unit of length, mass, time or angle")
    powers = tuple(float(units.get(key, 0)) for key in names)
    return float(base.magnitude), powers  # type: ignore[return-value]


def length_unit(unit: str) -> float:
    """Metres in a unit of length.

    Raises
    ------
    UnitError : no unit, or not one of length
    """
    try:
        factor, powers = unit_in_si(unit)
    except UnitError as error:
        raise UnitError(f"must be a length unit such as m or mm; {error}") from None
    if powers != LENGTH.powers:
        raise UnitError("must be a length unit such as m or mm")
    return factor
