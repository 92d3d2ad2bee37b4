"""Dumps of an analytic flow in a channel that is alike all along y: it narrows from below z = 1 to above z = 0.

The left wall stands at x = 0, the right one at X(z), a cosine between 0.4 m and 0.25 m. ψ = −q x/X(z) per metre of
depth, so that w = −q/(X φ) is the same over a level. Spheres are spread at the packing asked for, overlapping.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fakes.analytic_flow import binary_snapshot, table
from numpy.typing import NDArray
from scipy.stats import qmc

Array = NDArray[np.float64]

WIDE, NARROW, DEPTH, HEIGHT = 0.4, 0.25, 0.3, 1.0


@dataclass(frozen=True)
class PlaneFlow:
    """Steady flow of `flow` solids [m²/s, per metre of depth] downwards, of spheres of one radius [m]."""

    flow: float = 0.02
    packing: float = 0.55
    radius: float = 0.02

    def wall(self, z: Array) -> tuple[Array, Array]:
        """X [m] and dX/dz at heights z [m]."""
        phase = np.pi * np.clip((np.asarray(z) - 0.25) / 0.5, 0, 1)
        rise = 0.5 * (WIDE - NARROW)
        return NARROW + rise * (1 - np.cos(phase)), rise * np.pi / 0.5 * np.sin(phase)

    def velocity(self, position: Array) -> Array:
        """(n, 3) of spheres centred at these places [m/s]."""
        x, _, z = position.T
        width, slope = self.wall(z)
        w = -self.flow / (width * self.packing)
        return np.column_stack([w * x * slope / width, 0 * x, w])

    def spheres(self, seed: int, height: float) -> Array:
        """(n, 3) centres from below z = 0 up to a height [m], spread evenly between the walls."""
        low = -4 * self.radius
        draws = qmc.Sobol(3, rng=seed).random(2**15)
        high = low + 2**15 * 4 / 3 * np.pi * self.radius**3 / (self.packing * WIDE * DEPTH)
        assert high > height
        place = [0, 0, low] + draws * [WIDE, DEPTH, high - low]
        inside = (place[:, 0] < self.wall(place[:, 2])[0]) & (place[:, 2] < height)
        return np.asarray(place[inside])

    def snapshots(self, seed: int, interval: float, count: int) -> Iterator[tuple[Array, Array, Array, Array]]:
        """Yield number, position, velocity and radius of the spheres at equal intervals [s]."""
        fastest = self.flow / (NARROW * self.packing)
        position = self.spheres(seed, HEIGHT + 4 * self.radius + fastest * interval * count)
        for _ in range(count):
            velocity = self.velocity(position)
            yield np.arange(1.0, len(position) + 1), position, velocity, np.full(len(position), self.radius)
            middle = position + 0.5 * interval * velocity
            position = position + interval * self.velocity(middle)

    def dumps(self, folder: Path, interval: float, count: int, seed: int = 1) -> tuple[Path, ...]:
        """Write binary snapshots, 1000 steps apart, in a box that ends at the front and back."""
        box = np.array([[-0.1, WIDE + 0.1], [0, DEPTH], [-9, 9]])
        paths = []
        for index, particles in enumerate(self.snapshots(seed, interval, count)):
            paths.append(folder / f"{index}.bin")
            paths[-1].write_bytes(binary_snapshot(1000 * index, box, table(*particles)))
        return tuple(paths)
