"""Keys of `dem` and `homogenize`: the DEM simulation, and the way from particles to a field; values in SI."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from granpipe.case.units import LENGTH, SPEED, TIME
from granpipe.case.values import Group, OneOf, Quantity, SomeOf, Whole, refuse

Outlet = Literal["plate", "open"]
Walls = Literal["auto", "as_drawn", "set_back"]
MassScaling = Literal["auto", "none"]
Snapshots = Literal["none", "thinned", "all"]
Method = Literal["psi", "gaussian"]
MoreFields = Literal[
    "particle_velocity",
    "size_classes",
    "wall_slip",
    "wall_pressure",
    "residence_time",
    "stress",
    "granular_temperature",
    "coordination",
    "mixing",
    "strain_rate",
    "age",
]


class Dem(Group):
    """The DEM simulation."""

    coarse_grain_factor: Annotated[float, Quantity(at_least=1, at_most=100)] = Field(
        default=1.0, description="Particles are enlarged by this factor: fewer of them, the same material."
    )
    mass_scaling: Annotated[MassScaling, OneOf(MassScaling)] = Field(
        default="auto",
        description="`auto`: particles below the Sauter diameter are made heavier, up to four times, until their "
        "inertia allows the time step of that diameter, and gravity smaller, so that the bed weighs the same. Not with "
        "`outlet: open`, nor where `homogenize.fields` has `stress`, `wall_pressure`, `granular_temperature`, "
        "`size_classes` or `mixing`.",
    )
    walls: Annotated[Walls, OneOf(Walls)] = Field(
        default="auto",
        description="Between which walls enlarged particles are simulated: as drawn, or set back into the solid by "
        "half of (`coarse_grain_factor` − 1) Sauter radii of the material, since their centres stay farther from "
        "walls than the material's. The field is that of the vessel as drawn. `auto`: set back, but not in a slab, in "
        "space or in a hybrid, nor with `outlet: open`, nor with `homogenize.fields` that are sums over particles.",
    )
    plate_speed: Annotated[float | Literal["auto"], Quantity(SPEED, above=0, at_most=100, auto=True)] = Field(
        default="auto",
        description="Speed of the plate under the outlet: a numerical choice, not the process flow rate.",
    )
    start_speed: Annotated[float | Literal["auto"], Quantity(SPEED, above=0, at_most=100, auto=True)] = Field(
        default="auto",
        description="Speed of the plate, at the most, while the flow develops, which is not averaged; `auto`: half of "
        "free discharge. Below one and a half times `plate_speed`, or where the start would last less than a particle "
        "diameter of travel, the plate has one speed.",
    )
    time_step: Annotated[float | Literal["auto"], Quantity(TIME, above=0, at_most=1, auto=True)] = Field(
        default="auto",
        description="Time step; `auto` is as long as Rayleigh time, collisions and neighbour skin allow.",
    )
    statistical_error: Annotated[float | None, Quantity(above=0, below=1)] = Field(
        default=None,
        description="Statistical error of the final field, on the whole and in every section, at which production may "
        "end before `max_time`. Unless given it runs to `max_time`.",
    )
    max_time: Annotated[float | Literal["auto"], Quantity(TIME, above=0, at_most=1e6, auto=True)] = Field(
        default="auto",
        description="Longest production, in simulated time after filling, settling and a faster start; `auto`: as long "
        "as the widest section, the vessel's content and `statistical_error` need. A longer one continues the same "
        "run.",
    )
    replicas: Annotated[int, Whole(1, 1000)] = Field(
        default=1,
        description="Independent runs with the seeds `seed`, `seed` + 1, …, side by side on the free cores, and one "
        "average of all.",
    )
    seed: Annotated[int, Whole(0)] = Field(default=1, description="Seed of all random numbers.")
    outlet: Annotated[Outlet, OneOf(Outlet)] = Field(
        default="plate", description="The bed rests on a plate that moves down, or discharges freely."
    )
    reservoir_height: Annotated[float | Literal["auto"], Quantity(LENGTH, above=0, at_most=1000, auto=True)] = Field(
        default="auto",
        description="Height of the bed above the inlet. `auto`: five d90, half an inlet radius, and a whole one above "
        "what is not straight or with an open outlet.",
    )
    facets: Annotated[int | Literal["auto"], Whole(8, 240, auto=True)] = Field(
        default="auto",
        description="Flat facets of the walls per turn, a multiple of 4; `auto` is as few as stay within a tenth of a "
        "particle diameter of the true wall.",
    )
    thickness: Annotated[float | Literal["auto"], Quantity(LENGTH, above=0, at_most=1000, auto=True)] = Field(
        default="auto",
        description="Thickness of the slice of a slab (`symmetry: plane`) that is simulated, between periodic faces; "
        "`auto`: 8 times the particles' d90. Flow rates and fields are those of `outline.depth` all the same.",
    )
    ranks: Annotated[int | Literal["auto"], Whole(1, 4096, auto=True)] = Field(
        default="auto",
        description="MPI processes; `auto` uses the cores that are free when the run begins, as far as it helps. With "
        "another number particles take other paths, and a field is the same within its errors.",
    )
    keep_snapshots: Annotated[Snapshots, OneOf(Snapshots)] = Field(
        default="none", description="Which snapshots to keep; they are averaged while LIGGGHTS runs."
    )


class Homogenize(Group):
    """From particles to a field."""

    cell: Annotated[float | Literal["auto"], Quantity(LENGTH, above=0, at_most=10, auto=True)] = Field(
        default="auto",
        description="Edge length of the cells of the r–z grid; `auto`: a quarter of the Sauter diameter (half of "
        "it in space), or a fortieth of the narrowest opening for a fluid.",
    )
    method: Annotated[Method, OneOf(Method)] = Field(
        default="psi",
        description="How the average is made to conserve mass: by fitting a stream function (psi), or by "
        "scaling rows and Gaussian smoothing (gaussian).",
    )
    start: Annotated[float | Literal["auto"], Quantity(TIME, at_least=0, at_most=1e6, auto=True)] = Field(
        default="auto",
        description="Production time, after a faster start, at which averaging begins, after the transient.",
    )
    smoothing_passes: Annotated[int, Whole(0, 100)] = Field(
        default=2, description="Passes of the 5×5 Gaussian of `method: gaussian`."
    )
    fields: Annotated[tuple[MoreFields, ...], SomeOf(MoreFields)] = Field(
        default=(),
        description="Further results: velocity of the particles in every cell, packing of each size class and "
        "Sauter diameter, slip and contact along the walls, pressure on the walls, residence time; stress and pressure "
        "in the bed, granular temperature, contacts per particle, mixing of sizes, rate of strain, age of the solids.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Homogenize:
        for name in ("residence_time", "age"):
            if self.method == "gaussian" and name in self.fields:
                refuse(f"{name} follows the stream function, which method: gaussian does not give", ("fields",))
        return self
