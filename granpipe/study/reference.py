"""An earlier run as the reference of a study: the field of its results folder, and the settings it was made with.

A study's own finest point is replaced by it: by a run with the material's own particles, the error of particle size
need not be extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field as Key

from granpipe.analysis.regrid import on_grid
from granpipe.case.reader import load_case, varied
from granpipe.case.schema import Case
from granpipe.errors import CaseError, DataError, GranpipeError
from granpipe.field import Array, Field, Grid
from granpipe.pipeline.field_vessel import check_case
from granpipe.pipeline.provenance import Provenance
from granpipe.planning.flow import target_flow
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.jsonfile import read_json
from granpipe.system.manifest import verify

PLACE = "--reference"

FILES = ("field.npz", "case.yaml", "plan.json", "provenance.json")
"""What of a results folder a reference is made of."""

LARGER_CELLS = 1.25
"""Largest cells of a reference over those of the study: on smaller ones it would only be interpolated."""

_SAME_SIZES = 1e-6

_Positive = Annotated[float, Key(gt=0, allow_inf_nan=False)]
_Amount = Annotated[float, Key(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class EarlierRun:
    """A DEM run that is done, as its results folder tells it.

    Parameters
    ----------
    folder : with its results
    plan : with the settings it was made with, as numbers
    field : on its own cells
    blocks : effective blocks that its standard errors rest on
    travel : plate travel averaged [m]
    time : simulated time of production up to the end of the average [s]
    seconds : processor time of its slowest replica for each rank, filling included; None where it is not told
    cores : how many its replicas kept busy side by side
    failed : quality gates that it failed
    """

    folder: Path
    plan: Plan
    field: Field
    blocks: float
    travel: float
    time: float
    seconds: float | None
    cores: int
    failed: tuple[str, ...]

    def at(self, case: Case, grid: Grid, inside_fraction: Array) -> Field:
        """Its field at the flow rate of a case of the same scene, on other cells."""
        flow = target_flow(case, self.field.bulk_packing)
        return on_grid(replace(self.field, flow_scale=flow / self.field.bulk_flow), grid, inside_fraction)

    @property
    def changes(self) -> dict[str, str]:
        """Of a case of the same scene, that make a run like it."""
        dem, given = self.plan.dem, self.plan.case.dem
        found = {
            "model": "dem",
            "dem.coarse_grain_factor": repr(given.coarse_grain_factor),
            "dem.mass_scaling": given.mass_scaling,
            "dem.walls": "as_drawn" if self.plan.set_back is None else "set_back",
            "contact.youngs_modulus": repr(dem.youngs_modulus),
            "dem.reservoir_height": repr(0.5 * (dem.feed_bottom + dem.feed_top) - self.plan.outline.z_top),
            "dem.facets": str(given.facets),
            "dem.thickness": str(given.thickness),
            "dem.replicas": str(given.replicas),
            "dem.max_time": f"{self.time:.4g}",
            "homogenize.cell": f"{self.field.grid.cell:.6g}",
            "homogenize.start": str(self.plan.case.homogenize.start),
            "dem.start_speed": str(given.start_speed),
        }
        return found if dem.open_outlet else found | {"dem.plate_speed": repr(dem.plate_speed)}

    def is_of(self, other: Plan) -> bool:
        """Whether a plan's DEM run is the same one, longer or shorter or on other cells: their noise is one."""
        if other.settings is None or other.case.dem.seed != self.plan.case.dem.seed:
            return False
        one, two = (_bed(plan) for plan in (self.plan, other))
        return len(one) == len(two) and bool(np.allclose(one, two, rtol=_SAME_SIZES, atol=0))


def _bed(plan: Plan) -> list[float]:
    """What makes a run what it is, beside its scene and its seed."""
    dem = plan.dem
    return [
        *dem.classes.radius,
        dem.youngs_modulus,
        dem.gravity,
        dem.time_step,
        dem.plate_speed,
        dem.start_speed,
        dem.feed_bottom,
        dem.feed_top,
        dem.plate_z,
        dem.placed,
        dem.rest_speed,
        dem.fall_steps,
        float(plan.facets or 0),
        plan.outline.measure.turn,
        plan.simulated.r_max,
    ]


@dataclass(frozen=True)
class _Dem:
    """What is read of the settings in a ``plan.json``."""

    radii_m: Annotated[list[_Positive], Key(min_length=1)]
    time_step_s: _Positive
    youngs_modulus_pa: _Positive
    plate_speed_m_per_s: _Amount
    ranks: Annotated[int, Key(gt=0)]
    mass_factor: _Positive = 1.0


@dataclass(frozen=True)
class _Planned:
    model: str
    dem: _Dem | None = None


@dataclass(frozen=True)
class _Figures:
    """What is read of the figures in a ``provenance.json``."""

    effective_blocks: _Positive
    averaged_plate_travel_m: _Amount
    averaged_to_s: _Positive
    processor_seconds: list[_Positive] | None = None


@dataclass(frozen=True)
class _Measured:
    figures: _Figures


