"""The wall factor f of a conical hopper from wall friction and angle: a law fit to DEM, and the error that it leaves.

f = exp(−C (1 − e^(−μ_w/μ₀)) tanⁿ θ), θ the half-angle from the vertical, μ_w the friction of particles on the wall:
1 on upright or frictionless walls, less the flatter and rougher they are, and hardly less beyond a friction at which
particles roll and do not slide. `benchmarks/wall_factor.py` simulates the cones and fits the law: ``wall_factor.json``.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_DATA = Path(__file__).with_name("wall_factor.json")
_NEAR = math.radians(15.0), 0.25
"""Distances of half-angle [rad] and friction that count alike when the nearest measured cone is looked for."""


@dataclass(frozen=True)
class MeasuredCone:
    """A cone simulated by DEM, and the fluid that comes nearest to it.

    Parameters
    ----------
    half_angle : from the vertical [rad]
    friction : of particles on the wall
    factor : best f
    error : of the fluid's field in the hopper with it, E of `granpipe.analysis.compare`, noise taken off
    steepness : how E grows with another f: E² = error² + (steepness (f − factor))²
    """

    half_angle: float
    friction: float
    factor: float
    error: float
    steepness: float


@dataclass(frozen=True)
class WallFactorLaw:
    """The law's coefficients, its scatter, and the cones that it was fit to.

    Parameters
    ----------
    strength, friction_scale, exponent : C, μ₀, n
    scatter : root mean square of measured less fitted f
    cones : what was measured
    """

    strength: float
    friction_scale: float
    exponent: float
    scatter: float
    cones: tuple[MeasuredCone, ...]

    def factor(self, half_angle: float, friction: float) -> float:
        """f of a hopper of this half-angle [rad]."""
        roughness = 1 - math.exp(-friction / self.friction_scale)
        return math.exp(-self.strength * roughness * math.tan(half_angle) ** self.exponent)

    def expected_error(self, half_angle: float, friction: float, factor: float) -> float:
        """Error to expect of a fluid's field in such a hopper, E of `granpipe.analysis.compare`.

        That of the nearest measured cone with its best f, and what the scatter of the law and the distance of `factor`
        from it add.
        """
        cone = min(self.cones, key=lambda c: self._distance(c, half_angle, friction))
        off = math.hypot(self.scatter, factor - self.factor(half_angle, friction))
        return math.hypot(cone.error, cone.steepness * off)

    @staticmethod
    def _distance(cone: MeasuredCone, half_angle: float, friction: float) -> float:
        return math.hypot((cone.half_angle - half_angle) / _NEAR[0], (cone.friction - friction) / _NEAR[1])

    def covers(self, half_angle: float) -> bool:
        """Whether cones about as flat were measured; steeper ones tend to f = 1 anyhow."""
        return half_angle <= max(cone.half_angle for cone in self.cones) + math.radians(1)


@cache
def wall_factor_law() -> WallFactorLaw:
    """The law that granpipe goes by."""
    data = json.loads(_DATA.read_text())
    cones = tuple(
        MeasuredCone(math.radians(c["half_angle_deg"]), c["friction"], c["factor"], c["error"], c["steepness"])
        for c in data["cones"]
    )
    return WallFactorLaw(data["strength"], data["friction_scale"], data["exponent"], data["scatter"], cones)
