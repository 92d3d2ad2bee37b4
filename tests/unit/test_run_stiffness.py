"""Young's modulus after the settled bed: left alone, chosen again, and at most twice."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from fakes.records import settled

from granpipe.case.reader import load_case
from granpipe.dem import contact
from granpipe.pipeline import stiffness
from granpipe.pipeline.context import Context
from granpipe.pipeline.records import OverlapRecord
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent
from granpipe.system.store import Store

Overlaps = Callable[[float], tuple[float, float]]


def with_checked_stiffness(
    tiny: Path, overlaps: Overlaps, monkeypatch: pytest.MonkeyPatch, ranks: int = 1, **changes: str
) -> tuple[Plan, list[float]]:
    """The plan after beds that overlap as they do at a modulus, and the moduli that were tried."""
    tried: list[float] = []

    def settle(plan: Plan, *_: object) -> Path:
        tried.append(plan.dem.youngs_modulus)
        mean, p99 = overlaps(plan.dem.youngs_modulus)
        settled(overlap=OverlapRecord(mean, p99)).write(tiny.parent)
        return tiny.parent

    monkeypatch.setattr(stiffness, "settle", settle)
    plan = make_plan(load_case(tiny, {key.replace("__", "."): value for key, value in changes.items()}))
    plan = replace(plan, settings=replace(plan.dem, ranks=ranks))
    return stiffness.with_checked_stiffness(plan, Context(Store(tiny.parent), {}, Silent(), cores=1)), tried


def test_a_modulus_of_the_case_is_left_alone(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, tried = with_checked_stiffness(tiny, lambda _: (1.0, 1.0), monkeypatch, contact__youngs_modulus="2e6")
    assert plan.dem.youngs_modulus == 2e6
    assert tried == []


def test_a_bed_that_overlaps_little_keeps_its_modulus(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, tried = with_checked_stiffness(tiny, lambda _: (0.01, 0.03), monkeypatch)
    assert tried == [make_plan(load_case(tiny)).dem.youngs_modulus] == [plan.dem.youngs_modulus]


def test_a_bed_after_hertz_is_within_its_limits_after_one_more_choice(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = make_plan(load_case(tiny))

    def hertz(youngs: float) -> tuple[float, float]:
        share = (first.dem.youngs_modulus / youngs) ** (2 / 3)
        return 0.03 * share, 0.06 * share

    plan, tried = with_checked_stiffness(tiny, hertz, monkeypatch)
    assert len(tried) == 2
    mean, p99 = hertz(plan.dem.youngs_modulus)
    flows = stiffness.FLOWING  # of the settled bed's overlap
    assert 0.85 * contact.MEAN_OVERLAP < flows * mean <= contact.MEAN_OVERLAP
    assert flows * p99 <= contact.P99_OVERLAP
    assert plan.dem.time_step == pytest.approx(
        first.dem.time_step * (first.dem.youngs_modulus / plan.dem.youngs_modulus) ** 0.5, rel=0.1
    )
    assert plan.dem.plate_z == first.dem.plate_z  # the walls stand as they do
    (decision,) = [decision for decision in plan.decisions if decision.name == "youngs_modulus"]
    assert "overlapped by 3.00% and 6.00%" in decision.criterion
    assert {c.name for c in plan.decisions} == {c.name for c in first.decisions}
    assert plan.breaches == ()
    assert plan.case == first.case


@pytest.mark.parametrize("excess", [1.5, 2.0, 2.5, 3.0])
def test_a_tenth_is_put_on_the_modulus_that_hertz_asks_for(
    excess: float, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Overlap goes with E^(−2/3), and a bed that flows has 0.85 of it; two digits, rounded up."""
    plan, tried = with_checked_stiffness(tiny, lambda _: (0.015 * excess / 0.85, 0.0), monkeypatch)
    for one, other in pairwise([*tried, plan.dem.youngs_modulus]):
        digits = 10 ** (math.floor(math.log10(1.1 * excess**1.5 * one)) - 1)
        assert other == pytest.approx(math.ceil(1.1 * excess**1.5 * one / digits) * digits)


def test_it_is_chosen_again_twice_at_the_most(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, tried = with_checked_stiffness(tiny, lambda _: (0.03, 0.06), monkeypatch)
    assert len(tried) == 2
    assert plan.dem.youngs_modulus > tried[1] > tried[0]


def test_the_vessel_is_filled_again_on_as_many_ranks(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They were counted by the cores that were free when the run began."""
    plan, tried = with_checked_stiffness(tiny, lambda _: (0.03, 0.06), monkeypatch, ranks=2)
    assert len(tried) > 1
    assert plan.dem.ranks == 2
