"""The chart of a study's options is drawn whatever they are."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from granpipe.study.budget import ErrorBound, Option
from granpipe.study.chart import draw_options


def option(point: str, seconds: float, error: float, blocks: float = math.inf) -> Option:
    part = {"whole": ErrorBound(error, error)}
    return Option(point, "psi", 1.0, seconds, 1, {"whole": 0.01}, blocks, part, {"dem.plate_speed": point})


@pytest.mark.parametrize(
    "options",
    [
        [],
        [option("base", 10, 0.1)],
        [option("base", 10, 0.1, blocks=1.001)],
        [option("$x^2_", 10, 0.1), option("slower and no better", 20, 0.2)],
        [option(f"p{number}", 10 + number, 0.5 / (1 + number)) for number in range(12)],
    ],
    ids=["none", "one", "no bound", "odd name", "many on the front"],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_options_are_drawn(tmp_path: Path, options: list[Option]) -> None:
    draw_options(options, "p11", tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 5000