def read_run(folder: Path) -> EarlierRun:
    """The DEM run that a results folder tells of.

    Raises
    ------
    DataError : no results folder, damaged, or not of a DEM run with standard errors and a stream function
    CaseError : its case is not one of this granpipe
    """
    if folder.is_file():
        raise DataError(
            f"{folder}: a file; give the results folder that holds it, which tells particle size, plate speed, "
            "stiffness and time step as well"
        )
    verify(folder, *FILES)
    case, field = load_case(folder / "case.yaml"), Field.load(folder / "field.npz")
    check_case(field, case, folder / "field.npz")
    planned, provenance = read_json(folder / "plan.json", _Planned), Provenance.read(folder)
    if planned.dem is None or planned.model != "dem":
        raise DataError(f"{folder}: the results of a {planned.model}; a reference is a DEM run of the whole vessel")
    if case.vessel is not None:
        raise DataError(f"{folder}: a run in space; a reference is one of an outline")
    if field.psi is None or field.flux_z_se is None:
        what = "stream function" if field.psi is None else "standard error"
        raise DataError(f"{folder}: its field has no {what}; run it with homogenize.method: psi, and longer")
    figures = read_json(folder / "provenance.json", _Measured).figures
    replicas = figures.processor_seconds or []
    return EarlierRun(
        folder=folder,
        plan=_as_made(case, planned.dem, folder),
        field=field,
        blocks=figures.effective_blocks,
        travel=figures.averaged_plate_travel_m,
        time=figures.averaged_to_s,
        seconds=max(replicas) / planned.dem.ranks if replicas else None,
        cores=planned.dem.ranks * max(1, len(replicas)),
        failed=tuple(str(gate) for gate in provenance.quality if not gate.passed),
    )


def _as_made(case: Case, dem: _Dem, folder: Path) -> Plan:
    """The plan with the numbers that were settled when the run was made: rules may have changed since."""
    changes = {"contact.youngs_modulus": repr(dem.youngs_modulus_pa), "dem.time_step": repr(dem.time_step_s)}
    if dem.plate_speed_m_per_s > 0:
        changes["dem.plate_speed"] = repr(dem.plate_speed_m_per_s)
    plan = make_plan(varied(case, changes | {"dem.ranks": "1"}))
    radii = plan.dem.classes.radius
    alike = len(radii) == len(dem.radii_m) and np.allclose(radii, dem.radii_m, rtol=0.01, atol=0)
    if not alike or not math.isclose(plan.dem.classes.mass_factor, dem.mass_factor, rel_tol=0.01):
        raise DataError(f"{folder}: its particles are not those that its case describes now; run it again")
    return plan


def read_reference(folder: Path, case: Case) -> EarlierRun:
    """An earlier run that errors of a case's study can be counted from.

    Raises
    ------
    CaseError : it is damaged, no DEM run, or one of another vessel or material; with place and remedy
    """
    try:
        found = read_run(folder)
    except GranpipeError as error:
        raise CaseError(str(error), place=PLACE) from error
    if apart := list(scene_differences(case, found.plan.case)):
        more = f", and {len(apart) - 3} more" if len(apart) > 3 else ""
        raise CaseError(
            f"{folder} is a run of another vessel or material ({'; '.join(apart[:3])}{more}); give one of this case",
            place=PLACE,
        )
    like = {"model": "dem", "dem.coarse_grain_factor": repr(found.plan.case.dem.coarse_grain_factor)}
    if (found.plan.set_back is None) != (make_plan(varied(case, like)).set_back is None):
        given = found.plan.case.dem.walls
        raise CaseError(
            f"{folder} is a run with dem.walls: {given} and enlarged particles, for which this case has walls of the "
            f"other kind; set dem.walls: {given} here, too",
            place=PLACE,
        )
    return found


def check_cells(run: EarlierRun, cell: float) -> None:
    """Make sure that a reference is not coarser than the cells of a study [m].

    Raises
    ------
    CaseError : it is
    """
    own = run.field.grid.cell
    if own > LARGER_CELLS * cell:
        raise CaseError(
            f"{run.folder} has cells of {own:.3g} m, the study has {cell:.3g} m: run the reference with "
            f"homogenize.cell: {cell:.3g} m, or leave out the points with the finest particles",
            place=PLACE,
        )


def scene(case: Case) -> dict[str, Any]:
    """What flows, and where: all that no numerical setting changes, nor the flow rate, with which velocities scale."""
    plain = case.model_dump(mode="json", exclude_none=True)
    found: dict[str, Any] = {name: plain[name] for name in ("outline", "material", "contact") if name in plain}
    found["contact"].pop("youngs_modulus", None)
    found["material"].pop("bulk_density", None)  # the field does not depend on it
    return found


def scene_differences(case: Case, other: Case) -> Iterator[str]:
    """Where the scene of another case is not that of a case: key, its value, and that of the case."""
    yield from _apart({**scene(case), "outlet": case.dem.outlet}, {**scene(other), "outlet": other.dem.outlet})


def _apart(one: Any, other: Any, place: str = "") -> Iterator[str]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            yield from _apart(one.get(key), other.get(key), f"{place}.{key}" if place else str(key))
    elif one != other and not (isinstance(one, float) and isinstance(other, float) and math.isclose(one, other)):
        values = [_told(value) for value in (other, one)]
        yield f"{place} differs" if None in values else f"{place} is {values[0]} there, {values[1]} here"


def _told(value: Any) -> str | None:
    """A value as text; None where it is too long for a message."""
    text = "not given" if value is None else str(value)
    return text if isinstance(value, str) or not isinstance(value, Mapping | Sequence) else None
