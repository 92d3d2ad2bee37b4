"""Slopes along an axis: known orders are recovered, and their error bars hold."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.study.limit import fit_slope

SHAPE = (12, 8)
WEIGHT = np.ones(SHAPE)
SIGMA = 0.05


def values_along(x, order, seed, sigma=SIGMA):
    """Two components, F = 1 + c x^order with another c in every place, and noise."""
    rng = np.random.default_rng(seed)
    slope = np.random.default_rng(0).normal(0.5, 0.3, (2, *SHAPE))
    x = np.asarray(x)
    values = 1 + slope * (x**order)[:, None, None, None] + sigma * rng.standard_normal((len(x), 2, *SHAPE))
    return slope, values, np.full((len(x), *SHAPE), 2 * sigma**2)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_three_points_tell_the_order_and_the_slope(order: float) -> None:
    x = (0.25, 0.5, 1.0)
    slope, values, variances = values_along(x, order, 1, sigma=0.01)
    found = fit_slope(x, values, variances, WEIGHT)
    assert found.order == order
    assert np.abs(np.tensordot(found.parts, values, 1) - slope).max() < 0.1
    assert 0.7 < found.misfit < 1.4


def test_two_points_are_taken_as_first_order() -> None:
    slope, values, variances = values_along((0.5, 1.0), 1.0, 1, sigma=0.0)
    found = fit_slope((0.5, 1.0), values, variances, WEIGHT)
    assert found.order == 1
    assert np.isnan(found.misfit)
    assert np.allclose(np.tensordot(found.parts, values, 1), slope)


def test_points_in_several_fillings_at_two_settings_tell_no_order() -> None:
    """Noise that is told half as large as it is would be taken for a misfit of the first."""
    x = (0.5, 0.5, 0.5, 1.0, 1.0, 1.0)
    for seed in range(50):
        _, values, variances = values_along(x, 1.0, seed)
        found = fit_slope(x, values, variances / 4, WEIGHT)
        assert found.order == 1
        assert np.isnan(found.misfit)


def test_the_error_bar_is_that_of_repeated_axes() -> None:
    """One of the points is four times as noisy as the others, and counts less."""
    x = (0.3, 0.5, 0.8, 1.0)
    slopes, bars = [], []
    for seed in range(60):
        _, values, variances = values_along(x, 1.0, seed, sigma=0.01)
        values[3] += 0.04 * np.random.default_rng(1000 + seed).standard_normal(values[3].shape)
        variances[3] += 2 * 0.04**2
        found = fit_slope(x, values, variances, WEIGHT)
        assert found.order == 1
        slopes.append(np.tensordot(found.parts, values, 1))
        bars.append(np.tensordot(found.parts**2, variances, 1))
    scatter = (np.std(slopes, axis=0) ** 2).sum(axis=0).mean()
    assert scatter == pytest.approx(np.mean(bars), rel=0.15)


def test_noise_is_not_taken_for_the_second_order() -> None:
    x = (0.25, 0.5, 1.0)
    orders = [fit_slope(x, *values_along(x, 1.0, seed, sigma=1.0)[1:], WEIGHT).order for seed in range(40)]
    assert set(orders) == {1.0}


def test_the_change_from_the_limit_grows_with_the_power() -> None:
    slope, values, variances = values_along((0.25, 0.5, 1.0), 2.0, 1, sigma=0.0)
    found = fit_slope((0.25, 0.5, 1.0), values, variances + 1e-12, WEIGHT)
    assert np.allclose(np.tensordot(found.between(1.0, 0.5), values, 1), slope * 0.75)


def test_points_that_follow_no_power_show_by_their_misfit() -> None:
    _, values, variances = values_along((0.25, 0.5, 1.0), 1.0, 1, sigma=0.01)
    values[1] += 1.0
    assert fit_slope((0.25, 0.5, 1.0), values, variances, WEIGHT).misfit > 100
