"""``flow.nc``: values on the nodes as NetCDF by the CF conventions, missing where no solids are.

NetCDF-3, the classic format, is read by every program that reads NetCDF.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.export.exported import Exported
from granpipe.field import Array

Attributes = Mapping[str, str | float]

_UNITS = {"m/s": "m s-1", "m^3/s": "m3 s-1", "m^2/s": "m2 s-1", "kg/m^3": "kg m-3", "1/s": "s-1", "m^2/s^2": "m2 s-2"}
"""Unit → as UDUNITS writes it."""

_ALWAYS = ("solids", "psi")
"""Known also where no solids are."""


def write_netcdf(exported: Exported, path: Path) -> None:
    """Write the dimensions z and r, every quantity on them, flow rate and reference density."""
    from scipy.io import netcdf_file

    nodes = exported.nodes
    across = nodes.measure.letter
    distance = "distance from the axis" if nodes.measure.axial else "width"
    with netcdf_file(path, "w", version=2) as file:
        file.Conventions = "CF-1.11"
        file.title = f"Flow of granular solids: {exported.name}"
        file.source = exported.head[0]
        file.comment = "; ".join(exported.head[1:3])
        axes: dict[str, tuple[Array, Attributes]] = {
            "z": (nodes.z, {"units": "m", "long_name": "height", "axis": "Z", "positive": "up"}),
            across: (nodes.r, {"units": "m", "long_name": distance}),
        }
        for name, (values, attributes) in axes.items():
            file.createDimension(name, len(values))
            _variable(file, name, (name,), values, attributes)
        for column in exported.columns:
            about: dict[str, str | float] = {
                "units": _UNITS.get(column.unit, column.unit),
                "long_name": column.description,
            }
            values = column.values
            if column.name not in _ALWAYS:
                values, about["_FillValue"] = np.where(nodes.solids, values, np.nan), np.nan
            _variable(file, column.name, ("z", across), values, about)
        for name, value, unit, meaning in (
            ("flow_rate", exported.flow_rate, "m^3/s", "flow rate of bulk that the velocities add up to"),
            ("reference_density", exported.reference_density, "kg/m^3", "times the bulk velocity it is the mass flux"),
        ):
            _variable(file, name, (), np.array(value), {"units": _UNITS[unit], "long_name": meaning})


def _variable(file: Any, name: str, dimensions: tuple[str, ...], values: Array, attributes: Attributes) -> None:
    variable = file.createVariable(name, "d", dimensions)
    variable[...] = values
    for key, value in attributes.items():
        setattr(variable, key, np.float64(value) if isinstance(value, float) else value)
