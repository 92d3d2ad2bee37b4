"""What will be done for a case: which model and stages, why, what is left out and why, at what cost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.dem.settings import Settings
from granpipe.field import Grid
from granpipe.geometry.openings import Opening, find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.planning.bulk_friction import BulkFriction
from granpipe.planning.submodel import Span

Model = Literal["dem", "fluid", "hybrid"]


@dataclass(frozen=True)
class Stage:
    """One stage of the run and why the scene needs it; or what is left out and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """What will be done.

    Parameters
    ----------
    settings : of the DEM run of the whole vessel; None unless the model is "dem"
    set_back : the vessel between whose walls the particles are simulated, where it is not the one as drawn
    submodels : sub-models of a hybrid and the spans of sections that they stand for
    followed : spans in which a hybrid follows the field of an earlier run instead
    decisions : settings with their criteria; their warnings and breaches are in `warnings` and `breaches`
    unfit : sections that a fluid does not describe, and why, where the case asks for a fluid all the same
    wall_factors : those of the hoppers that a fluid describes, and the error to be expected there
    friction : what a frictional fluid goes by, alone or in a hybrid; None for a viscous one and for DEM
    space : the vessel where it is one in space; `outline` has the same area at each height then
    particle_steps : cost of DEM, filling included
    seconds, disk_bytes : forecasts for this machine's cores, LIGGGHTS running alone
    """

    case: Case
    outline: Outline
    model: Model
    grid: Grid
    settings: Settings | None
    submodels: tuple[tuple[Span, Plan], ...]
    followed: tuple[Span, ...]
    stages: tuple[Stage, ...]
    left_out: tuple[Stage, ...]
    decisions: tuple[Decision, ...]
    notes: tuple[str, ...]
    particle_steps: float
    seconds: float
    disk_bytes: float
    unfit: tuple[str, ...] = ()
    wall_factors: tuple[Decision, ...] = ()
    friction: BulkFriction | None = None
    set_back: Outline | None = None
    space: SpaceVessel | None = None

    @property
    def openings(self) -> tuple[Opening, ...]:
        """Every narrowing of the vessel, from the top down."""
        return find_openings(self.outline) if self.space is None else self.space.openings

    @property
    def simulated(self) -> Outline:
        """The vessel that particles see: its walls as drawn, or set back."""
        return self.outline if self.set_back is None else self.set_back

    @property
    def facets(self) -> int | None:
        """Facets of the walls per turn that the case asks for; None where it leaves them to granpipe."""
        return None if self.case.dem.facets == "auto" else int(self.case.dem.facets)

    @property
    def deposit_grid(self) -> Grid:
        """The grid on which particles are summed: the columns of the field's own, and more where walls are set back."""
        if self.set_back is None:
            return self.grid
        columns = Grid.covering(self.set_back.r_max, self.outline.z_bottom, self.outline.z_top, self.grid.cell)
        return Grid(columns.r_edges, self.grid.z_edges)

    @property
    def dem(self) -> Settings:
        """The settings of a plan that has a DEM run of its own."""
        assert self.settings is not None
        return self.settings

    @property
    def runs(self) -> tuple[Plan, ...]:
        """The DEM runs of the plan: its own, those of its sub-models, or none."""
        return (self,) if self.settings is not None else tuple(submodel for _, submodel in self.submodels)

    def submodel(self, name: str) -> Plan | None:
        """The plan of a sub-model; None where there is none of this name, because an earlier field is followed."""
        return next((plan for span, plan in self.submodels if span.name == name), None)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should keep in mind."""
        return (*self.notes, *(f"{c.name}: {c.warning}" for c in (*self.wall_factors, *self.decisions) if c.warning))

    @property
    def breaches(self) -> tuple[str, ...]:
        """What lies outside the stable or accurate range: such a run is marked."""
        return (
            *(f"model = fluid: {one}" for one in self.unfit),
            *(f"{c.name} = {c.value}: {c.breach}" for c in self.decisions if c.breach),
        )


def decisions_of(submodels: Iterable[tuple[Span, Plan]]) -> tuple[Decision, ...]:
    """The decisions of sub-models, each once."""
    return tuple(dict.fromkeys(decision for _, submodel in submodels for decision in submodel.decisions))
