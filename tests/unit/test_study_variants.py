"""Variants: axes are crossed and zipped as promised, and names are safe, stable and never shared."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.case.values import Name
from granpipe.sweep.variants import crossed, name_of, spaced

SAFE = re.compile(Name.pattern)
KEYS = st.sampled_from(["dem.seed", "contact.friction", "contact.wall.friction", "outline.wall", "fluid.annulus"])
TEXTS = st.one_of(
    st.integers(-50, 50).map(str),
    st.floats(-10, 10).map(lambda x: f"{x:.3g}"),
    st.sampled_from(["3 cm", "3 mm", "0.3 cm", "auto", "none", "[0.1, 0.2]", "0_2", "0.2", "2/3", "2_3", "ü", "", "-"]),
)


def test_axes_are_crossed_and_keys_of_one_axis_zipped():
    axes = [{"contact.friction": ["0.2", "0.4"]}, {"dem.seed": ["1", "2", "3"], "dem.max_time": ["9 s", "8 s", "7 s"]}]
    changes = [tuple(variant.changes.values()) for variant in crossed(axes)]
    assert changes == [
        ("0.2", "1", "9 s"), ("0.2", "2", "8 s"), ("0.2", "3", "7 s"),
        ("0.4", "1", "9 s"), ("0.4", "2", "8 s"), ("0.4", "3", "7 s"),
    ]  # fmt: skip


def test_no_axes_are_no_variants():
    assert list(crossed([])) == []


def test_names_tell_keys_and_values():
    assert name_of({"contact.friction": "0.2", "dem.seed": "3"}) == "friction-0_2-seed-3"
    assert name_of({"contact.friction": "0.2", "contact.wall.friction": "0.4"}) == (
        "contact_friction-0_2-wall_friction-0_4"
    )


@settings(max_examples=300, deadline=None)
@given(st.lists(KEYS, min_size=1, max_size=4, unique=True), st.data())
def test_names_are_safe_and_different_for_different_values(keys, data):
    rows = [tuple(data.draw(TEXTS) for _ in keys) for _ in range(6)]
    names = {row: name_of(dict(zip(keys, row, strict=True))) for row in rows}
    assert all(SAFE.fullmatch(name) for name in names.values())
    assert len(set(names.values())) == len(names)


def test_long_names_are_cut_but_stay_different():
    first, second = ({f"outline.sections.a{n}.wall_factor": f"0.{n}{last}" for n in range(9)} for last in (1, 2))
    assert len(name_of(first)) <= 64
    assert name_of(first) != name_of(second)


def test_adding_values_to_an_axis_keeps_the_names_of_the_others():
    few = {variant.name for variant in crossed([{"dem.seed": ["1", "2"]}])}
    many = {variant.name for variant in crossed([{"dem.seed": ["1", "-1", "2", "[2]", "1.0"]}])}
    assert few < many


@pytest.mark.parametrize(
    ("first", "last", "number", "expected"),
    [
        ("1", "4", 4, ["1", "2", "3", "4"]),
        ("0.2", "0.8", 4, ["0.2", "0.4", "0.6", "0.8"]),
        ("10 mm", "30 mm", 3, ["10 mm", "20 mm", "30 mm"]),
        ("5", "1", 3, ["5", "3", "1"]),
        ("1e-3", "1e-3", 1, ["0.001"]),
        ("1[m^3/h]", "2[m^3/h]", 2, ["1 [m^3/h]", "2 [m^3/h]"]),
    ],
)
def test_ranges(first, last, number, expected):
    assert spaced(first, last, number) == expected


@pytest.mark.parametrize(("first", "last"), [("1 mm", "2 cm"), ("1", "2 mm"), ("one", "2"), ("", "2")])
def test_wrong_ranges_are_refused(first, last):
    with pytest.raises(ValueError, match="unit"):
        spaced(first, last, 3)
