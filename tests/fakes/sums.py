"""Sums of a segment in which nothing is: two rows and two rings of 5 cm, a second long."""

from __future__ import annotations

import numpy as np

from granpipe.field import Grid
from granpipe.homogenize.average import Sums

NOTHING = Sums(
    grid=Grid.covering(0.1, 0.0, 0.1, 0.05), sampling="velocity", start=0.0, stop=1.0, duration=1.0, weight=1.0,
    volume=np.zeros((2, 2)), flow_r=np.zeros((2, 3)), flow_z=np.zeros((3, 2)), gain=np.zeros((2, 2)), time=np.zeros(1),
    level_flow=np.zeros((1, 3)), solids=np.zeros(1), kinetic=np.zeros(1), count=np.zeros(1),
)  # fmt: skip
