"""The uncertainty of a study's case: ranges of inputs, their runs, parts and sums."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.errors import CaseError
from granpipe.study.budget import ErrorBound
from granpipe.study.inputs import Input, input_variants, read_inputs
from granpipe.study.points import make_study
from granpipe.study.uncertainty import Part, Uncertainty, input_part, numerical_part, statistical_part

SMOKE = load_case(Path(__file__).parents[2] / "cases" / "smoke.yaml")


def test_a_range_makes_the_case_and_a_point_at_either_end() -> None:
    inputs = read_inputs(["contact.friction=0.2..0.4", "material.density=900 kg/m^3..1100 kg/m^3"], SMOKE)
    study = make_study(SMOKE, 10, 2, inputs=inputs)
    assert [one.axis for one in study.variants] == [
        "",
        *["input contact.friction=0.2..0.4"] * 2,
        *["input material.density=900 kg/m^3..1100 kg/m^3"] * 2,
    ]
    ends = [one.variant.changes for one in study.variants[1:]]
    assert ends[:2] == [{"contact.friction": "0.2"}, {"contact.friction": "0.4"}]
    assert [Input.of(one.axis) for one in study.variants[1::2]] == list(inputs)


def test_an_end_that_is_the_case_itself_is_not_run_twice() -> None:
    inputs = read_inputs(["contact.friction=0.3..0.4"], SMOKE)
    assert [one.variant.changes for one in input_variants(SMOKE, inputs, lambda _: None)] == [
        {"contact.friction": "0.4"}
    ]


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("contact.friction", "no range"),
        ("contact.friction=0.6", "no range"),
        ("contact.friction=..0.8", "no range"),
        ("contact.friction=0.8..0.6", "not below"),
        ("contact.friction=0.6..0.6", "not below"),
        ("contact.friction=0.6..900", "must be"),
        ("contact.friction=a..b", "number"),
        ("contact.frictoin=0.6..0.8", "frictoin"),
        ("dem.plate_speed=0.1..0.2", "--axis"),
        ("contact.youngs_modulus=1e6..1e7", "--axis"),
        ("material.size=1 cm..2 cm", "."),
    ],
)
def test_what_is_no_range_of_an_input_is_refused_with_its_place(word: str, message: str) -> None:
    with pytest.raises(CaseError, match=message) as refused:
        read_inputs([word], SMOKE)
    assert f"--inputs {word}" in str(refused.value)


def test_a_field_that_is_linear_in_an_input_gives_the_standard_uncertainty_of_a_uniform_range() -> None:
    # U = U₀ (1 + s x), x uniform within ±a: u = s a/√3; the ends lie 2 s a apart
    slope, half = 0.4, 0.1
    part = input_part("contact.friction", ("0.6", "0.8"), ErrorBound(2 * slope * half, 2 * slope * half))
    assert part.standard == pytest.approx(slope * half / math.sqrt(3))
    assert not part.bound


def test_an_input_below_the_noise_counts_with_the_bound_and_says_so() -> None:
    part = input_part("contact.friction", ("0.6", "0.8"), ErrorBound(0.01, 0.06))
    assert part.standard == pytest.approx(0.06 / math.sqrt(12))
    assert part.bound


def test_parts_add_as_squares_and_what_is_missing_is_named() -> None:
    found = Uncertainty(
        (
            statistical_part(0.03),
            numerical_part("stiffness", ErrorBound(0.05, 0.08), ""),
            numerical_part("plate speed", None, ""),
            Part("contact.friction", "input", 0.12, ""),
        )
    )
    assert found.standard("statistical", "numerical") == pytest.approx(0.05)
    assert found.standard() == pytest.approx(0.13)
    assert found.missing == ["plate speed"]
