"""Keys of `material`: densities, shear-test angles, particle sizes; values in SI."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from granpipe.case.library import MaterialName
from granpipe.case.units import ANGLE, DENSITY, LENGTH
from granpipe.case.values import Group, OneOf, Quantity, Series, Short, Whole, refuse

By = Literal["number", "mass"]


LEAST_PACKING, MOST_PACKING = 0.1, 0.85
"""Packing fraction of any bulk: cohesive powders lie at 0.2, wide size distributions at 0.8."""


_SIZE = Quantity(LENGTH, above=0, at_most=10)


Length = Annotated[float, _SIZE]


class Normal(Group):
    """A normal distribution, cut."""

    mean: Length = Field(description="Mean before the cut.")
    std: Length = Field(description="Standard deviation before the cut.")
    min: Length = Field(description="Smallest size that occurs.")
    max: Length = Field(description="Largest size that occurs.")

    @model_validator(mode="after")
    def _ordered(self) -> Normal:
        _check_limits(self.min, self.mean, self.max, "mean")
        return self


class Lognormal(Group):
    """A lognormal distribution, cut."""

    median: Length = Field(description="Median before the cut.")
    sigma: Annotated[float, Quantity(above=0, at_most=3)] = Field(
        description="Standard deviation of the natural logarithm of the size."
    )
    min: Length = Field(description="Smallest size that occurs.")
    max: Length = Field(description="Largest size that occurs.")

    @model_validator(mode="after")
    def _ordered(self) -> Lognormal:
        _check_limits(self.min, self.median, self.max, "median")
        return self


def _check_limits(low: float, centre: float, high: float, name: str) -> None:
    if low >= high:
        refuse("must be below max", ("min",))
    if not low <= centre <= high:
        refuse("must lie between min and max", (name,))


class Sieve(Group):
    """A sieve analysis."""

    edges: Annotated[tuple[float, ...], Series(_SIZE, length=2, more=True)] = Field(
        description="Rising mesh sizes; n + 1 edges bound n fractions."
    )
    fractions: Annotated[tuple[float, ...], Series(Quantity(at_least=0, at_most=1), length=1, more=True)] = Field(
        description="Part of the material between neighbouring edges; they add up to 1."
    )

    @model_validator(mode="after")
    def _consistent(self) -> Sieve:
        if any(b <= a for a, b in pairwise(self.edges)):
            refuse("must rise", ("edges",))
        if len(self.fractions) != len(self.edges) - 1:
            refuse(f"must be {len(self.edges) - 1} fractions, one between each two edges", ("fractions",))
        if abs(sum(self.fractions) - 1) > 1e-3:
            refuse(f"must add up to 1 (100 %), not {sum(self.fractions):g}", ("fractions",))
        return self


class Spread(Group):
    """How a size is distributed: exactly one of the keys."""

    short: ClassVar[str] = "mono"

    mono: Annotated[float | None, _SIZE] = Field(
        default=None, description="All alike. Short form: the value itself, as in `radius: 3 cm`."
    )
    normal: Normal | None = Field(default=None, description="Normal distribution, cut at min and max.")
    lognormal: Lognormal | None = Field(default=None, description="Lognormal distribution, cut at min and max.")
    sieve: Sieve | None = Field(default=None, description="Sieve analysis: fractions between mesh sizes.")

    @model_validator(mode="after")
    def _one(self) -> Spread:
        if sum(value is not None for value in self.__dict__.values()) != 1:
            refuse("must be one value, or exactly one of normal, lognormal, sieve")
        return self

    @property
    def kind(self) -> Literal["mono", "normal", "lognormal", "sieve"]:
        """Which of the keys is given."""
        if self.mono is not None:
            return "mono"
        if self.normal is not None:
            return "normal"
        return "lognormal" if self.lognormal is not None else "sieve"

    def halved(self) -> Spread:
        """The same spread of half the size: diameters to radii."""
        lengths = {"mono", "mean", "std", "median", "min", "max", "edges"}

        def half(value: Any) -> Any:
            if isinstance(value, dict):
                return {k: half(v) if k in lengths or isinstance(v, dict) else v for k, v in value.items()}
            return [v / 2 for v in value] if isinstance(value, (list, tuple)) else value / 2

        return Spread(**half(self.model_dump(exclude_none=True)))


_SPREAD_SHORT = Short(_SIZE)


class Size(Group):
    """The size of the particles: either radius or diameter."""

    remedy: ClassVar[str] = "say whether sizes are radii or diameters, as in `size: {radius: 3 cm}`"

    radius: Annotated[Spread | None, _SPREAD_SHORT] = Field(default=None, description="Sizes as radii.")
    diameter: Annotated[Spread | None, _SPREAD_SHORT] = Field(default=None, description="Sizes as diameters.")
    by: Annotated[By, OneOf(By)] = Field(
        default="number",
        description="Whether the distribution is by number of particles or by mass; a sieve analysis must say which.",
    )
    classes: Annotated[int, Whole(1, 50)] = Field(
        default=7, description="Number of particle classes that stand for a normal or lognormal distribution."
    )

    @model_validator(mode="after")
    def _one(self) -> Size:
        if (self.radius is None) == (self.diameter is None):
            refuse(f"must be given as radius or as diameter; {self.remedy}")
        if self.kind == "sieve" and "by" not in self.model_fields_set:
            refuse("missing; say by: mass or by: number for a sieve table", ("by",), show_value=False)
        return self

    @property
    def radii(self) -> Spread:
        """The distribution of the radius [m]."""
        return self.radius or self._diameters.halved()

    @property
    def kind(self) -> Literal["mono", "normal", "lognormal", "sieve"]:
        """Which distribution it is."""
        return (self.radius or self._diameters).kind

    @property
    def _diameters(self) -> Spread:
        assert self.diameter is not None  # exactly one is given
        return self.diameter


class Material(Group):
    """The granular material."""

    name: Annotated[MaterialName | None, OneOf(MaterialName)] = Field(
        default=None,
        description="A material of the library (`granpipe materials`): its density and contact parameters stand where "
        "the case gives none.",
    )
    density: Annotated[float, Quantity(DENSITY, at_least=1, at_most=30000)] = Field(
        description="Density of a particle, its inner pores included."
    )
    bulk_density: Annotated[float | None, Quantity(DENSITY, above=0, at_most=30000)] = Field(
        default=None,
        description="Density of the bulk, voids included; a fluid needs it. Unless given, measured in the plug of DEM.",
    )
    internal_friction_angle: Annotated[float | None, Quantity(ANGLE, above=0, below=math.pi / 2)] = Field(
        default=None, description="Effective angle of internal friction of the bulk (shear test), for Jenike's limit."
    )
    wall_friction_angle: Annotated[float | None, Quantity(ANGLE, at_least=0, below=math.pi / 2)] = Field(
        default=None, description="Angle of friction of the bulk on the wall (shear test), for Jenike's limit."
    )
    repose_angle: Annotated[float | None, Quantity(ANGLE, above=0, below=math.pi / 2)] = Field(
        default=None,
        description="Angle of repose of free surfaces, for a frictional fluid. Unless given, from friction.",
    )
    size: Size = Field(description="Particle sizes; say whether radius or diameter.")

    @model_validator(mode="after")
    def _packs(self) -> Material:
        if self.packing is not None and not LEAST_PACKING <= self.packing <= MOST_PACKING:
            refuse(
                f"is {self.packing:.3g} of density ({self.density:g} kg/m^3); the bulk has voids, and its packing "
                f"fraction must be in [{LEAST_PACKING:g}, {MOST_PACKING:g}]",
                ("bulk_density",),
            )
        return self

    @property
    def packing(self) -> float | None:
        """Packing fraction of the bulk: bulk density over density; None unless the case gives both."""
        return None if self.bulk_density is None else self.bulk_density / self.density
