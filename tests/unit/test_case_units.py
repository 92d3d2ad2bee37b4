"""Numbers with units: expected values by hand, everyday units against pint, hostile text refused quickly."""

import contextlib
import math
import subprocess
import sys
import time

import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.case import units
from granpipe.case.units import (
    ANGLE,
    DENSITY,
    LENGTH,
    MASS_FLOW,
    NUMBER,
    PRESSURE,
    SPEED,
    TIME,
    VOLUME_FLOW,
    UnitError,
    flow_in_si,
    in_si,
    unit_in_si,
)


@pytest.mark.parametrize(
    ("value", "dimension", "expected"),
    [
        (3, LENGTH, 3.0),
        ("3", LENGTH, 3.0),
        ("3 cm", LENGTH, 0.03),
        ("3cm", LENGTH, 0.03),
        ("3[cm]", LENGTH, 0.03),
        ("3 [ cm ]", LENGTH, 0.03),
        ("-2.5e-1 mm", LENGTH, -0.00025),
        (".5 m", LENGTH, 0.5),
        ("1 ft", LENGTH, 0.3048),
        ("2 in", LENGTH, 0.0508),
        ("1[m^3/h]", VOLUME_FLOW, 1 / 3600),
        ("1 m³/h", VOLUME_FLOW, 1 / 3600),
        ("1 m**3*h^-1", VOLUME_FLOW, 1 / 3600),
        ("60 l/min", VOLUME_FLOW, 0.001),
        ("2 t/h", MASS_FLOW, 2000 / 3600),
        ("1 g/cm^3", DENSITY, 1000),
        ("1000 kg m^-3", DENSITY, 1000),
        ("10 MPa", PRESSURE, 1e7),
        ("1 psi", PRESSURE, 6894.757293168),
        ("5 cm/s", SPEED, 0.05),
        ("20 min", TIME, 1200),
        ("30 deg", ANGLE, math.pi / 6),
        ("30°", ANGLE, math.pi / 6),
        ("0.5 rad", ANGLE, 0.5),
        ("5 %", NUMBER, 0.05),
        ("2/3", NUMBER, 2 / 3),
        ("4.7e9", NUMBER, 4.7e9),
    ],
)
def test_number_with_unit_becomes_si(value, dimension, expected):
    assert in_si(value, dimension) == pytest.approx(expected, rel=1e-12)


def test_same_length_in_other_units_is_the_same_number():
    for centimetres in range(1, 1000):
        assert in_si(f"{centimetres} cm", LENGTH) == centimetres / 100


@pytest.fixture(scope="module")
def registry():
    return pint.UnitRegistry()


@pytest.mark.parametrize("name", [name for name in units._EVERYDAY if name not in ("%", "°")])
def test_everyday_unit_agrees_with_pint(name, registry):
    base = registry.Quantity(1.0, name).to_base_units()
    scale, powers = unit_in_si(name)
    assert scale == pytest.approx(base.magnitude, rel=1e-14)
    found = dict(base.unit_items())
    assert powers == tuple(found.get(key, 0) for key in ("meter", "kilogram", "second", "radian"))


@pytest.mark.parametrize("value", [30, 30.0, "30", "30 %"])
def test_bare_angle_is_refused(value):
    with pytest.raises(UnitError, match="an angle with its unit, such as 30 deg"):
        in_si(value, ANGLE)


@pytest.mark.parametrize(
    ("value", "dimension", "says"),
    [
        ("3 kg", LENGTH, "must be a length such as 3 cm, or a number in m"),
        ("3 K", LENGTH, "not a unit of length, mass, time or angle"),
        ("3 parrots", LENGTH, "not a known unit"),
        ("3 ton/h", MASS_FLOW, "write t for 1000 kg"),
        ("0,5 m", LENGTH, "write decimals with a point"),
        ("1e400 m", LENGTH, "finite"),
        ("1e999", LENGTH, "finite"),
        ("0,5", LENGTH, "write decimals with a point"),
        ("1/0", NUMBER, "finite"),
        ("1 Qparsec^9*m^-8", LENGTH, "too large a unit"),
        (10**400, LENGTH, "finite"),
        ("nan", NUMBER, "must be a number"),
        ("inf m", LENGTH, "must be a length"),
        ("3 m/", LENGTH, "not a unit that granpipe reads"),
        ("3 m m^2 (", LENGTH, "not a unit that granpipe reads"),
        ("", LENGTH, "must be a length"),
        ("m", LENGTH, "must be a length"),
        (True, LENGTH, "must be a length"),
        (None, LENGTH, "must be a length"),
        ([3], LENGTH, "must be a length"),
        ("3 " + "c" * 100 + "m", LENGTH, "must be a length"),
    ],
)
def test_wrong_quantity_is_refused_with_what_is_accepted(value, dimension, says):
    with pytest.raises(UnitError, match=says.replace("(", r"\(")):
        in_si(value, dimension)


@pytest.mark.parametrize("text", ["9**9**9 m", "9^9^9^9", "3 m^9**9**9", "1e9e9 m", "__import__('os') m", "3 m;x"])
def test_hostile_expression_is_refused_at_once(text):
    unit_in_si("ft")  # loads pint, whose cost is not the expression's
    began = time.perf_counter()
    with pytest.raises(UnitError):
        in_si(text, LENGTH)
    assert time.perf_counter() - began < 0.1


def test_flow_is_volume_or_mass_by_its_unit():
    assert flow_in_si("3.6 m^3/h") == (pytest.approx(0.001), VOLUME_FLOW)
    assert flow_in_si("3.6 t/h") == (pytest.approx(1.0), MASS_FLOW)


@pytest.mark.parametrize("value", [1, "1", "1 m/s", "1 m^3", None])
def test_flow_without_a_flow_unit_is_refused(value):
    with pytest.raises(UnitError, match="must be a flow with its unit"):
        flow_in_si(value)


def test_case_with_everyday_units_is_read_without_pint():
    code = (
        "import sys; from granpipe.case.units import in_si, LENGTH, flow_in_si;"
        "import granpipe.case.schema; in_si('3 cm', LENGTH); flow_in_si('1 m^3/h'); sys.exit('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@settings(max_examples=80, deadline=None)
@given(st.text(max_size=30) | st.from_regex(r"[0-9.eE+-]{1,5} ?[\[a-zA-Zµ°%^*/ 0-9\]]{0,9}", fullmatch=True))
def test_any_text_gives_a_finite_number_or_a_unit_error(text):
    for dimension in (LENGTH, NUMBER, ANGLE):
        with contextlib.suppress(UnitError):
            assert math.isfinite(in_si(text, dimension))
