"""Checks on the user's own dumps: what is refused, and what marks the field."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from granpipe.errors import DataError
from granpipe.field import Array, Box, Field
from granpipe.homogenize.average import Sums
from granpipe.pipeline.dump_survey import Survey
from granpipe.pipeline.dump_window import Frame
from granpipe.pipeline.gates import Gate, Limit

MOST_OUTSIDE = 0.01
"""Share of the solids between the vessel's levels that may be centred outside its walls."""

MOST_PACKING = 0.75
"""No spheres of nearly one size pack more densely than 0.74."""

_DUMPS = "dumps of others"

OFF_AXIS = Limit(
    "distance of the bed's middle from the axis, over half a diameter or 5 % of the bed's half width",
    _DUMPS,
    "Rings about another axis mix what flows with what does not. Refused where no axis is given.",
    high=1,
    remedy="--axis",
)
DIRECTION = Limit(
    "net motion sidewise or upwards, over all motion",
    _DUMPS,
    "Solids sink in a vessel: gravity is along another direction. Refused where none is given.",
    high=0.3,
    percent=True,
    remedy="--up",
)
TIME_RATIO = Limit(
    "displacement over velocity times the time between snapshots",
    _DUMPS,
    "A wrong time step gives wrong velocities. Snapshots of motion in bursts agree to a fifth; measured where the "
    "motion has a direction.",
    low=0.8,
    high=1.25,
    remedy="--time-step",
)
LACK = Limit(
    "share of the solids between the field's levels that the field lacks",
    _DUMPS,
    "What is in the dumps must be in the field. Particles that leave and enter are followed a little beyond where they "
    "do, and count there too. Not where ranges of x or y are given.",
    low=-0.05,
    high=0.01,
    percent=True,
)
DUMP_GATES = (OFF_AXIS, DIRECTION, TIME_RATIO, LACK)
"""Every gate of dumps that a user brings, in the order of the page; those of an average come on top."""

_WINDOW = 3.0  # Sauter diameters over which packing is averaged for the check
_OFF = (0.05, 0.5)  # of the bed's half width, and Sauter diameters


def frame_gates(found: Survey, frame: Frame) -> list[Gate]:
    """Whether the bed lies about the axis and sinks; refused unless the user says where axis and gravity are.

    Raises
    ------
    DataError : it does not, and neither ``--axis`` nor ``--up`` is given
    """
    if frame.plane != "rz":
        return []
    gates = []
    if found.momentum_size > 0:
        share = found.momentum / found.momentum_size
        name = "xyz"[int(np.argmax(np.abs(share)))]
        largest = float(share["xyz".index(name)])
        wrong = abs(largest) > DIRECTION.high and (name != "z" or largest > 0)
        if wrong and frame.up is None:
            raise DataError(
                f"the particles move along {'-' if largest < 0 else ''}{name}, not along -z: if gravity is along it, "
                f"give --up {'' if largest < 0 else '-'}{name}; if all is well, --up z"
            )
        gates.append(DIRECTION.gate(abs(largest) if wrong else 0.0))
    if found.edges:
        edges = np.mean(found.edges, axis=0)
        middle, half = edges.mean(axis=1), float(np.ptp(edges, axis=1).max()) / 2
        limit = max(_OFF[0] * half, _OFF[1] * found.diameter)
        off = float(np.hypot(*middle))
        if off > limit and frame.axis is None:
            raise DataError(
                f"the particles lie about x = {middle[0]:.3g} m, y = {middle[1]:.3g} m, not about x = y = 0: if "
                f"the axis of the vessel stands there, give --axis {middle[0]:.3g},{middle[1]:.3g}; if gravity is not "
                "along -z, --up; if it is no vessel of revolution, --plane xz or xyz; if all is well, --axis 0,0"
            )
        gates.append(OFF_AXIS.gate(off / limit))
    return gates


def check_outside(found: Survey, walls: str = "the case") -> float:
    """Share of the solids between the vessel's levels that is centred outside its walls.

    Parameters
    ----------
    walls : what gives them, in words

    Raises
    ------
    DataError : more than 1 %
    """
    total = sum(found.solids_within)
    if total <= 0:
        raise DataError(
            f"no particles between the top and the bottom of the walls of {walls}; they lie at z = "
            f"{found.low[2]:.3g} … {found.high[2]:.3g} m: are both in the same unit and place? (--up)"
        )
    share = sum(found.outside) / total
    if share > MOST_OUTSIDE:
        raise DataError(
            f"{share:.1%} of the solids lie outside the walls of {walls}, of which {MOST_OUTSIDE:.0%} are allowed: "
            "they are another vessel's or in another unit, or the axis (--axis) or gravity (--up) is elsewhere"
        )
    return share


def check_packing(sums: Sums, inside_fraction: Array, diameter: float) -> float:
    """Largest packing over three diameters.

    Raises
    ------
    DataError : denser than spheres pack
    """
    width = max(1, round(_WINDOW * diameter / sums.grid.cell))
    whole = np.broadcast_to(sums.grid.cell_volume, sums.grid.shape)
    solids, room, all_room = (
        ndimage.uniform_filter(array, width, mode="constant")
        for array in (sums.mean_volume, inside_fraction * whole, np.array(whole))
    )
    seen = np.divide(solids, room, out=np.zeros_like(room), where=room > 0.5 * all_room)
    densest = float(seen.max())
    if densest > MOST_PACKING:
        at = np.unravel_index(int(seen.argmax()), seen.shape)
        raise DataError(
            f"a packing of {densest:.3g} at {_place(sums, at)}, over {_WINDOW:g} diameters: spheres do not pack more "
            f"densely than {MOST_PACKING:g}; wrong radii, particles counted twice, or too soft ones"
        )
    return densest


def _place(sums: Sums, at: tuple[np.intp, ...]) -> str:
    grid = sums.grid
    sideways = "x" if isinstance(grid, Box) else "r"
    return f"{sideways} = {grid.r_centres[at[-1]]:.3g} m, z = {grid.z_centres[at[0]]:.3g} m"


def solids_gate(found: Survey, held: float, frame: Frame) -> list[Gate]:
    """Solids in the field [m³] against those in the dumps between its levels; of ranges of x or y the user's word."""
    if frame.x is not None or frame.y is not None:
        return []
    return [LACK.gate(1 - held / found.mean(found.solids_within))]


def time_gate(found: Survey) -> list[Gate]:
    """Displacements against velocities, where there is a clear direction: a wrong time step shows."""
    if found.unfollowed or np.linalg.norm(found.momentum) <= DIRECTION.high * found.momentum_size:
        return []
    along = found.momentum / np.linalg.norm(found.momentum)
    ratio = float(found.travelled @ along / (found.explained @ along))
    return [TIME_RATIO.gate(ratio)]


def held_solids(field: Field) -> float:
    """Solids in a field [m³]."""
    assert field.packing_fraction is not None
    return float((field.packing_fraction * field.inside_fraction * field.grid.cell_volume).sum())
