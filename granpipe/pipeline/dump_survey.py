"""The first pass over dumps: extent and size of the particles, and whether they can be tracked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.field import Array, Mask
from granpipe.homogenize.average import jumped
from granpipe.pipeline.dump_window import Range, Request, window

JUMP = 3.0
"""Sauter diameters: a particle that travels farther between snapshots, beyond what its speed explains, came back."""

_LONGEST_TRAVEL = 1.0  # Sauter diameters between snapshots, for most particles: paths are taken as straight
_MOST = 0.9
_SAME_RADIUS = 0.01
_EDGE = 0.01  # quantile of the particles' places that stands for the edge of the bed
_LEAST_PARTICLES = 50  # that tell where an edge is


@dataclass
class Survey:
    """Figures of the snapshots that hold particles, in the directions of the field.

    times : of the snapshots [s]
    empty : steps of the snapshots without particles
    particles : most of them in a snapshot
    low, high : (3,) ends of the space that particles fill, within the box [m]
    reach : largest distance of a particle's surface from the axis [m]
    solids : in each snapshot [m³]
    solids_within : of this between the levels asked for [m³]
    outside : of the particles centred between these levels, what is centred outside the walls [m³]
    momentum : (3,) Σ volume × velocity over all snapshots [m⁴/s]
    momentum_size : Σ volume × speed [m⁴/s]
    edges : [x or y, lower or upper edge of the bed] in each snapshot [m]
    travel : how far 90 % of the particles at most travel between two snapshots [m]
    travelled, explained : Σ volume × path, and × mean velocity × time [m⁴], of the particles in two snapshots
    unfollowed : why particles cannot be followed from one snapshot to the next; empty if they can
    """

    times: list[float] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    particles: int = 0
    low: Array = field(default_factory=lambda: np.full(3, np.inf))
    high: Array = field(default_factory=lambda: np.full(3, -np.inf))
    reach: float = 0.0
    solids: list[float] = field(default_factory=list)
    solids_within: list[float] = field(default_factory=list)
    outside: list[float] = field(default_factory=list)
    momentum: Array = field(default_factory=lambda: np.zeros(3))
    momentum_size: float = 0.0
    edges: list[Array] = field(default_factory=list)
    travel: list[float] = field(default_factory=list)
    travelled: Array = field(default_factory=lambda: np.zeros(3))
    explained: Array = field(default_factory=lambda: np.zeros(3))
    unfollowed: str = ""
    has_velocities: bool = True
    surface: float = 0.0

    @property
    def diameter(self) -> float:
        """Sauter diameter of all particles in all snapshots [m]."""
        return 6 * sum(self.solids) / self.surface

    def mean(self, values: list[float]) -> float:
        """Mean of a value of every snapshot over time."""
        if len(self.times) < 2 or self.unfollowed:
            return float(np.mean(values))
        middle, step = 0.5 * (np.array(values)[1:] + np.array(values)[:-1]), np.diff(self.times)
        return float(middle @ step / step.sum())


def survey(request: Request, levels: Range | None = None, within: Callable[[Snapshot], Mask] | None = None) -> Survey:
    """Read the dumps once.

    Parameters
    ----------
    levels : bottom and top of the field [m], where they are known
    within : tells which particles (n,) are centred inside the walls of a vessel

    Raises
    ------
    DataError : no particles, particles that cannot be; or see `granpipe.pipeline.dump_window.window`
    """
    found = Survey()
    last: tuple[float, Snapshot] | None = None
    depth_matters = request.frame.plane != "xz" or request.frame.y is not None
    for time, snapshot in window(request):
        if not len(snapshot):
            found.empty.append(snapshot.step)
            continue
        _add_snapshot(found, time, snapshot, levels, within)
        if not found.unfollowed:
            found.unfollowed = _cannot_follow(last[1] if last else None, snapshot)
        if last is not None and not found.unfollowed:
            _add_pair(found, last, (time, snapshot), [0, 1, 2] if depth_matters else [0, 2])
        last = time, snapshot
    if not found.times:
        raise DataError("no particles in the snapshots between --start and --stop")
    found.unfollowed = found.unfollowed or _too_far(found)
    if found.unfollowed and not found.has_velocities:
        raise DataError(f"the dumps hold no velocities, and displacements cannot be taken: {found.unfollowed}")
    return found


def _add_snapshot(
    found: Survey, time: float, snapshot: Snapshot, levels: Range | None, within: Callable[[Snapshot], Mask] | None
) -> None:
    position, radius = snapshot.position, snapshot.radius
    volume = 4 / 3 * np.pi * radius**3
    found.times.append(time)
    found.particles = max(found.particles, len(snapshot))
    low, high = snapshot.box.T
    found.low = np.minimum(found.low, np.maximum((position - radius[:, None]).min(axis=0), low))
    found.high = np.maximum(found.high, np.minimum((position + radius[:, None]).max(axis=0), high))
    found.reach = max(found.reach, float((np.hypot(position[:, 0], position[:, 1]) + radius).max()))
    found.solids.append(float(volume.sum()))
    found.surface += float(4 * np.pi * (radius**2).sum())
    bottom, top = levels or (-np.inf, np.inf)
    found.solids_within.append(float(volume @ (_part_below(position[:, 2], radius, top)
                                               - _part_below(position[:, 2], radius, bottom))))  # fmt: skip
    if within is not None:
        between = (position[:, 2] > bottom) & (position[:, 2] < top)
        found.outside.append(float(volume[between & ~within(snapshot)].sum()))
    if len(snapshot) >= _LEAST_PARTICLES:
        found.edges.append(np.quantile(position[:, :2], [_EDGE, 1 - _EDGE], axis=0).T)
    if {"vx", "vy", "vz"} <= set(snapshot.columns):
        found.momentum += volume @ snapshot.velocity
        found.momentum_size += float(volume @ np.linalg.norm(snapshot.velocity, axis=1))
    else:
        found.has_velocities = False


def _part_below(z: Array, radius: Array, level: float) -> Array:
    """(n,) part of each sphere below a level: (2 + 3t − t³)/4, t the level's height over the centre in radii."""
    t = np.clip((level - z) / radius, -1, 1)
    return np.asarray(0.25 * (2 + 3 * t - t**3))


