"""What stands in the cells of a field on request: units, words, and values at the flow rate of the process."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from granpipe.export.nodes import Nodes, corner_sum
from granpipe.field import FLOW_RATE_POWER, Array, Field, Measure


class Quantity(NamedTuple):
    """Unit and meaning."""

    unit: str
    meaning: str

    def meaning_in(self, measure: Measure) -> str:
        """The meaning where the plane stands for a body of revolution or for a slab."""
        return self.meaning if measure.axial else self.meaning.replace("Radial", "x").replace("Circumferential", "y")


QUANTITIES = {
    "pressure": Quantity("Pa", "Pressure in the solids"),
    "stress_rr": Quantity("Pa", "Radial normal stress"),
    "stress_tt": Quantity("Pa", "Circumferential normal stress"),
    "stress_zz": Quantity("Pa", "Vertical normal stress"),
    "stress_rz": Quantity("Pa", "Shear stress"),
    "shear_rate": Quantity("1/s", "Shear rate"),
    "strain_rr": Quantity("1/s", "Radial rate of strain"),
    "strain_tt": Quantity("1/s", "Circumferential rate of strain"),
    "strain_zz": Quantity("1/s", "Vertical rate of strain"),
    "strain_rz": Quantity("1/s", "Shear component of the rate of strain"),
    "granular_temperature": Quantity("m^2/s^2", "Granular temperature"),
    "coordination": Quantity("1", "Contacts per particle"),
    "mechanical_coordination": Quantity("1", "Contacts per particle that bears"),
    "rattlers": Quantity("1", "Part of the particles that bears nothing"),
    "mixing_index": Quantity("1", "Mixing index of the sizes"),
    "age": Quantity("s", "Time since the inlet"),
    "sensitivity": Quantity("m/s", "Change of the bulk velocity with wall friction and surface angle"),
}
"""Array in `Field.extra` → what it is."""


def at_process_scale(field: Field, name: str) -> Array:
    """An array of `Field.extra` at the flow rate of the process; slow flow, where fluctuations go with the flow."""
    power = FLOW_RATE_POWER.get(name.removesuffix("_se"), 0)
    return np.asarray(field.extra[name] * field.flow_scale**power)


def on_nodes(values: Array, nodes: Nodes) -> Array:
    """(nz+1, nr+1) means of the solid cells round each node that have a value; elsewhere in solids the nearest one's.

    0 away from the solids, and where no cell has a value.
    """
    known = np.isfinite(values) & nodes.cells
    if not known.any():
        return np.zeros(nodes.solids.shape)
    count = corner_sum(known.astype(float))
    mean = np.divide(corner_sum(np.where(known, values, 0.0)), count, out=np.zeros_like(count), where=count > 0)
    nearest = distance_transform_edt(count == 0, return_distances=False, return_indices=True)
    return np.where(nodes.solids, mean[tuple(nearest)], 0.0)
