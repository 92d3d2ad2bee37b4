"""Spheres in free flight: all that a snapshot is asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass
class Spheres:
    """Numbers (n,), centres and velocities (n, 3), radii (n,) [m, m/s]."""

    id: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray

    def after(self, time: float) -> Spheres:
        """The same spheres some time [s] later."""
        return replace(self, position=self.position + time * self.velocity)
