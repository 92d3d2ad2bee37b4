"""Contact mechanics that fixes the numerical settings: time steps, softening, stress in the bed, orifice flow."""

from __future__ import annotations

import math

GRAVITY = 9.81  # m/s²

MEAN_OVERLAP, P99_OVERLAP = 0.015, 0.05
"""Overlap of touching particles over their mean diameter, at most: mean and 99th percentile of a bed."""

WALL_OVERLAP = 0.5
"""Overlap of the smallest particles with a wall over their radius, at most, where the largest press on them with the
99th percentile of the force between two of these."""

JANSSEN_RATIO = 0.4
"""Horizontal over vertical stress of a bed at rest."""

STEP_SHARE = {"epsd2": 0.28, "cdt": 0.28, "none": 0.28}
"""Time step over the smallest particle's Rayleigh time where contacts are not damped, for each rolling model."""

LONGEST_STEP = 0.2
"""The same, at most: what is common for dense beds."""

CONTACTS = 5.0
"""Contacts of a particle in a dense bed that damp it together."""

HERTZ_SHARE = 0.2
"""Time step over the duration of the fastest collision, at most: below it the collision keeps its energy."""

SKIN_SHARE = 0.4
"""Way of the fastest particle in one step over the neighbour skin, at most; beyond 0.5 contacts are missed."""

SHEAR_LAYER = 7.5
"""Thickness of shear layers in particle diameters; they are 5 to 10 of them thick."""

FRICTION_SLOPE = 2.0
"""Relative change of the bulk friction per inertial number: 2 % at I = 0.01, 20 % at 0.12.

Source: da Cruz et al., Phys. Rev. E 72, 021309 (2005); GDR MiDi, Eur. Phys. J. E 14, 341 (2004).
"""

STEEPER = math.radians(10)
"""Filling below an edge over the angle of repose: solids must run down by themselves, or the free surface would be the
filling's."""

_MEAN_FACTOR, _P99_FACTOR = 1.3, 3.3
"""Overlap over (σ/E*)^(2/3): mean with the bed's mean stress (Hertz; Pongó et al., New J. Phys. 23, 023001), 99th
percentile with its greatest; measured 1.0–1.4 and 2.8–3.5 in beds of granpipe, see docs/validation/stability.md."""


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


def step_share(rolling_model: str, restitution: float) -> float:
    """Longest time step over the smallest particle's Rayleigh time at which a dense bed comes to rest.

    Verlet's scheme takes damping from the velocity half a step ago: an oscillator of damping ratio ζ stays stable up to
    √(1 + ζ²) − ζ of the undamped limit (Belytschko, Liu & Moran 2000, ch. 6). Of Z contacts ζ = β √(5Z/6) with
    β = −ln e / √(π² + ln² e) (Tsuji et al. 1992). The factors are measured: docs/validation/stability.md.
    """
    log = -math.log(restitution)
    damping = log / math.hypot(math.pi, log) * math.sqrt(5 / 6 * CONTACTS)
    return min(LONGEST_STEP, STEP_SHARE[rolling_model] * (math.hypot(1.0, damping) - damping))


def janssen_step(stress: float, bulk_density: float, diameter: float, friction: float, depth: float) -> float:
    """Vertical stress [Pa] a depth [m] further down a pipe, dσ/dz = ρ g − 4 μ K σ/D with K = 0.4; Sperl (2005)."""
    if friction == 0:
        return stress + bulk_density * GRAVITY * depth
    length = diameter / (4 * friction * JANSSEN_RATIO)
    final = bulk_density * GRAVITY * length
    return final + (stress - final) * math.exp(-depth / length)


def softened_modulus(mean_stress: float, peak_stress: float, poisson: float) -> float:
    """Least Young's modulus [Pa] at which a bed under these stresses keeps both limits of overlap."""
    modulus: float = max(
        mean_stress * (_MEAN_FACTOR / MEAN_OVERLAP) ** 1.5,
        peak_stress * (_P99_FACTOR / P99_OVERLAP) ** 1.5,
    )
    return modulus / effective_modulus(1.0, poisson)


