"""How often a run in progress looks at its average."""

from __future__ import annotations

from collections.abc import Sequence

from fakes.sums import NOTHING

from granpipe.homogenize.average import Sums
from granpipe.pipeline.convergence import Convergence, RunningAverage


def test_the_criterion_is_evaluated_at_eight_percent_more_segments() -> None:
    looked: list[int] = []

    def criterion(sums: Sequence[Sums]) -> Convergence:
        looked.append(len(sums))
        return Convergence()

    average = RunningAverage(criterion, [NOTHING] * 100)
    average.evaluate()
    for _ in range(30):
        average.add(NOTHING)
    assert looked == [100, 108, 117, 127]