def _cannot_follow(old: Snapshot | None, new: Snapshot) -> str:
    if "id" not in new.columns:
        return "the particles have no ids"
    if len(np.unique(new.id)) != len(new):
        return f"ids occur twice at step {new.step}"
    if old is not None and not np.isin(old.id, new.id).any():
        return f"steps {old.step} and {new.step} have no particle in common"
    return ""


def _add_pair(found: Survey, before: tuple[float, Snapshot], after: tuple[float, Snapshot], axes: list[int]) -> None:
    (then, old), (now, new) = before, after
    _, at_old, at_new = np.intersect1d(old.id, new.id, return_indices=True)
    radius = new.radius[at_new]
    changed = np.abs(radius - old.radius[at_old]) > _SAME_RADIUS * radius
    if changed.any():
        one = int(np.argmax(changed))
        raise DataError(
            f"particle {new.id[at_new][one]} has a radius of {old.radius[at_old][one]:g} m at step {old.step} and of "
            f"{radius[one]:g} m at step {new.step}: particles that grow or shrink are not averaged"
        )
    path = new.position[at_new] - old.position[at_old]
    found.travel.append(float(np.quantile(np.linalg.norm(path[:, axes], axis=1), _MOST)))
    volume = radius**3
    if found.has_velocities:
        velocities = old.velocity[at_old], new.velocity[at_new]
        speed = np.maximum(*(np.linalg.norm(velocity, axis=1) for velocity in velocities))
        jump = JUMP * 2 * float(volume.sum() / (radius**2).sum())
        went = ~jumped(path[:, axes], speed * (now - then), jump)
        found.travelled += volume[went] @ path[went]
        found.explained += volume[went] @ (0.5 * (now - then) * (velocities[0] + velocities[1])[went])


def _too_far(found: Survey) -> str:
    """Why paths cannot be taken as straight, in the mean over pairs of snapshots: motion may come in bursts."""
    if len(found.times) < 2:
        return "there is only one"
    mean = float(np.mean(found.travel)) / found.diameter
    if mean <= _LONGEST_TRAVEL:
        return ""
    return (
        f"{_MOST:.0%} of the particles travel up to {mean:.2g} diameters between two of them, of which "
        f"{_LONGEST_TRAVEL:g} is the most; dump more often"
    )
