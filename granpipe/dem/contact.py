"""Contact mechanics that fixes the numerical settings: time steps, softening, stress in the bed, orifice flow."""

from __future__ import annotations

import math

GRAVITY = 9.81  # m/s²

STEP_FRACTION = 0.2
"""Time step over Rayleigh time: dense beds with tangential history come to rest at 0.2 and never do at 0.4."""

STIFFNESS_RATIO = 500.0
"""E*/P that keeps the mean overlap near 2 % of a diameter (Hertz: overlap/d ≈ 1.3 (P/E*)^(2/3))."""

YOUNGS_RANGE = (5e6, 1e9)
"""Pa; LIGGGHTS refuses values outside in SI units unless `soft_particles` or `hard_particles` says so."""

_JANSSEN_RATIO = 0.4  # horizontal over vertical stress


def shear_modulus(youngs: float, poisson: float) -> float:
    """G = E / 2(1+ν) [Pa]."""
    return youngs / (2 * (1 + poisson))


def effective_modulus(youngs: float, poisson: float) -> float:
    """E* = E / 2(1−ν²) of two equal bodies in contact [Pa]."""
    return youngs / (2 * (1 - poisson**2))


def rayleigh_time(radius: float, density: float, youngs: float, poisson: float) -> float:
    """Time [s] of a Rayleigh wave round a particle, T_R = π r √(ρ/G) / (0.1631 ν + 0.8766).

    Source: LIGGGHTS ``fix check/timestep/gran``; Li, Xu & Thornton (2005).
    """
    return math.pi * radius * math.sqrt(density / shear_modulus(youngs, poisson)) / (0.1631 * poisson + 0.8766)


def hertz_time(radius: float, density: float, youngs: float, poisson: float, speed: float) -> float:
    """Duration [s] of a Hertzian collision of two equal spheres, T_H = 2.87 (m*²/(R* E*² v))^0.2.

    Source: LIGGGHTS ``fix check/timestep/gran``.
    """
    mass = 4 / 3 * math.pi * radius**3 * density / 2
    modulus = effective_modulus(youngs, poisson)
    return float(2.87 * (mass**2 / (radius / 2 * modulus**2 * speed)) ** 0.2)


def janssen_stress(bulk_density: float, diameter: float, friction: float, depth: float) -> float:
    """Vertical stress [Pa] at a depth in a silo, σ = (ρ g D/4μK)(1 − e^(−4μKz/D)) with K = 0.4; Sperl (2005)."""
    if friction == 0:
        return bulk_density * GRAVITY * depth
    length = diameter / (4 * friction * _JANSSEN_RATIO)
    return bulk_density * GRAVITY * length * -math.expm1(-depth / length)


def softened_modulus(stress: float, poisson: float) -> float:
    """Young's modulus [Pa], two digits, that keeps E*/P at `STIFFNESS_RATIO`, no softer than LIGGGHTS takes."""
    youngs = STIFFNESS_RATIO * stress * 2 * (1 - poisson**2)
    return max(YOUNGS_RANGE[0], two_digits(youngs))


def beverloo_flow(diameter: float, particle: float) -> float:
    """Free discharge through a round opening as bulk flow [m³/s], 0.58 √g (D − 1.4 d)^2.5; 0 where it arches.

    Source: Beverloo, Leniger & van de Velde (1961); constants of Mankoc et al. (arXiv 0707.4550).
    """
    return float(0.58 * math.sqrt(GRAVITY) * max(0.0, diameter - 1.4 * particle) ** 2.5)


def slot_flow(length: float, width: float, particle: float) -> float:
    """Free discharge through a long slot as bulk flow [m³/s], 1.03 √g L (w − 1.4 d)^1.5; the slot form of Beverloo."""
    return float(1.03 * math.sqrt(GRAVITY) * length * max(0.0, width - 1.4 * particle) ** 1.5)


def two_digits(value: float) -> float:
    """`value` rounded down to two significant digits, so that decks read well."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale + 1e-9) * scale:.2g}")
