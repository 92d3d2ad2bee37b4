"""The groups of keys of a case: what may stand in each, its default and its meaning; values in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from granpipe.case.units import (
    ANGLE,
    DENSITY,
    LENGTH,
    MASS_FLOW,
    PRESSURE,
    SPEED,
    TIME,
    VOLUME_FLOW,
    Dimension,
    UnitError,
    length_unit,
    tidy,
)
from granpipe.case.values import (
    File,
    Flow,
    Group,
    Identifier,
    Levels,
    Name,
    OneOf,
    Points,
    Quantity,
    Series,
    Short,
    SomeOf,
    Whole,
    refuse,
)
from granpipe.case.yamlfile import dump_yaml

Point = tuple[float, float]
Polygon = tuple[Point, ...]

Regime = Literal["mass_flow", "funnel_flow", "undecided"]
Model = Literal["auto", "fluid", "dem", "hybrid"]
SectionModel = Literal["fluid", "dem"]
ContactModel = Literal["hertz", "hooke"]
RollingModel = Literal["epsd2", "cdt", "none"]
Outlet = Literal["plate", "open"]
Snapshots = Literal["none", "thinned", "all"]
Method = Literal["psi", "gaussian"]
MoreFields = Literal["particle_velocity", "size_classes", "wall_slip", "wall_pressure", "residence_time"]
Walls = Literal["moving", "slip"]
Solids = Literal["rest", "slip"]
OutletProfile = Literal["developed", "uniform", "annular"]
By = Literal["number", "mass"]
Format = Literal["comsol", "vtk"]
Figure = Literal["rz", "vessel"]

Up = Literal["x", "-x", "y", "-y", "z", "-z"]

LEVEL_TOLERANCE = 1e-9  # m; levels nearer than this are one level

LEAST_PACKING, MOST_PACKING = 0.1, 0.85
"""Packing fraction of any bulk: cohesive powders lie at 0.2, wide size distributions at 0.8."""


class Section(Group):
    """A part of the vessel between two levels."""

    short: ClassVar[str] = "z"

    z: Annotated[tuple[float, float], Levels()] = Field(
        description="Upper and lower level. Short form: the levels themselves, as in `a: [5.9, 4.9]`."
    )
    regime: Annotated[Regime | None, OneOf(Regime)] = Field(
        default=None,
        description="How the hopper flows (Jenike's terms), if you know it; overrides the formula. A wall "
        "more than 60° from the vertical is a floor all the same.",
    )
    wall_factor: Annotated[float | None, Quantity(at_least=0, at_most=1)] = Field(
        default=None,
        description="Wall speed as a part of the mean vertical speed at that level, for the fluid model. "
        "Unless given: 1 on straight walls, in hoppers by a law in wall friction and angle that was fit to DEM.",
    )
    model: Annotated[SectionModel | None, OneOf(SectionModel)] = Field(
        default=None,
        description="Model of this section; overrides the planner's choice.",
    )

    @property
    def z_top(self) -> float:
        """Upper level [m]."""
        return self.z[0]

    @property
    def z_bottom(self) -> float:
        """Lower level [m]."""
        return self.z[1]


class DrawingSpec(Group):
    """The drawing that gives wall and obstacles."""

    file: Annotated[str, File()] = Field(
        description="Drawing of the vessel's inside, in place of `wall` and `obstacles`: DXF, CSV, COMSOL's .mphtxt, "
        "STEP, BREP, STL or OBJ; relative to the folder of the case file. `granpipe outline FILE` shows what it holds."
    )
    axis: Annotated[float | None, Quantity()] = Field(
        default=None,
        description="Where the axis lies across the direction that points up, in the drawing's unit. Unless given, "
        "found: on a layer axis, by symmetry, or at 0.",
    )
    up: Annotated[Up | None, OneOf(Up)] = Field(
        default=None, description="Direction of the drawing that points up. Unless given: y in a plane, found in 3-D."
    )
    tolerance: Annotated[float | None, Quantity(above=0)] = Field(
        default=None,
        description="How far a curve may lie off the straight lines that stand for it, in the drawing's unit. Unless "
        "given: 1e-4 of the drawing's size.",
    )
    unit: Annotated[str | None, Identifier()] = None


DRAWING_KEYS = DrawingSpec.model_fields.keys() - {"unit"}
"""Keys of `outline` that belong to a drawing; none is left in a resolved case."""


class OutlineSpec(Group):
    """The vessel's inside: half of its section through the axis."""

    unit: Annotated[str, Identifier()] = Field(
        default="m", description="Unit of every coordinate of the outline: m, cm, mm, ft, …."
    )
    wall: Annotated[Polygon, Points(at_least=2)] = Field(
        description="Points [r, z] of the inner wall from the inlet (top) down to the outlet; two points at one level "
        "make a ledge. Nothing overhangs: z never rises."
    )
    obstacles: dict[Annotated[str, Identifier()], Annotated[Polygon, Points(at_least=3, closed=True)]] = Field(
        default_factory=dict,
        description="Closed polygons [r, z] by name: on the wall, on the axis (r = 0), or free rings.",
    )
    sections: dict[
        Annotated[str, Identifier()],
        Annotated[Section, Short(Levels())],
    ] = Field(
        default_factory=lambda data: _sections_by_slope(data.get("wall", ())),
        description="Parts of the vessel between two levels, by name. Unless given: one for each change of wall slope, "
        "named s1, s2, …, from the top.",
    )

    @property
    def levels(self) -> dict[str, tuple[float, float]]:
        """Section → its upper and lower level [m]."""
        return {name: section.z for name, section in self.sections.items()}

    @model_validator(mode="before")
    @classmethod
    def _in_metres(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or not isinstance(data.get("unit", "m"), str):
            return data
        factor = _length_unit(data.get("unit", "m"))
        scaled = {key: _scaled(value, factor) for key, value in data.items() if key != "unit"}
        return scaled | ({"unit": "m"} if "unit" in data else {})

    @model_validator(mode="before")
    @classmethod
    def _without_empty(cls, data: Any) -> Any:
        """`obstacles:` or `sections:` with nothing below it but comments is as good as absent."""
        if not isinstance(data, Mapping):
            return data
        return {key: value for key, value in data.items() if value is not None or key not in ("obstacles", "sections")}

    @field_validator("sections")
    @classmethod
    def _downwards(cls, sections: dict[str, Section]) -> dict[str, Section]:
        return dict(sorted(sections.items(), key=lambda item: -item[1].z_top))


def _length_unit(unit: str) -> float:
    try:
        return length_unit(unit)
    except UnitError as error:
        refuse(str(error), ("unit",))


def _scaled(value: Any, factor: float) -> Any:
    """Every number in nested lists and mappings (but not a section's wall factor) times the factor."""
    if isinstance(value, Mapping):
        return {key: item if key == "wall_factor" else _scaled(item, factor) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_scaled(item, factor) for item in value]
    return tidy(value * factor) if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _sections_by_slope(wall: Polygon) -> dict[str, Section]:
    """One section per run of wall segments of equal slope; ledges only separate."""
    runs: list[tuple[float, float, float]] = []
    for (r0, z0), (r1, z1) in pairwise(wall):
        if z0 - z1 <= LEVEL_TOLERANCE:
            runs.append((0.0, z0, z0))
            continue
        slope = (r1 - r0) / (z1 - z0)
        if runs and runs[-1][1] > runs[-1][2] and abs(slope - runs[-1][0]) < 1e-9:
            runs[-1] = (slope, runs[-1][1], z1)
        else:
            runs.append((slope, z0, z1))
    spans = [(top, bottom) for _, top, bottom in runs if top > bottom]
    return {f"s{index}": Section(z=span) for index, span in enumerate(spans, start=1)}


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


class Dem(Group):
    """The DEM simulation."""

    coarse_grain_factor: Annotated[float, Quantity(at_least=1, at_most=100)] = Field(
        default=1.0, description="Particles are enlarged by this factor: fewer of them, the same material."
    )
    plate_speed: Annotated[float | Literal["auto"], Quantity(SPEED, above=0, at_most=100, auto=True)] = Field(
        default="auto",
        description="Speed of the plate under the outlet: a numerical choice, not the process flow rate.",
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
    max_time: Annotated[float, Quantity(TIME, above=0, at_most=1e6)] = Field(
        default=20.0,
        description="Longest production, in simulated time after filling and settling.",
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
        default="auto", description="Height of the auxiliary reservoir above the inlet."
    )
    facets: Annotated[int | Literal["auto"], Whole(8, 240, auto=True)] = Field(
        default="auto",
        description="Flat facets of the walls per turn, a multiple of 4; `auto` is as few as stay within a tenth of a "
        "particle diameter of the true wall.",
    )
    ranks: Annotated[int | Literal["auto"], Whole(1, 4096, auto=True)] = Field(
        default="auto", description="MPI processes; `auto` uses the free cores as far as it helps."
    )
    keep_snapshots: Annotated[Snapshots, OneOf(Snapshots)] = Field(
        default="none", description="Which snapshots to keep; they are averaged while LIGGGHTS runs."
    )


class Homogenize(Group):
    """From particles to a field."""

    cell: Annotated[float | Literal["auto"], Quantity(LENGTH, above=0, at_most=10, auto=True)] = Field(
        default="auto",
        description="Edge length of the cells of the r–z grid; `auto`: a quarter of the Sauter diameter, or a "
        "fortieth of the narrowest opening for a fluid.",
    )
    method: Annotated[Method, OneOf(Method)] = Field(
        default="psi",
        description="How the average is made to conserve mass: by fitting a stream function (psi), or by "
        "scaling rows and Gaussian smoothing (gaussian).",
    )
    start: Annotated[float | Literal["auto"], Quantity(TIME, at_least=0, at_most=1e6, auto=True)] = Field(
        default="auto", description="Production time at which averaging begins, after the transient."
    )
    smoothing_passes: Annotated[int, Whole(0, 100)] = Field(
        default=2, description="Passes of the 5×5 Gaussian of `method: gaussian`."
    )
    fields: Annotated[tuple[MoreFields, ...], SomeOf(MoreFields)] = Field(
        default=(),
        description="Further results: velocity of the particles in every cell, packing of each size class and "
        "Sauter diameter, slip and contact along the walls, pressure on the walls, residence "
        "time.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Homogenize:
        if self.method == "gaussian" and "residence_time" in self.fields:
            refuse("residence_time follows the stream function, which method: gaussian does not give", ("fields",))
        return self


_SIZE_FROM_ZERO = Quantity(LENGTH, at_least=0, at_most=1e4)


class Fluid(Group):
    """The fictitious fluid."""

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
        description="K of the hybrid's volume force, in units of viscosity over the outlet radius squared.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Fluid:
        if (self.outlet_profile == "annular") != (self.annulus is not None):
            refuse("must be given with outlet_profile: annular, and only there", ("annulus",))
        if self.annulus is not None and self.annulus[0] >= self.annulus[1]:
            refuse("must be [inner, outer] with inner below outer", ("annulus",))
        return self


class Case(Group):
    """A case with every default filled in, in SI."""

    _origin: Any = PrivateAttr(default=None)  # of a case that is handed about alone: see `reader.file_of`

    name: Annotated[str, Name()] = Field(description="Name of the case; results go to a folder of this name.")
    outline: OutlineSpec = Field(description="The vessel's inside: half of its section through the axis.")
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
    dem: Dem = Field(default_factory=Dem, description="The DEM simulation.")
    homogenize: Homogenize = Field(default_factory=Homogenize, description="From particles to a field.")
    fluid: Fluid = Field(default_factory=Fluid, description="The fictitious fluid.")
    export: Annotated[tuple[Format, ...], SomeOf(Format)] = Field(
        default=("comsol", "vtk"), description="Which files to write beside field.npz."
    )
    figures: Annotated[tuple[Figure, ...], SomeOf(Figure)] = Field(
        default=("rz", "vessel"), description="Which pictures to make: plots on r–z, the vessel in 3-D."
    )

    @model_validator(mode="after")
    def _consistent(self) -> Case:
        for name, section in self.outline.sections.items():
            if self.model in ("fluid", "dem") and section.model not in (None, self.model):
                refuse(
                    f"must agree with model: {self.model}; or set model: auto", ("outline", "sections", name, "model")
                )
        if self.homogenize.start != "auto" and self.homogenize.start >= self.dem.max_time:
            refuse(f"must be below dem.max_time ({self.dem.max_time:g} s)", ("homogenize", "start"))
        if self.homogenize.method == "gaussian" and self.dem.statistical_error is not None:
            refuse(
                "belongs to homogenize.method: psi, which knows its error; leave it out", ("dem", "statistical_error")
            )
        return self

    def to_yaml(self) -> str:
        """The resolved case as YAML, every default included; loads again as the same case."""
        return dump_yaml(self.model_dump(mode="json", exclude_none=True))
