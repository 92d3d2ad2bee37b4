"""The friction law of a frictional fluid: its parameters, its viscosity and the friction of its walls.

The stress of flowing grains is −p + η (∇u + ∇uᵀ) with the viscosity of friction η = μ P/γ̃: in simple shear the shear
stress is μ P, whatever the speed (Jop, Forterre & Pouliquen, Nature 441 (2006) 727, in the quasi-static limit). γ̃ is
the rate of shear spread over a length ℓ of about the particle size,

    γ̃ − ℓ² ∇²γ̃ = γ̇ + |u_slip| δ_wall,   γ̇ = √(2 D:D)

(a gradient theory as Bouzid et al., Phys. Rev. Lett. 111 (2013) 238301, and Kamrin & Koval, ibid. 108 (2012) 178301,
give for the fluidity). Walls rub with τ = μ_w P against the sliding. Nothing in it has a time of its own: the field
does not depend on the flow rate, on gravity or on the density.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.field import Array

LENGTH = 0.65
"""ℓ over the Sauter diameter."""

SLIP_SHARE = 0.3
"""Sliding below this times `regularization`, in units of the local mean speed, has less than the full friction."""


@dataclass(frozen=True)
class FrictionLaw:
    """Parameters of a frictional fluid; lengths in the unit of the mesh.

    Parameters
    ----------
    internal : μ_i, shear stress over pressure in the bulk
    wall : μ_w, the same on walls and obstacles
    length : ℓ, over which the rate of shear is spread; 0 makes the law local
    regularization : ε over U/R, the mean speed and the radius of the free area at each level: slower shear is viscous
    least_pressure : in units of ρ g R: below it the viscosity no longer falls with the pressure
    """

    internal: float
    wall: float
    length: float
    regularization: float = 0.03
    least_pressure: float = 0.01

    def viscosity(self, pressure: Array, spread_rate: Array, rate: Array, radius: Array) -> Array:
        """η in units of ρ g; the local U/R is `rate`, R is `radius`."""
        held = np.maximum(pressure, self.least_pressure * radius)
        return self.internal * held / np.hypot(spread_rate, self.regularization * rate)

    def drag(self, pressure: Array, slip: Array, speed: Array, radius: Array) -> Array:
        """Wall stress over the slip speed, in units of ρ g; the local U is `speed`."""
        held = np.maximum(pressure, self.least_pressure * radius)
        return self.wall * held / np.hypot(slip, SLIP_SHARE * self.regularization * speed)
