"""What every program is given: columns of values on the nodes, and what stands at the head of each file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from granpipe import __version__
from granpipe.export.nodes import Nodes, corner_sum, nodal_errors, nodal_values
from granpipe.export.quantities import QUANTITIES, at_process_scale, on_nodes
from granpipe.field import Array, Field, Mask


@dataclass(frozen=True)
class Column:
    """One exported quantity: its name and unit, what it is, (nz+1, nr+1) values, a COMSOL grid file of its own."""

    name: str
    unit: str
    description: str
    values: Array
    grid_file: str = ""


@dataclass(frozen=True)
class Exported:
    """A field for other programs, at the flow rate of the case.

    Parameters
    ----------
    name : name of the case (plain ASCII, as the case file demands)
    solids_density : ρ_s [kg/m³]; ρ_s φ_ref times the bulk velocity is the true mass flux
    date : what the headers state
    """

    field: Field
    name: str
    solids_density: float
    date: datetime

    @cached_property
    def nodes(self) -> Nodes:
        """Values on the nodes."""
        return nodal_values(self.field)

    @cached_property
    def errors(self) -> Nodes | None:
        """Standard errors on the nodes; None where the field has none."""
        return nodal_errors(self.field)

    @property
    def columns(self) -> list[Column]:
        """What the field knows, on the nodes; 0 away from the solids."""
        return [*columns_of(self.nodes, self.errors), *self.requested]

    @cached_property
    def requested(self) -> list[Column]:
        """What the case asks for beside the flow, on the nodes, with standard errors where they are known."""
        return [
            Column(
                self.field.grid.name_of(name + end),
                of.unit,
                before + of.meaning_in(self.field.grid.measure),
                on_nodes(at_process_scale(self.field, name + end), self.nodes),
            )
            for name, of in QUANTITIES.items()
            for end, before in (("", ""), ("_se", "Standard error: "))
            if name + end in self.field.extra
        ]

    @cached_property
    def vessel(self) -> Mask:
        """(nz+1, nr+1) the nodes of all cells that lie in the vessel, at least in part."""
        return np.asarray(corner_sum(self.field.inside_fraction > 0) > 0)

    @property
    def flow_rate(self) -> float:
        """Flow rate of bulk that the velocities add up to [m³/s]."""
        return self.field.bulk_flow * self.field.flow_scale

    @property
    def reference_density(self) -> float:
        """ρ_ref = ρ_s φ_ref [kg/m³]."""
        return self.solids_density * self.field.bulk_packing

    @property
    def head(self) -> list[str]:
        """Lines for the head of a file."""
        walled = self.field.grid.measure.walled
        mean = ", mean over the depth between a front and a back wall," if walled else ""
        return [
            f"granpipe {__version__}, case {self.name}, {self.date:%Y-%m-%d %H:%M}",
            f"bulk velocity of the solids{mean} at the flow rate of the process: {self.flow_rate!r} m^3/s of bulk, "
            f"{self.flow_rate * self.reference_density!r} kg/s",
            f"reference density {self.reference_density!r} kg/m^3: times the bulk velocity it is the mass flux",
            "SI units; away from the solids every velocity is 0, and solids is 0",
        ]


def columns_of(nodes: Nodes, errors: Nodes | None = None) -> list[Column]:
    """What nodes hold beside r and z, with the standard errors where they are known."""
    solids = nodes.solids.astype(float)
    across = "Radial" if nodes.measure.axial else "Horizontal"
    columns = [
        Column("u_bulk", "m/s", f"{across} bulk velocity", nodes.bulk_u, "u_grid.txt"),
        Column("w_bulk", "m/s", "Vertical bulk velocity", nodes.bulk_w, "w_grid.txt"),
    ]
    if errors is not None:
        columns += [
            Column("u_bulk_se", "m/s", "Standard error of u_bulk", errors.bulk_u),
            Column("w_bulk_se", "m/s", "Standard error of w_bulk", errors.bulk_w),
        ]
    if nodes.particle_u is not None and nodes.particle_w is not None and nodes.packing is not None:
        columns += [
            Column("u_particle", "m/s", f"{across} particle velocity", nodes.particle_u),
            Column("w_particle", "m/s", "Vertical particle velocity", nodes.particle_w),
            Column("packing", "1", "Solids fraction", nodes.packing, "phi_grid.txt"),
        ]
    columns.append(Column("solids", "1", "Solids mask", solids))
    if nodes.psi is not None:
        unit, kind = ("m^3/s", "Stokes stream function") if nodes.measure.axial else ("m^2/s", "Stream function")
        columns.append(Column("psi", unit, kind, nodes.psi))
    return columns


def number(value: float) -> str:
    """The shortest text that reads back as the same number; 0 and whole numbers without .0"""
    return repr(value + 0.0).removesuffix(".0")


def numbers(values: Iterable[float], between: str = " ") -> str:
    """Numbers on one line."""
    return between.join(map(number, values))


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write ASCII with LF."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)
