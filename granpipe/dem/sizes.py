"""Size distributions as LIGGGHTS can take them: a few classes of equal spheres.

LIGGGHTS 3.8 knows only constant radii, so a distribution is cut into classes. Every class keeps both the number and the
volume of the particles that it stands for: its radius is the cube root of the mean cube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from granpipe.case.material import Lognormal, Normal, Size
from granpipe.case.schema import Case
from granpipe.errors import CaseError
from granpipe.field import Array

TRUE_MASSES = ("size_classes", "mixing", "granular_temperature", "stress", "wall_pressure")
"""What of homogenize.fields depends on the mass of each particle: on how sizes separate, collide and weigh."""

MOST_DENSE = 4.0
"""Density of the heaviest particles over the material's, at most: fields were compared up to 3.5 (see
docs/validation/mass_scaling.md), and far heavier ones would let the others float."""

_QUADRATURE = 400  # midpoints per class; the densities are smooth, so class volumes are right to 1e-5


@dataclass(frozen=True)
class SizeClasses:
    """Radii (n,) [m], rising, and the share of the particle number in each class (n,), summing to 1.

    Parameters
    ----------
    mass_scaled : particles below the Sauter diameter d₃₂ are heavier than the material's, until their d √ρ is that of
        d₃₂, or they are `MOST_DENSE`. The Rayleigh time goes with it, and so does the inertial number: a slow bed
        hardly notices inertia
    """

    radius: Array
    number_share: Array
    mass_scaled: bool = False

    @property
    def mass_share(self) -> Array:
        """(n,) share of the mass in each class."""
        mass = self.number_share * self.radius**3
        return np.asarray(mass / mass.sum())

    @property
    def density_factor(self) -> Array:
        """(n,) density in each class over the material's; 1 without mass scaling."""
        if not self.mass_scaled:
            return np.ones_like(self.radius)
        due = (0.5 * self.sauter_diameter / self.radius) ** 2
        return np.where(due > 1 + 1e-9, np.minimum(due, MOST_DENSE), 1.0)  # one size is 1, whatever rounding says

    @property
    def mass_factor(self) -> float:
        """Mass of all particles together over what the material's have; gravity is divided by it."""
        return float(1 + self.mass_share @ (self.density_factor - 1))

    def smallest_density(self, density: float) -> float:
        """Density of the smallest particles of a material of this one [kg/m³]."""
        return density * float(self.density_factor[0])

    def mean_mass(self, density: float) -> float:
        """Mean mass of a particle of a material of this density [kg]."""
        return density * self.mass_factor * self.mean_volume

    @property
    def mean_volume(self) -> float:
        """Mean volume of one particle [m³]."""
        return float(4 / 3 * np.pi * self.number_share @ self.radius**3)

    @property
    def smallest(self) -> float:
        """Smallest radius [m]."""
        return float(self.radius[0])

    @property
    def largest(self) -> float:
        """Largest radius [m]."""
        return float(self.radius[-1])

    @property
    def sauter_diameter(self) -> float:
        """Volume over surface mean diameter d₃₂ [m]."""
        return float(2 * (self.number_share @ self.radius**3) / (self.number_share @ self.radius**2))

    @property
    def mean_diameter(self) -> float:
        """Mean diameter by number [m]."""
        return float(2 * self.number_share @ self.radius)

    @property
    def d90(self) -> float:
        """Diameter [m] below which 90 % of the mass lies (that of the class which reaches it)."""
        passing = np.cumsum(self.mass_share)
        return float(2 * self.radius[np.searchsorted(passing, 0.9 - 1e-12)])

    def enlarged(self, factor: float) -> SizeClasses:
        """The same shares with radii multiplied by the coarse-grain factor."""
        return replace(self, radius=self.radius * factor)

    def scaled(self) -> SizeClasses:
        """The same with mass scaling."""
        return replace(self, mass_scaled=True)


def simulated_classes(case: Case) -> SizeClasses:
    """The particles of a DEM run: the material's, enlarged, and with mass scaling where it does no harm."""
    classes = size_classes(case.material.size).enlarged(case.dem.coarse_grain_factor)
    slow, plain = case.dem.outlet == "plate", set(TRUE_MASSES).isdisjoint(case.homogenize.fields)
    return classes.scaled() if case.dem.mass_scaling == "auto" and slow and plain else classes


def size_classes(size: Size) -> SizeClasses:
    """Cut the distribution of a case into classes of radii [m].

    Raises
    ------
    CaseError : the distribution is so narrow that no class holds any of it
    """
    radii = size.radii
    if radii.mono is not None:
        return SizeClasses(np.array([radii.mono]), np.array([1.0]))
    if radii.sieve is not None:
        return _classes(np.array(radii.sieve.edges), np.array(radii.sieve.fractions), _flat, size.by)
    cut = radii.normal or radii.lognormal
    assert cut is not None  # the case gives exactly one
    return _classes(np.linspace(cut.min, cut.max, size.classes + 1), None, _density(cut), size.by)


def _density(cut: Normal | Lognormal) -> Callable[[Array], Array]:
    if isinstance(cut, Normal):
        return lambda r: np.exp(-0.5 * ((r - cut.mean) / cut.std) ** 2)
    return lambda r: np.exp(-0.5 * (np.log(r / cut.median) / cut.sigma) ** 2) / r


def _flat(r: Array) -> Array:
    """Density within one sieve interval: nothing finer is known than its share."""
    return np.ones_like(r)


def _classes(edges: Array, shares: Array | None, density: Callable[[Array], Array], by: str) -> SizeClasses:
    fractions = (np.arange(_QUADRATURE) + 0.5) / _QUADRATURE
    widths = np.diff(edges)
    r = edges[:-1, None] + widths[:, None] * fractions
    with np.errstate(over="ignore"):  # far from a narrow distribution the density is 0
        weight = density(r) * widths[:, None] / _QUADRATURE
    if shares is not None:
        weight *= (shares / weight.sum(axis=1))[:, None]
    number = weight / r**3 if by == "mass" else weight
    count, cube = number.sum(axis=1), (number * r**3).sum(axis=1)
    filled = count > 0
    if not filled.any():
        raise CaseError(
            "the distribution is far narrower than its limits and falls between the classes; narrow the limits, or "
            "give one size",
            ("material", "size"),
        )
    return SizeClasses(np.cbrt(cube[filled] / count[filled]), count[filled] / count.sum())
