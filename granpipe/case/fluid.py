"""Keys of `fluid`: the fictitious fluid; values in SI."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from granpipe.case.units import LENGTH
from granpipe.case.values import File, Group, OneOf, Quantity, Series, Whole, refuse

Rheology = Literal["viscous", "frictional"]
Walls = Literal["moving", "slip"]
Solids = Literal["rest", "slip"]
OutletProfile = Literal["developed", "uniform", "annular"]
_SIZE_FROM_ZERO = Quantity(LENGTH, at_least=0, at_most=1e4)


class Fluid(Group):
    """The fictitious fluid."""

    rheology: Annotated[Rheology, OneOf(Rheology)] = Field(
        default="viscous",
        description="The article's viscous fluid, whose walls move at a wall factor; or one with the friction of a "
        "bulk solid, which makes stagnant zones and wall layers by itself and knows free surfaces. In a hybrid the "
        "viscous one follows the particles by a force, the frictional one is joined to them in the margins.",
    )
    order: Annotated[int, Whole(2, 4)] = Field(default=2, description="Polynomial order of the velocity.")
    walls: Annotated[Walls, OneOf(Walls)] = Field(
        default="moving", description="Walls drag the fluid along at their wall factor (moving), or let it slip freely."
    )
    solids: Annotated[Solids, OneOf(Solids)] = Field(
        default="rest", description="On ledges and obstacles the fluid is at rest, or slips freely."
    )
    outlet_profile: Annotated[OutletProfile, OneOf(OutletProfile)] = Field(
        default="developed",
        description="Velocity profile with which the fluid leaves: as if the vessel continued (developed), the same "
        "speed everywhere (uniform), or the same speed within `annulus` (annular).",
    )
    annulus: Annotated[tuple[float, float] | None, Series(_SIZE_FROM_ZERO, length=2)] = Field(
        default=None, description="Inner and outer radius of an annular outlet; needed there only."
    )
    known_field: Annotated[str | None, File()] = Field(
        default=None,
        description="A `field.npz` of an earlier run that a hybrid follows, in place of DEM runs of its own; the path "
        "is relative to where granpipe is started.",
    )
    force_factor: Annotated[float, Quantity(above=0, at_most=1e14)] = Field(
        default=1e5,
        description="K of the volume force of a hybrid with a viscous fluid, in units of viscosity over the outlet "
        "radius squared.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Fluid:
        if self.rheology == "frictional":
            for key in ("order", "walls", "solids", "force_factor"):
                if key in self.model_fields_set and getattr(self, key) != type(self).model_fields[key].default:
                    refuse("belongs to rheology: viscous; leave it out", (key,))
        if (self.outlet_profile == "annular") != (self.annulus is not None):
            refuse("must be given with outlet_profile: annular, and only there", ("annulus",))
        if self.annulus is not None and self.annulus[0] >= self.annulus[1]:
            refuse("must be [inner, outer] with inner below outer", ("annulus",))
        return self
