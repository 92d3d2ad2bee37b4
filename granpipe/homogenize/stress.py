"""Stress from contacts: force times branch, spread along the branch, over the volume.

Goldhirsch, Granular Matter 12 (2010) 239; with walls Weinhart et al., Granular Matter 14 (2012) 289: the branch of a
contact between particles runs from centre to centre, that of a contact with a wall from the wall to the centre. The
stress so found balances weight and the support of walls exactly, whatever volume it is averaged over. Compression is
positive. The kinetic part −ρφ⟨v′v′⟩ is not in it; `Supported.agitation` bounds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.field import Array, Particles
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.extras import Arrays, Touching, measured_together
from granpipe.system.interrupts import uninterrupted

_COMPONENTS = ("stress_rr", "stress_tt", "stress_zz", "stress_rz")


def contact_stress(bins: Bins, pairs: Touching, walls: Touching, particles: Particles, density: float) -> Arrays:
    """One snapshot as values for `Collector.observe`.

    ``stress`` (5, bz, br) Σ ∫ f ⊗ l ds: rr, θθ, zz, rz, zr [N m], in a slab xx, yy, zz, xz, zx; ``stress_mass`` (2, bz)
    of the particles centred in each row of bins [kg], ``stress_support`` (2, bz) upward force of the walls that touch
    there [N], and both times the part of the row that lies below; ``stress_motion`` (1,) Σ m v² of all on the grid
    [N m]; ``stress_looks`` (1,) counts the snapshots.

    Parameters
    ----------
    pairs, walls : contacts between particles, each pair once, and with walls
    density : of the particles [kg/m³]
    """
    from granpipe.homogenize.stress_numba import add

    total = np.zeros((5, *bins.shape))
    with uninterrupted():
        for contacts in (pairs, walls):
            centre, end, force = map(np.ascontiguousarray, (contacts.centre, contacts.end, contacts.force))
            add(centre, end, force, bins.r_edges, bins.z_edges, bins.grid.measure.axial, total)
    position, mass = particles.position, density * 4 / 3 * np.pi * particles.radius**3
    motion = mass * (particles.velocity**2).sum(axis=1)
    within = bins.sums(np.zeros(len(mass)), position[:, 2], motion[None])
    return {
        "stress": total,
        "stress_mass": _by_rows(bins, position[:, 2], mass),
        "stress_support": _by_rows(bins, walls.end[:, 2], walls.force[:, 2]),
        "stress_motion": np.array([within.sum()]),
        "stress_looks": np.ones(1),
    }


def _by_rows(bins: Bins, z: Array, value: Array) -> Array:
    """(2, bz) sums over points at heights (n,) of values (n,), and of these times the part of the row below them."""
    row = np.searchsorted(bins.z_edges, z, side="right").clip(1, bins.shape[0]) - 1
    below = (z - bins.z_edges[row]) / np.diff(bins.z_edges)[row]
    return np.asarray(bins.sums(0 * z, z, np.array([value, value * below])).sum(axis=2))


def stress_arrays(segments: Sequence[Sums], bins: Bins, inside_fraction: Array) -> Arrays:
    """Stress components and pressure, their mean, in every cell with standard errors [Pa]; 0 outside the vessel.

    Per volume of the vessel, voids included. rz is the mean of the two shear components: contacts that turn particles
    make them differ within a few particles, not on average.

    Raises
    ------
    DataError : the segments hold no contacts
    """
    room = bins.window(bins.joined(inside_fraction * bins.grid.cell_volume))

    def components(sums: Sums) -> Array:
        rr, tt, zz, rz, zr = bins.window(sums.extra["stress"] / sums.extra["stress_looks"])
        of = np.array([rr, tt, zz, 0.5 * (rz + zr), (rr + tt + zz) / 3])
        known = np.broadcast_to(room > 0, of.shape)
        spread = bins.on_cells(np.divide(of, np.broadcast_to(room, of.shape), out=np.zeros_like(of), where=known))
        return spread * (inside_fraction > 0)

    return measured_together((*_COMPONENTS, "pressure"), segments, components)


@dataclass(frozen=True)
class Supported:
    """How well the forces balance between the lowest and the highest row of bins.

    imbalance : what neither contacts nor walls bear of the weight between them, over that weight
    by_walls : the part of that weight that walls and obstacles bear
    agitation : ρφ⟨v²⟩ over the trace of the stress, of all on the grid: the kinetic stress is less than that part
    """

    imbalance: float
    by_walls: float
    agitation: float


def supported(segments: Sequence[Sums], bins: Bins, gravity: float) -> Supported:
    """The balance of forces of an average.

    Through the levels of a row, h high, goes Σ f_z l_z / h in the mean. In it, particles in the lowest row count
    with the part of it that lies below them, those in the highest with the part that lies above.

    Raises
    ------
    DataError : the segments hold no contacts
    """
    sums = merge(segments)
    through = sums.extra["stress"][2].sum(axis=1) / np.diff(bins.z_edges)
    mass, support = (_between(sums.extra[name]) for name in ("stress_mass", "stress_support"))
    weight = gravity * mass
    trace = float(sums.extra["stress"][:3].sum())
    borne = through[0] - through[-1] + support
    if weight <= 0:
        return Supported(np.inf, 0.0, np.inf)
    motion = float(sums.extra["stress_motion"][0])
    return Supported(float(borne / weight - 1), support / weight, motion / trace if trace > 0 else np.inf)


def _between(rows: Array) -> float:
    """Of values by rows (2, bz), see `_by_rows`, what lies between the mean levels of the lowest and highest row."""
    whole, below = rows
    return float(whole[:-1].sum() - (whole - below)[0] + (whole - below)[-1])
