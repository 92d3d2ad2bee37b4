"""Comparing fields: the noise-free difference is found under noise, and the verdict is careful."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granpipe.analysis.compare import Difference, compare, difference_table
from granpipe.errors import DataError
from granpipe.field import Field, Grid, flux_from_psi

GRID = Grid.covering(1.0, 0.0, 2.0, 0.02)
LEVELS = {"upper": (2.0, 1.0), "lower": (1.0, 0.0)}


def plug(factor: float = 1.0) -> Field:
    psi = np.tile(-0.5 * GRID.r_edges**2, (len(GRID.z_edges), 1))
    psi[: GRID.shape[0] // 2] *= factor
    flux_r, flux_z = flux_from_psi(psi, GRID)
    ones = np.ones(GRID.shape)
    return Field(GRID, ones, ones > 0, np.zeros_like(flux_r), flux_z, np.pi, 1.0, 1.0)


def noisy(field: Field, sigma: float, seed: int) -> Field:
    rng = np.random.default_rng(seed)
    noise = sigma * rng.standard_normal(field.flux_z.shape)
    error_z = np.full_like(field.flux_z, sigma / np.sqrt(2))  # at the middle of a cell two faces are averaged
    return replace(field, flux_z=field.flux_z + noise, flux_r_se=np.zeros_like(field.flux_r), flux_z_se=error_z)


def by_name(found: list[Difference]) -> dict[str, Difference]:
    return {d.name: d for d in found}


def test_a_difference_is_found_in_its_section_and_not_hidden_by_the_other() -> None:
    found = by_name(compare(plug(), plug(1.1), LEVELS, GRID.cell))
    assert found["lower"].noise_free == pytest.approx(0.1, rel=0.02)
    assert found["upper"].noise_free == pytest.approx(0.0, abs=0.01)
    assert found["lower"].verdict(0.05) == "differ"


def test_noise_alone_is_no_difference() -> None:
    upper = []
    for seed in range(20):
        found = by_name(compare(noisy(plug(), 0.1, seed), noisy(plug(), 0.1, 100 + seed), LEVELS, GRID.cell))["whole"]
        assert found.noise == pytest.approx(0.1, rel=0.05)
        assert found.noise_free < 0.03
        upper.append(found.upper)
    assert np.median(upper) < 0.05


def test_a_difference_under_noise_stays_below_its_bound() -> None:
    """Cells share their faces, so their errors are correlated over two cells: that is the diameter here."""
    covered = 0
    for seed in range(20):
        one, other = noisy(plug(), 0.1, seed), noisy(plug(1.05), 0.1, 100 + seed)
        found = by_name(compare(one, other, LEVELS, 2 * GRID.cell))["lower"]
        assert found.noise_free == pytest.approx(0.05, abs=0.015)
        covered += found.upper > 0.05 * np.sqrt(0.99)
    assert covered >= 18


def test_noise_that_a_field_does_not_tell_is_no_difference_and_its_bound_holds() -> None:
    for seed in range(20):
        other = noisy(plug(1.05), 0.1, 100 + seed)
        unknown = replace(other, raw_flux_r=other.flux_r, raw_flux_z=other.flux_z, flux_r_se=None, flux_z_se=None)
        for pair in ((noisy(plug(), 0.1, seed), unknown), (unknown, unknown)):
            found = compare(*pair, LEVELS, 2 * GRID.cell)
            lower = by_name(found)["lower"]
            assert lower.verdict(0.04) != "differ"
            assert pair[0] is unknown or lower.upper > 0.05
            assert "unknown" in difference_table(found, 0.04)
    fluid = by_name(compare(plug(), plug(1.1), LEVELS, GRID.cell))["lower"]  # has no noise to tell
    assert fluid.verdict(0.05) == "differ"


def test_too_much_noise_leaves_it_unresolved() -> None:
    assert Difference("x", 0.1, 0.1, 0.01, 0.08).verdict(0.05) == "unresolved"
    assert Difference("x", 0.1, 0.02, 0.01, 0.04).verdict(0.05) == "agree"
    # two seeds of one vessel: noise told a tenth too small is no difference
    assert Difference("x", 0.251, 0.222, 0.118, 0.150).verdict(0.05) == "unresolved"
    assert Difference("x", 0.251, 0.111, 0.225, 0.230).verdict(0.05) == "differ"


def test_other_grids_are_refused() -> None:
    other = Grid.covering(1.0, 0.0, 2.0, 0.05)
    ones = np.ones(other.shape)
    field = Field(other, ones, ones > 0, np.zeros((40, 21)), np.zeros((41, 20)), 1.0, 1.0, 1.0)
    with pytest.raises(DataError, match=r"homogenize\.cell"):
        compare(plug(), field, LEVELS, 0.1)


def test_fields_without_a_common_cell_of_bulk_are_not_said_to_agree() -> None:
    left = replace(plug(), bulk=np.tile(GRID.r_centres < 0.5, (GRID.shape[0], 1)))
    with pytest.raises(DataError, match="nothing to compare"):
        compare(left, replace(plug(), bulk=~left.bulk), LEVELS, 0.1)
