"""From contact to bulk: friction of the bulk and of the bulk on a wall, from the contact parameters.

Laws fit to a virtual shear cell of LIGGGHTS runs (`benchmarks/bulk_friction.py`, ``bulk_friction.json``). Friction of
the bulk grows with that of the contacts and levels off; rolling friction adds to it. On a flat wall particles slide
with the friction of the contact up to where they roll instead; no wall rubs more than the bulk itself.

    μ_i = μ₀ + (μ_∞ − μ₀ + a (1 − e^(−μ_r/ρ))) (1 − e^(−μ/m)),   μ_w = min(μ_c, c + b μ_r, μ_i)
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_DATA = Path(__file__).with_name("bulk_friction.json")


@dataclass(frozen=True)
class BulkFrictionLaw:
    """Coefficients of both laws and the root mean square of measured less fitted values.

    Parameters
    ----------
    frictionless, limit, rolling_gain, rolling_scale, scale : μ₀, μ_∞, a, ρ, m
    rolling_wall, rolling_wall_gain : c, b
    scatter, wall_scatter : of μ_i and of μ_w
    """

    frictionless: float
    limit: float
    rolling_gain: float
    rolling_scale: float
    scale: float
    rolling_wall: float
    rolling_wall_gain: float
    scatter: float = 0.0
    wall_scatter: float = 0.0

    def internal(self, friction: float, rolling: float) -> float:
        """μ_i from friction and rolling friction between particles."""
        gain = self.limit - self.frictionless + self.rolling_gain * (1 - math.exp(-rolling / self.rolling_scale))
        return self.frictionless + gain * (1 - math.exp(-friction / self.scale))

    def wall(self, contact: float, friction: float, rolling: float) -> float:
        """μ_w from the friction of particles on the wall."""
        return min(contact, self.rolling_wall + self.rolling_wall_gain * rolling, self.internal(friction, rolling))


@cache
def bulk_friction_law() -> BulkFrictionLaw:
    """The law that granpipe goes by."""
    return BulkFrictionLaw(**json.loads(_DATA.read_text())["law"])
