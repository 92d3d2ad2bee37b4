"""Total errors, the front of options worth their time, and advice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from granpipe.study.budget import ErrorBound, Option, advise, pareto, percent, sure_factor


def option(point: str, seconds: float, noise: float, rest: float, upper: float | None = None, cores: int = 1) -> Option:
    part = ErrorBound(rest, rest if upper is None else upper)
    changes = {"dem.plate_speed": point}
    return Option(point, "psi", 1.0, seconds, cores, {"whole": noise}, math.inf, {"whole": part}, changes)


def filled(point: str, time: str, rest: float) -> Option:
    """An option of a case in the filling that its name tells, or in its own."""
    changes = {"dem.max_time": time} | ({"dem.seed": point} if point != "base" else {})
    return Option(
        point, "psi", 1.0, float(time), 1, {"whole": 0.0}, math.inf, {"whole": ErrorBound(rest, rest)}, changes
    )


def names(options) -> list[str]:
    return [one.point for one in options]


def test_independent_parts_add_as_squares() -> None:
    error = option("a", 1, 0.03, 0.04, 0.05).error()
    assert error.value == pytest.approx(0.05)
    assert error.upper == pytest.approx(math.hypot(0.03, 0.05))


def test_few_blocks_make_the_bound_wider() -> None:
    few = Option("a", "psi", 1.0, 1.0, 1, {"whole": 0.03}, 8.0, {"whole": ErrorBound(0.0, 0.0)})
    assert few.error().value == pytest.approx(0.03)
    assert few.error().upper > 1.5 * 0.03


@pytest.mark.parametrize("blocks", [7, 20, 60])
def test_the_factor_covers_the_true_spread_in_19_of_20(blocks: int) -> None:
    rng = np.random.default_rng(blocks)
    estimates = rng.standard_normal((20_000, blocks)).std(axis=1, ddof=1)
    assert np.mean(sure_factor(blocks) * estimates > 1) == pytest.approx(0.95, abs=0.01)


def test_the_front_holds_what_nothing_beats_in_time_and_bound() -> None:
    cheap, good, worse, best = (
        option("cheap", 1, 0.2, 0.0),
        option("good", 10, 0.05, 0.0),
        option("worse", 20, 0.06, 0.0),
        option("best", 100, 0.01, 0.0),
    )
    assert names(pareto([best, worse, cheap, good])) == ["cheap", "good", "best"]


def test_the_front_goes_by_the_bound_not_by_a_lucky_estimate() -> None:
    lucky, sure = option("lucky", 1, 0.01, 0.0, 0.3), option("sure", 2, 0.05, 0.0, 0.0)
    assert names(pareto([lucky, sure])) == ["lucky", "sure"]


def test_cores_count() -> None:
    one, two = option("one", 10, 0.1, 0.0), option("two", 6, 0.1, 0.0, cores=2)
    assert names(pareto([one, two])) == ["one"]


def test_the_cheapest_that_is_proven_is_advised() -> None:
    options = [option("bad", 1, 0.3, 0.0), option("unproven", 2, 0.01, 0.0, 0.2), option("good", 5, 0.03, 0.02)]
    advice = advise(options, 0.05)
    assert advice.option is options[2]
    assert advice.proven


def test_without_proof_the_estimate_decides_and_the_advice_says_so() -> None:
    options = [option("bad", 1, 0.3, 0.0), option("unproven", 2, 0.01, 0.0, 0.2)]
    advice = advise(options, 0.05)
    assert advice.option is options[1]
    assert not advice.proven


def test_of_other_fillings_the_worst_counts_not_the_lucky_one() -> None:
    options = [filled("base", "8", 0.04), filled("7", "8", 0.06), filled("base", "16", 0.03), filled("7", "16", 0.04)]
    assert advise(options, 0.05).option is options[3]
    assert advise(options, 0.07).option is options[1]


def test_a_length_after_which_a_filling_has_no_field_is_not_advised() -> None:
    options = [filled("base", "8", 0.01), filled("base", "16", 0.01), filled("7", "16", 0.02)]
    assert advise(options, 0.05).option is options[2]


def test_a_filling_that_was_run_longer_or_at_another_length_is_judged_as_far_as_the_other_goes() -> None:
    longer = replace(filled("base", "20", 0.02), point="longer")
    assert advise([filled("base", "16", 0.04), longer], 0.05).option is not None  # the same filling
    assert advise([filled("base", "16", 0.04), filled("7", "10.4", 0.03), longer], 0.03).option is longer
    assert advise([filled("base", "8", 0.02), filled("7", "10.4", 0.06), filled("7", "6", 0.07)], 0.05).option is None


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_lengths_are_told_apart_whatever_the_size_of_the_vessel(unit: float) -> None:
    def times(point: str, *made: tuple[float, float]) -> list[Option]:
        return [filled(point, f"{unit * time:.4g}", rest) for time, rest in made]

    options = [*times("base", (8, 0.02), (10, 0.03)), *times("7", (8.003, 0.01), (9.6, 0.06))]
    assert advise(options, 0.05).option is options[0]
    assert advise(options[1:], 0.05).option is options[1]


def test_a_time_with_a_unit_is_none_that_lengths_are_compared_by() -> None:
    hybrid = [filled("base", "8", 0.02), filled("7", "9", 0.03)]
    hybrid = [
        replace(one, changes=one.changes | {"dem.max_time": text})
        for one, text in zip(hybrid, ("16 s", "auto"), strict=True)
    ]
    assert advise(hybrid, 0.05).option is hybrid[1]


def test_numbers_are_settings_however_they_are_written() -> None:
    one, other = filled("base", "8", 0.03), filled("7", "8", 0.06)
    soft = [replace(one, changes=one.changes | {"contact.youngs_modulus": "2e7"}),
            replace(other, changes=other.changes | {"contact.youngs_modulus": "2.0e+07"})]  # fmt: skip
    assert advise(soft, 0.05).option is None


def test_an_estimate_is_judged_by_the_worst_estimate_and_a_bound_by_the_worst_bound() -> None:
    """Of two fillings the one with the lower estimate has the higher bound."""
    low, high = filled("base", "8", 0.04), filled("7", "8", 0.06)
    low = replace(low, systematic={"whole": ErrorBound(0.04, 0.09)})
    high = replace(high, systematic={"whole": ErrorBound(0.06, 0.08)})
    assert advise([low, high], 0.05).option is None
    assert advise([low, high], 0.09).option is low


def test_a_method_that_one_of_two_fillings_was_averaged_with_is_not_advised() -> None:
    lucky = filled("base", "4", 0.01)
    lucky = replace(lucky, method="psi, cells × 2", changes=lucky.changes | {"homogenize.cell": "0.1"})
    options = [lucky, filled("base", "8", 0.04), filled("7", "8", 0.03)]
    assert advise(options, 0.05).option is options[1]
    assert advise(options[:2], 0.05).option is lucky


def test_the_plain_average_is_never_advised() -> None:
    plain = Option("a", "raw", 1.0, 1.0, 1, {"whole": 0.01}, math.inf, {"whole": ErrorBound(0.0, 0.0)})
    assert advise([plain, option("b", 9, 0.01, 0.0)], 0.05).option is not plain


def test_nothing_is_advised_where_nothing_is_good_enough() -> None:
    assert advise([option("bad", 1, 0.3, 0.0)], 0.05).option is None


def test_a_part_below_its_own_uncertainty_is_unresolved() -> None:
    assert ErrorBound(0.05, 0.06).resolved
    assert not ErrorBound(0.02, 0.06).resolved
    assert "below 6.0%" in str(ErrorBound(0.02, 0.06))


def test_small_errors_keep_their_digits() -> None:
    assert (percent(0.0523), percent(0.00021), percent(0.0)) == ("5.2%", "0.021%", "0.0%")
