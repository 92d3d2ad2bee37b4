"""Vertical stress in a bed at rest, level by level: Janssen with the vessel's own diameter at each level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from granpipe.dem.contact import janssen_step
from granpipe.field import ROUND, Array, Measure

_SLICES = 40  # of each straight piece of wall


@dataclass(frozen=True)
class BedStress:
    """Stress [Pa] at the lower ends of slices of the bed, from the top down.

    Parameters
    ----------
    level : (n,) falling [m]
    stress : (n,) mean vertical stress there [Pa]
    volume : (n,) of the slices [m³]
    """

    level: Array
    stress: Array
    volume: Array

    @property
    def mean(self) -> float:
        """By volume [Pa]."""
        return float(np.average(self.stress, weights=self.volume))

    @property
    def peak(self) -> float:
        """The greatest [Pa]: at the switch from shaft to hopper, or at the bottom."""
        return float(self.stress.max())

    def at(self, z: float) -> float:
        """At a level, from above [Pa]."""
        return float(np.interp(-z, -self.level, self.stress))


def bed_stress(
    wall: Sequence[tuple[float, float]], bulk_density: float, friction: float, measure: Measure = ROUND
) -> BedStress:
    """Stress in a bed that fills a vessel to its top and rests on its bottom.

    Where the vessel widens at a ledge the bed's weight is spread over the larger area; where it narrows the ledge
    carries what stands on it. Obstacles carry nothing: with them the stress is lower.

    Parameters
    ----------
    wall : (r, z) of the wall from the top of the bed to its bottom [m]; of a slab (width, z)
    bulk_density : [kg/m³]
    friction : on the wall
    measure : what the section stands for, and by that 4 × area / perimeter of a level
    """
    stress = 0.0
    rows: list[tuple[float, float, float]] = []
    for (r0, z0), (r1, z1) in pairwise(wall):
        if z0 <= z1:
            stress *= min(1.0, (r0 / r1) ** 2 if measure.axial else r0 / r1)
            continue
        edges = np.linspace(0, 1, _SLICES + 1)
        depth = (z0 - z1) / _SLICES
        for share in 0.5 * (edges[1:] + edges[:-1]):
            r = r0 + (r1 - r0) * share
            diameter = measure.hydraulic_diameter(2 * r if measure.axial else r)
            stress = janssen_step(stress, bulk_density, diameter, friction, depth)
            rows.append((z0 + (z1 - z0) * share - 0.5 * depth, stress, float(measure.area(0.0, r)) * depth))
    return BedStress(*np.array(rows).T)
