"""`homogenize.fields`: additional fields that a case requests, from the sums in production to arrays in the field."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.analysis.residence_time import residence_time
from granpipe.analysis.strain_rate import COMPONENTS, shear_rate, strain_rate
from granpipe.analysis.streamlines import age
from granpipe.case.schema import Case
from granpipe.dem.contact import GRAVITY
from granpipe.dem.contacts import read_pair_contacts, read_wall_contacts
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.snapshot import Snapshot
from granpipe.field import Array, Field, Grid, Particles, cell_vectors
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import CHORD_ERROR
from granpipe.geometry.wall_pieces import WallPieces
from granpipe.homogenize.average import Extra, Sums
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.extras import (
    Arrays,
    SizeClassVolumes,
    WallSlip,
    measured_together,
    size_class_arrays,
    wall_forces,
    wall_pressure_arrays,
    wall_slip_arrays,
)
from granpipe.homogenize.particle_fields import (
    contact_counts,
    coordination_arrays,
    mixing_arrays,
    mixing_sums,
    temperature_arrays,
    velocity_moments,
    whole_mixing,
)
from granpipe.homogenize.solids_velocity import solids_velocity
from granpipe.homogenize.stress import contact_stress, stress_arrays, supported
from granpipe.planning.plan import Plan

PIECES_PER_DIAMETER = 1
"""Pieces of walls per Sauter diameter: particles touch a wall about this far apart."""

FORCES = ("wall_pressure", "stress")
"""What takes the forces of contacts, which only granpipe's own runs write."""

_SUMMED = ("size_classes", "wall_slip", "wall_pressure", "stress", "granular_temperature", "coordination", "mixing")


class ExtraSums:
    """What is collected from particles for a case beside volume and flow.

    Parameters
    ----------
    case : its ``homogenize.fields``; what needs no sums is passed over
    outline : the vessel
    classes : sizes of the particles in the dumps
    grid : of the field
    """

    def __init__(self, case: Case, outline: Outline, classes: SizeClasses, grid: Grid) -> None:
        wanted = case.homogenize.fields
        self.wanted = tuple(name for name in _SUMMED if name in wanted)
        self.strained = "strain_rate" in wanted
        self.radii, self.diameter = classes.radius, classes.sauter_diameter
        self.grid, self.density, self.contact = grid, case.material.density, case.contact
        self._pieces = WallPieces.of(outline, self.diameter / PIECES_PER_DIAMETER)
        self._bins = Bins.of(grid, self.diameter)

    @classmethod
    def of(cls, plan: Plan) -> ExtraSums:
        """What production collects."""
        return cls(plan.case, plan.outline, plan.dem.classes, plan.grid)

    @property
    def key(self) -> dict[str, Any]:
        """What the stored sums depend on; empty where nothing is asked for."""
        return {"extra": sorted(self.wanted), "edges": self._pieces.edges.tolist()} if self.wanted else {}

    @property
    def extras(self) -> list[Extra]:
        """What is summed over particles on their ways."""
        makers: dict[str, Callable[[], Extra]] = {
            "size_classes": lambda: SizeClassVolumes(self.radii),
            "wall_slip": lambda: WallSlip(self._pieces, CHORD_ERROR * self.diameter),
        }
        return [make() for name, make in makers.items() if name in self.wanted]

    def seen(self, particles: Particles) -> Arrays:
        """What one snapshot tells by itself."""
        makers: dict[str, Callable[[], Arrays]] = {
            "granular_temperature": lambda: velocity_moments(self._bins, particles),
            "coordination": lambda: contact_counts(self._bins, particles),
            "mixing": lambda: mixing_sums(self.grid, self.radii, self.diameter, particles),
        }
        return {name: array for wanted in self.wanted if wanted in makers for name, array in makers[wanted]().items()}

    def observed(self, work: Path, step: int, snapshot: Snapshot) -> Arrays:
        """What one snapshot tells, with what LIGGGHTS has written of this step beside it; those files are deleted."""
        values = self.seen(snapshot)
        if set(self.wanted).isdisjoint(FORCES):
            return values
        path = work / f"contacts.{step}.txt"
        walls = read_wall_contacts(path)
        path.unlink()
        if "wall_pressure" in self.wanted:
            beside = walls.across_depth() if self.grid.measure.walled else walls
            values |= wall_forces(self._pieces, beside.end, beside.force)
        if "stress" in self.wanted:
            path = work / f"pairs.{step}.txt"
            pairs = read_pair_contacts(path, snapshot.id, snapshot.position)
            path.unlink()
            pairs = pairs.through_faces(self.grid.period).within_friction(self.contact.friction)
            walls = walls.within_friction(self.contact.wall.friction)
            values |= contact_stress(self._bins, pairs, walls, snapshot, self.density)
        return values

    def arrays(self, segments: Sequence[Sums], inside_fraction: Array) -> Arrays:
        """The arrays that segments give."""
        makers: dict[str, Callable[[], Arrays]] = {
            "size_classes": lambda: size_class_arrays(segments, self.radii, inside_fraction),
            "wall_slip": lambda: wall_slip_arrays(segments, self._pieces),
            "wall_pressure": lambda: wall_pressure_arrays(segments, self._pieces),
            "stress": lambda: stress_arrays(segments, self._bins, inside_fraction),
            "granular_temperature": lambda: temperature_arrays(segments, self._bins),
            "coordination": lambda: coordination_arrays(segments, self._bins),
            "mixing": lambda: mixing_arrays(segments, self.grid, self.diameter, inside_fraction),
        }
        return {name: array for wanted in self.wanted for name, array in makers[wanted]().items()}

    def added(self, field: Field, segments: Sequence[Sums]) -> Field:
        """The field of an average with all that its segments tell beside."""
        extra = self.arrays(segments, field.inside_fraction)
        if self.strained:

            def rates(sums: Sums) -> Array:
                strain = strain_rate(field, solids_velocity(sums, self.diameter))
                return np.array([*strain, shear_rate(strain)])

            extra |= measured_together((*COMPONENTS, "shear_rate"), segments, rates)
        return replace(field, extra=extra)

    def figures(self, segments: Sequence[Sums]) -> dict[str, Any]:
        """Figures of the whole that segments give."""
        found: dict[str, Any] = {}
        if "stress" in self.wanted:
            found["forces"] = asdict(supported(segments, self._bins, GRAVITY))
        if "mixing" in self.wanted and np.isfinite(index := whole_mixing(segments)):
            found["mixing_index"] = index
        return found


