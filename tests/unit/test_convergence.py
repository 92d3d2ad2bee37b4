"""How often a run in progress looks at its average."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from fakes.sums import NOTHING

from granpipe.homogenize.average import Sums
from granpipe.pipeline.convergence import Convergence, RunningAverage


@pytest.mark.parametrize(("target", "at"), [(True, [100, 108, 117, 127]), (False, [100, 150])])
def test_the_criterion_is_evaluated_at_a_share_more_segments_larger_without_target(target: bool, at: list[int]) -> None:
    looked: list[int] = []

    def criterion(sums: Sequence[Sums]) -> Convergence:
        looked.append(len(sums))
        return Convergence()

    average = RunningAverage(criterion, [NOTHING] * 100, target=target)
    average.evaluate()
    for _ in range(30 if target else 60):
        average.add(NOTHING)
    assert looked == at