def wall_stiffening(size_ratio: float) -> float:
    """Factor on the softened modulus where the largest particles, so many times larger, press the smallest into walls.

    Under the force F = 4/3 E* √(R/2) (2 R δ)^(3/2) of two largest with the 99th percentile of overlap δ, one of radius
    R/q between one of them and a flat wall goes into it by (2 δ^(3/2) q²)^(2/3) of its radius (Hertz); beyond one its
    centre is outside, and it is lost.
    """
    factor: float = 2 * (P99_OVERLAP / WALL_OVERLAP) ** 1.5 * size_ratio**2
    return max(1.0, factor)


def stiffening(mean_overlap: float, p99_overlap: float) -> float:
    """Factor on Young's modulus that brings a measured overlap within its limits: overlap goes with E^(−2/3)."""
    excess: float = max(mean_overlap / MEAN_OVERLAP, p99_overlap / P99_OVERLAP) ** 1.5
    return excess


def beverloo_flow(diameter: float, particle: float) -> float:
    """Free discharge through a round opening as bulk flow [m³/s], 0.58 √g (D − 1.4 d)^2.5; 0 where it arches.

    Source: Beverloo, Leniger & van de Velde (1961); constants of Mankoc et al. (arXiv 0707.4550).
    """
    return float(0.58 * math.sqrt(GRAVITY) * max(0.0, diameter - 1.4 * particle) ** 2.5)


def slot_flow(length: float, width: float, particle: float) -> float:
    """Free discharge through a long slot as bulk flow [m³/s], 1.03 √g L (w − 1.4 d)^1.5; the slot form of Beverloo."""
    return float(1.03 * math.sqrt(GRAVITY) * length * max(0.0, width - 1.4 * particle) ** 1.5)


def rectangle_flow(length: float, width: float, particle: float) -> float:
    """Free discharge through a rectangle as bulk flow [m³/s], 1.03 √g (L − 1.4 d)(w − 1.4 d)^1.5, L the longer side."""
    short, long = sorted((length, width))
    return slot_flow(max(0.0, long - 1.4 * particle), short, particle)


def inertial_number(speed: float, gap: float, particle: float, density: float, stress: float) -> float:
    """I = γ̇ d √(ρ/P) of a bed that moves at this speed [m/s] through a gap [m] under a vertical stress [Pa].

    The speed falls to 0 over a shear layer of `SHEAR_LAYER` diameters, or half the gap; P is the mean of the three
    principal stresses. Source: GDR MiDi (2004).
    """
    layer = min(SHEAR_LAYER * particle, 0.5 * gap)
    pressure = stress * (1 + 2 * JANSSEN_RATIO) / 3
    return speed / layer * particle * math.sqrt(density / pressure)


def filling_angle(friction: float, rolling_friction: float) -> float:
    """Angle from the horizontal below an edge up to which a vessel is filled [rad].

    `STEEPER` than heaps are: tan α = 0.32 + 0.23 s + 0.42 s q with s = 1 − e^(−μ/0.3) and q = 1 − e^(−μ_r/0.325), by
    least squares through those of docs/validation/repose.md, which scatter by 1.1° about it and reach μ = 0.9 and
    μ_r = 0.4; beyond, it levels off. Surfaces that flow are flatter.
    """
    sliding, rolling = -math.expm1(-friction / 0.3), -math.expm1(-rolling_friction / 0.325)
    return math.atan(0.32 + 0.23 * sliding + 0.42 * sliding * rolling) + STEEPER


def two_digits(value: float) -> float:
    """`value` rounded down to two significant digits, so that decks read well."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale + 1e-9) * scale:.2g}")


def two_digits_up(value: float) -> float:
    """`value` rounded up to two significant digits."""
    down = two_digits(value)
    return down if math.isclose(down, value) else two_digits(down + 10.0 ** (math.floor(math.log10(down)) - 1))
