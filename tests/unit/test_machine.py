"""Rates of this machine: kept by machine, and forecasts by them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.pipeline.calibrate import calibration_case
from granpipe.planning.cost import assumed_rate
from granpipe.planning.forecast import forecast
from granpipe.planning.make import make_plan
from granpipe.system.rates import Rates, keep_rates, known_rates, machine

CASES = Path(__file__).parents[2] / "cases"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "granpipe" / "rates.json"


def test_nothing_is_known_before_it_is_measured() -> None:
    assert known_rates() is None


def test_rates_are_found_again(cache: Path) -> None:
    keep_rates({1: 1e6, 2: 1.8e6})
    found = known_rates()
    assert found is not None
    assert found.by_ranks == {1: 1e6, 2: 1.8e6}
    assert found.made in cache.read_text()


def test_another_machine_with_the_same_cache_keeps_its_own(cache: Path) -> None:
    cache.parent.mkdir()
    cache.write_text(json.dumps({"another": {"made": "2026-01-01", "rates": {"1": 5.0}}}))
    assert known_rates() is None
    keep_rates({1: 1e6})
    assert set(json.loads(cache.read_text())) == {"another", machine()}


@pytest.mark.parametrize("text", ["", "[]", "{", '{"x": 1}'])
def test_a_damaged_file_counts_as_none(cache: Path, text: str) -> None:
    cache.parent.mkdir()
    cache.write_text(text)
    assert known_rates() is None
    assert keep_rates({1: 1e6}).by_ranks == {1: 1e6}


def test_a_machine_of_half_the_speed_takes_twice_as_long() -> None:
    plan = make_plan(load_case(CASES / "smoke.yaml", {"dem.ranks": "1"}))
    assert forecast(plan, None) == plan.seconds
    assert forecast(plan, Rates("", {1: 0.5 * assumed_rate(1)})) == pytest.approx(2 * plan.seconds)


def test_of_a_hybrid_only_the_particles_scale() -> None:
    plan = make_plan(load_case(CASES / "reactor_hybrid.yaml", {"dem.ranks": "1"}))
    particles = sum(part.seconds for _, part in plan.submodels)
    slow = Rates("", {1: assumed_rate(1) / 3})
    assert forecast(plan, slow) == pytest.approx(plan.seconds + 2 * particles)


def test_more_ranks_than_were_measured_go_by_the_most_that_were() -> None:
    rates = Rates("", {1: 1e6, 2: 1.5e6})
    assert rates.of(1) == 1e6
    assert rates.of(2) == 1.5e6
    assert 1.5e6 < rates.of(4) < 3e6


def test_the_calibration_is_short_and_sound() -> None:
    plan = make_plan(calibration_case(1))
    assert 5e6 < plan.particle_steps < 2e7
    assert not plan.breaches
