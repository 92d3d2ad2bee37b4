"""Mass flow or funnel flow: Jenike's limit of conical hoppers, from bulk friction angles alone."""

from __future__ import annotations

import math

from granpipe.case.outline import Regime

MARGIN = math.radians(3)
"""A hopper this near its limit may flow either way: usual design allowance."""


def mass_flow_limit(internal_friction: float, wall_friction: float) -> float | None:
    """Largest half-angle from the vertical [rad] at which a cone empties in mass flow; None where there is none.

    θ = 90° − ½ acos((1 − sin δ)/(2 sin δ)) − ½ (φ_w + asin(sin φ_w / sin δ)), for sin δ ≥ 1/3 and φ_w ≤ δ.
    Source: Jenike (1964) in the closed form of Arnold & McLean (1976). Angles are those of the bulk, from a shear
    test: contact friction coefficients are no substitute.

    Parameters
    ----------
    internal_friction, wall_friction : δ and φ_w [rad]
    """
    sine, wall = math.sin(internal_friction), math.sin(wall_friction)
    if sine < 1 / 3 or wall > sine:
        return None
    limit = math.pi / 2 - 0.5 * math.acos((1 - sine) / (2 * sine)) - 0.5 * (wall_friction + math.asin(wall / sine))
    return max(0.0, limit)


def hopper_regime(half_angle: float, internal_friction: float, wall_friction: float) -> tuple[Regime, str]:
    """How a cone flows, and the figures that say so."""
    limit = mass_flow_limit(internal_friction, wall_friction)
    angle = f"{math.degrees(half_angle):.1f}°"
    if limit is None:
        return "undecided", f"half-angle {angle}; Jenike's formula needs sin δ ≥ 1/3 and φ_w ≤ δ"
    figures = f"half-angle {angle}, Jenike's limit {math.degrees(limit):.1f}° less {math.degrees(MARGIN):.0f}°"
    if half_angle <= limit - MARGIN:
        return "mass_flow", figures
    return ("funnel_flow" if half_angle > limit else "undecided"), figures
