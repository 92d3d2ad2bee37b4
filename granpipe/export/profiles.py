"""Profiles of the velocity across a vessel, with error bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granpipe.errors import DataError
from granpipe.export.nodes import Nodes, nodal_errors, nodal_values
from granpipe.export.pictures import BLUE, DPI, RED, STYLE, Levels, readable_unit
from granpipe.field import Array, Field
from granpipe.system.surroundings import own_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PROFILES = 6
BAND = 1.96
"""Standard errors in half of a 95 % band."""


@dataclass(frozen=True)
class LevelProfile:
    """Bulk velocity across one level at the flow rate of the case, (n,) each; NaN outside the solids.

    Parameters
    ----------
    z : the level [m]
    r : distances from the axis; in the plane x–z, x [m]
    u, w : radial and vertical velocity [m/s]
    w_error : standard error of w [m/s]; None where the field has none
    section : in which the level lies
    """

    z: float
    r: Array
    u: Array
    w: Array
    w_error: Array | None
    section: str = ""


def level_profile(field: Field, z: float, section: str = "") -> LevelProfile:
    """The profile at a level, linear between the rows of nodes.

    Raises
    ------
    DataError : the level is outside the field
    """
    nodes, errors = nodal_values(field), nodal_errors(field)
    if not nodes.z[0] <= z <= nodes.z[-1]:
        raise DataError(
            f"z = {z:.6g} m is outside the field; choose a level from {nodes.z[0]:.6g} to {nodes.z[-1]:.6g} m"
        )
    return _profile(nodes, errors, z, section)


def section_profiles(field: Field, sections: Levels) -> list[LevelProfile]:
    """Profiles at mid-height of the sections, at most six, spread evenly over them; none without solids there."""
    nodes, errors = nodal_values(field), nodal_errors(field)
    found = [_profile(nodes, errors, 0.5 * (top + bottom), name) for name, (top, bottom) in sections.items()]
    found = [one for one in found if np.isfinite(one.w).any()]
    chosen = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_PROFILES)).round().astype(int))
    return [found[k] for k in chosen] if found else []


def profile_figures(profiles: Sequence[LevelProfile], folder: Path) -> list[Path]:
    """Draw each profile into a file of its own in an existing folder; return the files."""
    paths = [folder / f"profile_{one.section}.png" for one in profiles]
    with own_style(STYLE):
        for one, path in zip(profiles, paths, strict=True):
            profile_figure(one).savefig(path, dpi=DPI)
    return paths


def profile_figure(profile: LevelProfile) -> Figure:
    """Vertical and radial velocity over the radius, the former with its 95 % band."""
    from matplotlib.figure import Figure

    speeds = np.hypot(profile.u, profile.w)
    unit, factor = readable_unit(float(np.nanmax(speeds)) if np.isfinite(speeds).any() else 0.0)
    with own_style(STYLE):
        figure = Figure(figsize=(3.4, 2.7), layout="constrained")
        axes = figure.add_subplot()
        if profile.w_error is not None:
            low, high = (factor * (profile.w + sign * BAND * profile.w_error) for sign in (-1, 1))
            axes.fill_between(profile.r, low, high, color=BLUE, alpha=0.25, linewidth=0, label="w, 95 % band")
        axes.plot(profile.r, factor * profile.w, color=BLUE, label="w, vertical")
        axes.plot(profile.r, factor * profile.u, color=RED, linestyle="--", linewidth=1, label="u, radial")
        axes.axhline(0, color="#888888", linewidth=0.6)
        place = f"section {profile.section}, " if profile.section else ""
        axes.set_title(f"{place}z = {profile.z:.4g} m", fontsize=9, loc="left")
        axes.set(xlabel="r [m]", ylabel=f"bulk velocity [{unit}]", xlim=(profile.r[0], profile.r[-1]))
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=7.5, frameon=False)
    return figure


def _profile(nodes: Nodes, errors: Nodes | None, z: float, section: str) -> LevelProfile:
    row = int(np.clip(np.searchsorted(nodes.z, z, side="right") - 1, 0, len(nodes.z) - 2))
    part = (z - nodes.z[row]) / (nodes.z[row + 1] - nodes.z[row])
    cells = np.pad(nodes.cells[row], 1)
    solid = cells[1:] | cells[:-1]

    def across(values: Array) -> Array:
        return np.where(solid, (1 - part) * values[row] + part * values[row + 1], np.nan)

    error = None if errors is None else across(errors.bulk_w)
    return LevelProfile(z, nodes.r, across(nodes.bulk_u), across(nodes.bulk_w), error, section)