def with_derived(field: Field, wanted: Sequence[str]) -> tuple[Field, dict[str, Any]]:
    """The field with what follows from it alone, and figures of that.

    Times are those at DEM scale, as velocities are.
    """
    extra: Arrays = dict(field.extra)
    figures: dict[str, Any] = {}
    if "particle_velocity" in wanted and field.packing_fraction is not None:
        extra["particle_u"], extra["particle_w"] = particle_velocity(field)
    if "residence_time" in wanted:
        found = residence_time(field)
        extra |= {"residence_within": found.within, "residence_time": found.time * field.flow_scale}
        figures["residence_time_s"] = {f"P{p}": found.quantile(p / 100) for p in (10, 50, 90)}
        figures["residence_outside"] = found.outside
    if "age" in wanted:
        extra["age"] = age(field) * field.flow_scale
    if "strain_rate" in wanted and "shear_rate" not in extra:  # without particles solids move as the bulk does
        strain = strain_rate(field)
        extra |= dict(zip(COMPONENTS, strain, strict=True)) | {"shear_rate": shear_rate(strain)}
    return replace(field, extra=extra), figures


def particle_velocity(field: Field) -> tuple[Array, Array]:
    """(nz, nr) radial and vertical velocity v = F/φ of the solids in each cell at DEM scale [m/s]; 0 in voids."""
    assert field.packing_fraction is not None
    solids = field.packing_fraction * field.inside_fraction  # per whole cell, as the flux is
    moving = field.bulk & (solids > 0)

    def per_solids(flux: Array) -> Array:
        return np.divide(flux, solids, out=np.zeros_like(flux), where=moving)

    r, z = cell_vectors(field.flux_r, field.flux_z)
    return per_solids(r), per_solids(z)
