"""Runs that end by themselves when the field is good enough, and replicas, on the real LIGGGHTS."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.field import Field
from granpipe.homogenize.average import Sums
from granpipe.pipeline.run import Outcome, run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts

LONG = {"dem.max_time": "6.4 s", "homogenize.method": "psi", "homogenize.start": "auto"}


class Watched(Silent):
    """Remembers the stages and the last line of the bar."""

    def __init__(self) -> None:
        self.stages: list[str] = []
        self.line = ""

    def stage(self, name: str, detail: str = "") -> None:
        self.stages.append(f"{name}: {detail}" if detail else name)

    def update(self, fraction: float, text: str) -> None:
        assert 0 <= fraction <= 1
        self.line = text


def run(case: Path, results: Path, **changes: str) -> tuple[Outcome, Watched]:
    watched = Watched()
    keys = LONG | {key.replace("__", "."): value for key, value in changes.items()}
    return run_case(read_case(case, keys), results, watched), watched


def figures(results: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((results / "tiny" / "provenance.json").read_text())["figures"]
    return data


def segments(results: Path) -> int:
    return len(list(results.glob(".store/produce-*/segment-*")))


def test_a_run_ends_at_its_target_and_a_tighter_one_continues_it(tiny: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    outcome, watched = run(tiny, results, dem__statistical_error="15 %")
    planned = json.loads((results / "tiny" / "plan.json").read_text())["dem"]["segments"]
    made, found = segments(results), figures(results)
    assert outcome.failed == ()
    assert 20 <= made < planned
    assert max(found["statistical_error"].values()) <= 0.15
    assert found["effective_blocks"] >= 20
    assert "% (s1 " in watched.line
    assert "left" in watched.line
    assert "MB" in watched.line

    outcome, watched = run(tiny, results, dem__statistical_error="0.5 %")
    assert f"produce: continues after segment {made} of {planned}" in watched.stages
    assert segments(results) == planned
    missed = next(gate for gate in outcome.failed if "statistical error" in gate.name)
    assert missed.value == max(figures(results)["statistical_error"].values())
    assert "s more" in missed.limit


def test_replicas_are_averaged_together_and_check_the_error_bar(tiny: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    settings = {"dem__max_time": "1.6 s", "homogenize__start": "0.4 s"}
    settings |= {"contact__youngs_modulus": "1e6"}  # or each would be as stiff as its own first bed lets it be
    run(tiny, results, dem__replicas="2", **settings)
    chains = sorted(results.glob(".store/produce-*"))
    assert len(chains) == 2
    parts = [Sums.load(path) for chain in chains for path in sorted(chain.glob("segment-*/sums.npz"))]
    steady = [sums for sums in parts if sums.start >= 0.4]
    field, found = Field.load(results / "tiny" / "field.npz"), figures(results)
    mean = sum(sums.flow_z for sums in steady) / sum(sums.weight for sums in steady) / field.grid.ring_area
    np.testing.assert_allclose(field.raw_flux_z, found["overlap_correction"] * mean, rtol=1e-10, atol=1e-15)
    assert len(found["particles"]) == 2
    assert found["particles"][0] != found["particles"][1]

    _, watched = run(tiny, results, dem__seed="2", **settings)
    assert {"settle: done before", "produce: done before"} <= set(watched.stages)
    assert not {"settle", "produce"} & set(watched.stages)
