"""`homogenize.fields`: additional fields that a case requests, from the sums in production to arrays in the field."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.analysis.residence_time import residence_time
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.wall_contacts import read_wall_contacts
from granpipe.field import Array, Field, cell_vectors
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import CHORD_ERROR
from granpipe.geometry.wall_pieces import WallPieces
from granpipe.homogenize.average import Extra, Sums
from granpipe.homogenize.extras import (
    Arrays,
    SizeClassVolumes,
    WallSlip,
    size_class_arrays,
    wall_forces,
    wall_pressure_arrays,
    wall_slip_arrays,
)
from granpipe.planning.plan import Plan

PIECES_PER_DIAMETER = 1
"""Pieces of walls per Sauter diameter: particles touch a wall about this far apart."""

_SUMMED = ("size_classes", "wall_slip", "wall_pressure")


class ExtraSums:
    """What is collected from particles for a case beside volume and flow.

    Parameters
    ----------
    wanted : ``homogenize.fields`` of the case; what needs no sums is passed over
    outline : the vessel
    classes : sizes of the particles in the dumps
    """

    def __init__(self, wanted: Sequence[str], outline: Outline, classes: SizeClasses) -> None:
        self.wanted = tuple(name for name in _SUMMED if name in wanted)
        self.radii, self.diameter = classes.radius, classes.sauter_diameter
        self._pieces = WallPieces.of(outline, self.diameter / PIECES_PER_DIAMETER)

    @classmethod
    def of(cls, plan: Plan) -> ExtraSums:
        """What production collects."""
        return cls(plan.case.homogenize.fields, plan.outline, plan.dem.classes)

    @property
    def key(self) -> dict[str, Any]:
        """What the stored sums depend on; empty where nothing is asked for."""
        return {"extra": sorted(self.wanted), "edges": self._pieces.edges.tolist()} if self.wanted else {}

    @property
    def extras(self) -> list[Extra]:
        """What is summed over particles."""
        makers: dict[str, Callable[[], Extra]] = {
            "size_classes": lambda: SizeClassVolumes(self.radii),
            "wall_slip": lambda: WallSlip(self._pieces, CHORD_ERROR * self.diameter),
        }
        return [make() for name, make in makers.items() if name in self.wanted]

    def observed(self, work: Path, step: int) -> dict[str, Array]:
        """What LIGGGHTS has written of this step beside the snapshot; the file is deleted."""
        if "wall_pressure" not in self.wanted:
            return {}
        path = work / f"contacts.{step}.txt"
        values = wall_forces(self._pieces, *read_wall_contacts(path))
        path.unlink()
        return values

    def arrays(self, segments: Sequence[Sums], inside_fraction: Array) -> Arrays:
        """The arrays that segments give."""
        makers: dict[str, Callable[[], Arrays]] = {
            "size_classes": lambda: size_class_arrays(segments, self.radii, inside_fraction),
            "wall_slip": lambda: wall_slip_arrays(segments, self._pieces),
            "wall_pressure": lambda: wall_pressure_arrays(segments, self._pieces),
        }
        return {name: array for wanted in self.wanted for name, array in makers[wanted]().items()}


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
