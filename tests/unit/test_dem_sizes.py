"""Size classes keep what a distribution says of number, volume and limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from granpipe.case.material import Size
from granpipe.dem.sizes import SizeClasses, size_classes


def make(**spread: object) -> SizeClasses:
    return size_classes(
        Size.model_validate({"radius": spread["radius"], **{k: v for k, v in spread.items() if k != "radius"}})
    )


def test_one_size_is_one_class() -> None:
    classes = make(radius=0.03)
    assert classes.radius.tolist() == [0.03]
    assert classes.number_share.tolist() == [1.0]
    assert classes.d90 == pytest.approx(0.06)


def test_normal_classes_keep_number_and_volume_of_the_cut_distribution() -> None:
    classes = make(radius={"normal": {"mean": 0.06, "std": 0.02, "min": 0.02, "max": 0.10}})
    cut = stats.truncnorm(-2, 2, loc=0.06, scale=0.02)
    mean_cube = integrate.quad(lambda r: r**3 * cut.pdf(r), 0.02, 0.10)[0]
    assert classes.number_share.sum() == pytest.approx(1)
    assert classes.mean_volume == pytest.approx(4 / 3 * np.pi * mean_cube, rel=1e-5)
    edges = np.linspace(0.02, 0.10, 8)
    np.testing.assert_allclose(classes.number_share, np.diff(cut.cdf(edges)), rtol=1e-5)


def test_mass_based_lognormal_keeps_the_mass_of_each_class() -> None:
    classes = make(radius={"lognormal": {"median": 0.01, "sigma": 0.3, "min": 0.005, "max": 0.02}}, by="mass")
    cdf = stats.lognorm(0.3, scale=0.01).cdf(np.linspace(0.005, 0.02, 8))
    np.testing.assert_allclose(classes.mass_share, np.diff(cdf) / (cdf[-1] - cdf[0]), rtol=1e-4)


def test_sieve_fractions_are_kept_and_empty_fractions_left_out() -> None:
    classes = make(radius={"sieve": {"edges": [0.01, 0.02, 0.03, 0.04], "fractions": [0.25, 0, 0.75]}}, by="mass")
    np.testing.assert_allclose(classes.mass_share, [0.25, 0.75])
    assert 0.01 < classes.smallest < 0.02
    assert 0.03 < classes.largest < 0.04


def test_d90_is_the_diameter_that_ninety_percent_of_the_mass_stays_below() -> None:
    classes = SizeClasses(np.array([1.0, 2.0]), np.array([8 / 9.1, 1.1 / 9.1]))
    assert classes.mass_share == pytest.approx([8 / 16.8, 8.8 / 16.8])
    assert classes.d90 == 4.0


def test_the_sauter_diameter_is_that_of_volume_over_surface() -> None:
    """Eight spheres of radius 1 and one of 2: d = 2 (8 + 8)/(8 + 4)."""
    assert SizeClasses(np.array([1.0, 2.0]), np.array([8 / 9, 1 / 9])).sauter_diameter == pytest.approx(8 / 3)


def test_coarse_graining_enlarges_and_keeps_the_shares() -> None:
    classes = make(radius={"normal": {"mean": 0.06, "std": 0.02, "min": 0.02, "max": 0.10}})
    larger = classes.enlarged(2)
    np.testing.assert_allclose(larger.radius, 2 * classes.radius)
    np.testing.assert_allclose(larger.mass_share, classes.mass_share)
