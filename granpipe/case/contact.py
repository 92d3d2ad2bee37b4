"""Keys of `contact`: how particles touch each other and the walls; values in SI."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from granpipe.case.units import PRESSURE, SPEED
from granpipe.case.values import Group, OneOf, Quantity, refuse

ContactModel = Literal["hertz", "hooke"]
RollingModel = Literal["epsd2", "cdt", "none"]
Restitution = Annotated[float, Quantity(above=0.05, at_most=1)]


Friction = Annotated[float, Quantity(at_least=0, at_most=10)]


_AS_PARTICLES: Any = None  # filled in from the contact between particles


class WallContact(Group):
    """Contact between particle and wall, where it differs from that between particles."""

    friction: Friction = Field(
        default=_AS_PARTICLES, description="Sliding friction on the wall. Unless given: as between particles."
    )
    rolling_friction: Friction = Field(
        default=_AS_PARTICLES, description="Rolling friction on the wall. Unless given: as between particles."
    )
    restitution: Restitution = Field(
        default=_AS_PARTICLES, description="Coefficient of restitution on the wall. Unless given: as between particles."
    )


class Contact(Group):
    """How particles touch. The defaults are those of Sparta & Halvorsen (2017), but for the stiffness."""

    model: Annotated[ContactModel, OneOf(ContactModel)] = Field(default="hertz", description="Normal contact law.")
    youngs_modulus: Annotated[float | Literal["auto"], Quantity(PRESSURE, at_least=1e3, at_most=1e13, auto=True)] = (
        Field(
            default="auto",
            description="Young's modulus; `auto`: the softest that keeps the overlaps under the bed's own weight "
            "within their limits, which allows long time steps.",
        )
    )
    poisson: Annotated[float, Quantity(at_least=0, at_most=0.5)] = Field(default=0.35, description="Poisson's ratio.")
    restitution: Restitution = Field(default=0.43, description="Coefficient of restitution.")
    friction: Friction = Field(default=0.73, description="Coefficient of sliding friction between particles.")
    rolling_model: Annotated[RollingModel, OneOf(RollingModel)] = Field(
        default="epsd2", description="Rolling resistance: spring and slider (epsd2), constant torque (cdt), or none."
    )
    rolling_friction: Friction = Field(
        default_factory=lambda data: 0.0 if data.get("rolling_model") == "none" else 0.21,
        description="Coefficient of rolling friction between particles; 0 with `rolling_model: none`, otherwise 0.21.",
    )
    characteristic_velocity: Annotated[float | None, Quantity(SPEED, above=0, at_most=1000)] = Field(
        default=None,
        description="Impact speed from which Hooke's stiffness is derived; needed with `model: hooke` only.",
    )
    wall: WallContact = Field(
        default_factory=WallContact, validate_default=True, description="Contact with walls, where it differs."
    )

    @field_validator("wall")
    @classmethod
    def _as_particles(cls, wall: WallContact, info: ValidationInfo) -> WallContact:
        """Filled in, but not marked as given: it follows the contact between particles when that is varied."""
        derived = {key: info.data.get(key) for key in WallContact.model_fields}
        given = wall.model_dump(exclude_unset=True)
        return WallContact.model_construct(set(given), **(derived | given))

    @model_validator(mode="after")
    def _consistent(self) -> Contact:
        if self.rolling_model == "none" and self.rolling_friction > 0:
            refuse("must be 0 with rolling_model: none", ("rolling_friction",))
        if self.rolling_model == "none" and self.wall.rolling_friction > 0:
            refuse("must be 0 with rolling_model: none", ("wall", "rolling_friction"))
        if self.model == "hooke" and self.characteristic_velocity is None:
            refuse("missing; Hooke's stiffness is derived from it", ("characteristic_velocity",), show_value=False)
        if self.model == "hertz" and self.characteristic_velocity is not None:
            refuse("belongs to model: hooke; leave it out", ("characteristic_velocity",))
        return self
