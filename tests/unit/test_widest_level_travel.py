"""How far a bed moved during an average."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fakes.sums import NOTHING

from granpipe.field import Grid
from granpipe.pipeline.convergence import widest_level_travel


def test_the_widest_level_is_the_slowest() -> None:
    # packing 0.5 in a shaft of 0.2 m and, below it, one of 0.1 m; the solids flow is 1e-4 m³/s for 10 s
    grid = Grid.covering(0.2, 0.0, 0.4, 0.1)
    volume = 0.5 * np.array([[1, 0], [1, 0], [1, 1], [1, 1]]) * grid.cell_volume
    sums = replace(NOTHING, grid=grid, weight=2.0, volume=2 * volume, duration=10.0)
    averaged = cast("Any", SimpleNamespace(plug=SimpleNamespace(solids_flow=1e-4)))
    speed = 1e-4 / (0.5 * np.pi * 0.2**2)
    assert widest_level_travel(averaged, sums, 0.005) == pytest.approx(speed * 10 / 0.005)
