"""What a field says at a glance, in numbers: of the whole and of each section, at the flow rate of the process."""

from __future__ import annotations

from typing import Any

import numpy as np

from granpipe.analysis.surfaces import speed, stagnant_area, void_area
from granpipe.case.schema import Case
from granpipe.export.space import cell_fluxes
from granpipe.field import Field, section_rows


def field_summary(field: Field, case: Case | None) -> dict[str, Any]:
    """Key numbers of a field on rings or in a plane, as plain data in SI.

    Velocities are bulk velocities. The mean velocity of a section is flow rate over the area of its mean level, its
    largest that in the middle of a cell; areas are those in the r–z section, at rest below a fiftieth of the mean speed
    over the widest level.
    """
    flow, speeds = field.bulk_flow * field.flow_scale, np.where(field.bulk, speed(field), 0.0)
    area = field.inside_fraction @ field.grid.ring_area
    found: dict[str, Any] = {
        "flow_rate_m3_per_s": flow,
        "reference_packing": field.bulk_packing,
        "largest_speed_m_per_s": float(speeds.max()),
    }
    if not field.grid.measure.axial:
        found["depth_m"] = field.grid.measure.turn
        found["front_and_back_walls"] = field.grid.measure.walled
    if case is None:
        return found
    density = case.material.density * field.bulk_packing
    found |= {"reference_density_kg_per_m3": density, "mass_flow_kg_per_s": density * flow}
    levels = case.outline.levels
    rows = section_rows(field.grid, levels)
    found["sections"] = {
        name: {
            "z_m": [top, low],
            "mean_speed_m_per_s": flow / float(area[rows[name]].mean()),
            "largest_speed_m_per_s": float(speeds[rows[name]].max()),
            "at_rest_m2": stagnant_area(field, (low, top)),
            "void_m2": void_area(field, (low, top)),
        }
        for name, (top, low) in levels.items()
        if rows[name].any()
    }
    return found


def space_summary(field: Field, case: Case) -> dict[str, Any]:
    """Key numbers of a field in space, as plain data in SI."""
    flow, density = field.bulk_flow * field.flow_scale, case.material.density * field.bulk_packing
    speeds = np.sqrt(sum(one**2 for one in cell_fluxes(field))) * field.velocity_scale
    return {
        "flow_rate_m3_per_s": flow,
        "reference_packing": field.bulk_packing,
        "largest_speed_m_per_s": float(np.where(field.bulk, speeds, 0.0).max()),
        "reference_density_kg_per_m3": density,
        "mass_flow_kg_per_s": density * flow,
    }
