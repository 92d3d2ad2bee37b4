"""A case: what may stand in it, its defaults and their meaning; values in SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from granpipe.case.contact import Contact
from granpipe.case.fluid import Fluid
from granpipe.case.material import Material
from granpipe.case.outline import OutlineSpec
from granpipe.case.simulation import Dem, Homogenize
from granpipe.case.units import MASS_FLOW, VOLUME_FLOW, Dimension
from granpipe.case.values import Flow, Group, Name, OneOf, Quantity, SomeOf, refuse
from granpipe.case.vessel import VesselSpec
from granpipe.case.yamlfile import dump_yaml

Model = Literal["auto", "fluid", "dem", "hybrid"]
Format = Literal["comsol", "vtk", "openfoam", "fluent", "starccm", "moose", "xdmf", "ngsolve", "netcdf", "streamlines"]
Figure = Literal["rz", "vessel", "animation"]


@dataclass(frozen=True)
class FlowRate:
    """The flow rate of the process: either `volume` of bulk [m³/s] or `mass` [kg/s]."""

    volume: float | None = None
    mass: float | None = None

    @classmethod
    def of(cls, value: float, dimension: Dimension) -> FlowRate:
        """From a value in SI of either dimension."""
        return cls(volume=value) if dimension is VOLUME_FLOW else cls(mass=value)

    def __str__(self) -> str:
        value, dimension = (self.volume, VOLUME_FLOW) if self.mass is None else (self.mass, MASS_FLOW)
        return f"{value!r} {dimension.unit}"


class Case(Group):
    """A case with every default filled in, in SI."""

    _origin: Any = PrivateAttr(default=None)  # of a case that is handed about alone: see `reader.file_of`

    name: Annotated[str, Name()] = Field(description="Name of the case; results go to a folder of this name.")
    outline: OutlineSpec = Field(
        description="The vessel's inside: half of its section through the axis, or the section of a slab. Not beside "
        "`vessel`."
    )
    vessel: VesselSpec | None = Field(default=None, description="The vessel's walls in space, in place of `outline`.")
    material: Material = Field(description="The granular material.")
    contact: Contact = Field(
        default_factory=Contact,
        description="How particles touch; defaults as in Sparta & Halvorsen (2017), but for the stiffness.",
    )
    flow_rate: Annotated[FlowRate, Flow(FlowRate.of)] = Field(description="Flow rate of the process.")
    model: Annotated[Model, OneOf(Model)] = Field(
        default="auto",
        description="Fictitious fluid, particles (dem), both joined (hybrid), or what the sections need (auto).",
    )
    total_error: Annotated[float | None, Quantity(above=0, below=1)] = Field(
        default=None,
        description="Error of the field, against particles of the material's own size, within which `model: auto` "
        "takes the cheapest model: a fluid of either rheology, whose error is known from vessels of the same kind, or "
        "particles. Only beside `model: auto`.",
    )
    dem: Dem = Field(default_factory=Dem, description="The DEM simulation.")
    homogenize: Homogenize = Field(default_factory=Homogenize, description="From particles to a field.")
    fluid: Fluid = Field(default_factory=Fluid, description="The fictitious fluid.")
    export: Annotated[tuple[Format, ...], SomeOf(Format)] = Field(
        default=("comsol", "vtk"),
        description="Which files to write beside field.npz: for COMSOL, ParaView (vtk), OpenFOAM, Fluent, STAR-CCM+, "
        "MOOSE, FEniCSx (xdmf), NGSolve, as NetCDF, and streamlines with residence times.",
    )
    figures: Annotated[tuple[Figure, ...], SomeOf(Figure)] = Field(
        default=("rz", "vessel"),
        description="Which pictures to make: plots on r–z, the vessel in 3-D, an animation of the particles (it needs "
        "`dem.keep_snapshots`).",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Case:
        if (self.outline.symmetry == "space") != (self.vessel is not None):
            refuse("`space` stands beside a `vessel` only: give its walls there", ("outline", "symmetry"))
        if self.vessel is not None and (extra := self.outline.model_fields_set - {"symmetry", "unit"}):
            given = sorted(name for name in extra if getattr(self.outline, name))
            if given:
                refuse("a vessel in space has none of these; leave it out", ("outline", given[0]), show_value=False)
        for name, section in self.outline.sections.items():
            if self.model in ("fluid", "dem") and section.model not in (None, self.model):
                refuse(
                    f"must agree with model: {self.model}; or set model: auto", ("outline", "sections", name, "model")
                )
            if self.total_error is not None and section.model is not None:
                refuse(
                    "total_error chooses one model for the whole vessel; leave this out, or total_error",
                    ("outline", "sections", name, "model"),
                )
        if self.total_error is not None and self.model != "auto":
            refuse("belongs to model: auto, which chooses by it; leave it out", ("total_error",))
        start, end = self.homogenize.start, self.dem.max_time
        if start != "auto" and end != "auto" and start >= end:
            refuse(f"must be below dem.max_time ({end:g} s)", ("homogenize", "start"))
        if "animation" in self.figures and self.dem.keep_snapshots == "none":
            refuse("an animation is made of snapshots that are kept: set dem.keep_snapshots: thinned", ("figures",))
        if self.homogenize.method == "gaussian" and "streamlines" in self.export:
            refuse(
                "streamlines follow the stream function, which homogenize.method: gaussian does not give", ("export",)
            )
        if self.homogenize.method == "gaussian" and self.dem.statistical_error is not None:
            refuse(
                "belongs to homogenize.method: psi, which knows its error; leave it out", ("dem", "statistical_error")
            )
        return self

    def to_yaml(self) -> str:
        """The resolved case as YAML, every default included; loads again as the same case."""
        return dump_yaml(self.model_dump(mode="json", exclude_none=True))
