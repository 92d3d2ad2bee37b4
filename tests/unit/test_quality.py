"""Gates of a run with a target, and how they tell what is missing."""

import numpy as np
import pytest

from granpipe.field import Grid
from granpipe.homogenize.average import Sums
from granpipe.pipeline.convergence import Convergence, RunningAverage
from granpipe.pipeline.gates import error_gates, missing_time

SECTIONS = {"whole": 0.04, "a": 0.03, "b": 0.06}


def test_the_worst_section_decides():
    error, blocks, travel = error_gates(SECTIONS, effective=25, travel=3, target=0.05, duration=10.0)
    assert (error.name, error.value, error.passed) == ("statistical error, section b", 0.06, False)
    assert blocks.passed
    assert travel.passed
    assert all(gate.passed for gate in error_gates(SECTIONS, effective=25, travel=3, target=0.06, duration=10.0))


def test_an_error_bar_on_few_blocks_is_not_enough():
    error, blocks, _ = error_gates(SECTIONS, effective=19.9, travel=3, target=0.1, duration=10.0)
    assert error.passed
    assert not blocks.passed


def test_an_error_bar_of_a_bed_that_hardly_moved_is_not_enough():
    error, blocks, travel = error_gates(SECTIONS, effective=25, travel=1.0, target=0.1, duration=10.0)
    assert error.passed
    assert blocks.passed
    assert not travel.passed
    assert "about 10 s more" in travel.limit  # twice as far


def test_an_unknown_error_is_not_enough():
    assert not error_gates({}, effective=25, travel=3, target=0.5, duration=10.0)[0].passed


@pytest.mark.parametrize(
    ("target", "effective", "travel", "missing"),
    [(0.06, 20, 2, 0.0), (0.03, 40, 2, 30.0), (0.06, 5, 9, 30.0), (0.02, 10, 3, 80.0), (0.06, 20, 0.5, 30.0)],
)  # the most of (error/target)², 20/blocks and 2 diameters/travel, times 10 s
def test_the_missing_time_follows_from_the_square_root_law(target, effective, travel, missing):
    assert missing_time(SECTIONS, effective, travel, target, 10.0) == pytest.approx(missing)


def sums(start: float, run: int = 0) -> Sums:
    grid = Grid.covering(0.1, 0.0, 0.1, 0.05)
    zero, one = np.zeros((2, 2)), np.zeros(1)
    shapes = {"volume": zero, "flow_r": np.zeros((2, 3)), "flow_z": np.zeros((3, 2)), "gain": zero, "time": one}
    series = {"level_flow": np.zeros((1, 3)), "solids": one, "kinetic": one, "count": one}
    return Sums(grid=grid, sampling="displacement", start=start, stop=start + 1, duration=1.0, weight=1.0, run=run,
                **shapes, **series)  # fmt: skip


def test_a_run_is_judged_now_and_then_until_it_is_good_enough():
    asked: list[int] = []

    def criterion(parts):
        asked.append(len(parts))
        return Convergence({"whole": 0.1}, reached=len(parts) >= 60)

    average = RunningAverage(criterion, [], target=True)
    for number in range(100):
        if average.reached:
            break
        average.add(sums(float(number)))
    assert 60 <= len(average._sums) <= 60 * 1.08 + 1
    assert len(asked) < 40


def test_segments_that_were_dropped_do_not_count():
    average = RunningAverage(lambda parts: Convergence(), [sums(0.0), sums(1.0), sums(0.0, run=1)], target=True)
    average.replace(0, iter([sums(0.0)]))
    assert [(part.run, part.start) for part in average._sums] == [(1, 0.0), (0, 0.0)]


def test_a_standing_names_every_section():
    assert str(Convergence(SECTIONS)) == "error 4 % (a 3, b 6)"
    assert str(Convergence()) == "error not known yet"
