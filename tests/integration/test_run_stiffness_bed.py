"""The check of stiffness on a real bed: a modulus that a wrong formula makes too soft is chosen again."""

from __future__ import annotations

from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.dem import contact
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import settle
from granpipe.pipeline.stiffness import FLOWING, overlap, with_checked_stiffness
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

pytestmark = pytest.mark.liggghts


def test_a_bed_that_came_out_too_soft_is_settled_again_within_its_limits(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contact, "_MEAN_FACTOR", 0.5)  # a third of what beds do
    monkeypatch.setattr(contact, "_P99_FACTOR", 1.3)
    versions = library_versions() | program_versions(tmp_path / "programs.json")
    context = Context(Store(tmp_path / "store"), versions, Silent(), cores=1)
    plan = make_plan(load_case(tiny))
    after = with_checked_stiffness(plan, context)
    before = overlap(settle(plan, context))
    mean, p99 = overlap(settle(after, context))
    assert before[0] > 1.5 * contact.MEAN_OVERLAP
    assert 0.7 * contact.MEAN_OVERLAP < FLOWING * mean <= contact.MEAN_OVERLAP
    assert FLOWING * p99 <= contact.P99_OVERLAP
    expected = before[0] * (plan.dem.youngs_modulus / after.dem.youngs_modulus) ** (2 / 3)
    assert mean == pytest.approx(expected, rel=0.2)  # Hertz
