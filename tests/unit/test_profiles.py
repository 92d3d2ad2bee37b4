"""Profiles across a vessel: their values, their bands and where they are taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fakes.synthetic import FLOW, SCALE, field_of, pipe, ring_vessel

from granpipe.errors import DataError
from granpipe.export.profiles import BAND, level_profile, profile_figure, profile_figures, section_profiles


@pytest.mark.parametrize("z", [0.5, 0.512345, 0.0, 1.0])
def test_a_profile_of_a_parabola_is_a_parabola(z: float) -> None:
    vessel = pipe(curvature=1.0)
    found = level_profile(field_of(vessel, 0.02), z)
    expected = -2 * SCALE * FLOW / (np.pi * 0.25) * (1 - (found.r / 0.5) ** 2)
    assert found.w == pytest.approx(expected, abs=1e-9)
    assert found.u == pytest.approx(0, abs=1e-12)
    assert found.w_error is None


def test_there_is_no_velocity_in_an_obstacle_or_a_void() -> None:
    field = field_of(ring_vessel(), 0.02)
    in_ring, in_cavity = level_profile(field, 0.95), level_profile(field, 0.7)
    assert np.isnan(in_ring.w[in_ring.r > 0.33]).all()
    assert np.isfinite(in_ring.w[in_ring.r < 0.29]).all()
    assert np.isnan(in_cavity.w[-2])


def test_the_band_is_that_of_the_standard_error() -> None:
    field = field_of(pipe(), 0.05)
    field = replace(field, flux_r_se=np.zeros_like(field.flux_r), flux_z_se=np.full_like(field.flux_z, 0.001))
    found = level_profile(field, 0.5, "a")
    assert found.w_error == pytest.approx(0.001 * field.velocity_scale)
    figure = profile_figure(found)
    (axes,) = figure.axes
    (band,) = axes.collections
    low, high = np.ptp(band.get_paths()[0].vertices[:, 1]), 0
    factor = {"bulk velocity [mm/h]": 3.6e6, "bulk velocity [m/h]": 3600.0}[axes.get_ylabel()]
    assert low - high == pytest.approx(2 * BAND * 0.001 * field.velocity_scale * factor)
    assert axes.get_xlabel() == "r [m]"
    assert axes.get_title(loc="left") == "section a, z = 0.5 m"


def test_profiles_are_taken_at_mid_height_of_at_most_six_sections(tmp_path: Path) -> None:
    field = field_of(pipe(), 0.05)
    ends = np.linspace(1, 0, 11)
    sections = {f"s{k}": (ends[k], ends[k + 1]) for k in range(10)}
    found = section_profiles(field, sections)
    assert [one.section for one in found] == ["s0", "s2", "s4", "s5", "s7", "s9"]
    assert found[0].z == pytest.approx(0.95)
    paths = profile_figures(found[:1], tmp_path)
    assert [path.name for path in paths] == ["profile_s0.png"]
    assert paths[0].stat().st_size > 5000
    assert section_profiles(field, {}) == []


@pytest.mark.parametrize("z", [-0.01, 1.01, float("nan")])
def test_a_level_outside_the_field_is_refused(z: float) -> None:
    with pytest.raises(DataError, match="choose a level from 0 to 1 m"):
        level_profile(field_of(pipe(), 0.1), z)
