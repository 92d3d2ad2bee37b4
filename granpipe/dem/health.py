"""Is it still physics? What a running simulation must keep to, looked at while it runs.

LIGGGHTS goes on happily without most of its particles, with speeds that no fall can give, or below an arch that lets
nothing pass. Each check says what was seen, the limit, and which setting to change. The limits follow from the settings
and the geometry of the run; they are wide enough for what beds do: starting with a jerk, falling into a void, being
fed from above, flowing in bursts.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.filling import PACKING
from granpipe.dem.overlap import Overlap, measure_overlap
from granpipe.dem.run import Status
from granpipe.dem.settings import Settings
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import RunError
from granpipe.field import Array, Mask, Measure
from granpipe.progress import counted

FREE_SHARE = 0.5
"""Flow over the free discharge through an opening above which the plate may be too fast for the solids to follow."""

_Column = tuple[int, NDArray[np.int64], Array, Array]  # step, and of each particle: number, centre, volume

OVERLAP_MARGIN = 2.0
"""Overlap of touching particles over the limits that the settings aim at, at most."""

COLLISION_SHARE = 0.2
"""Time step over the duration of the fastest collision, at most: five steps see it."""

PEAK_ENERGY = 5.0
"""Kinetic energy over what flow and falls can give, at most, at any time; 0.07 to 1.1 were seen."""

MEAN_ENERGY = 2.0
"""The same for its mean over a diameter of plate travel; up to 0.12 was seen, where a tall column sticks and slips."""

PEAK_SPEED = 1.5
"""Speed of the fastest particle over that of a free fall through everything, at most."""

ARCH_TRAVEL = 5.0
"""Travel in an opening [Sauter diameters], at the mean speed there, over which nothing may fail to pass it."""

ARCH_FLOW = 0.05
"""Flow over the imposed one below which an opening counts as blocked; over 5 diameters of travel in it at least 0.8 was
seen, over 2 at least 0.6, in openings from 7.5 diameters on."""

DILATION = 0.1
"""Plate travel over the height above it until the motion has surely arrived there; 0.04 was measured."""


class ArchError(RunError):
    """Hardly anything passes an opening any more.

    Parameters
    ----------
    seen : what was measured
    remedy : why, and what to do
    z : height of the opening [m]
    """

    def __init__(self, seen: str, remedy: str, z: float) -> None:
        super().__init__(f"{seen}: {remedy}")
        self.seen, self.remedy, self.z = seen, remedy, z


@dataclass(frozen=True)
class FlowLimits:
    """What the vessel is to the particles in it.

    Parameters
    ----------
    measure : what r is; None in space
    inside : centres (n, 3) [m] → which of them the walls and obstacles allow
    levels : name → height [m] of every opening that all must pass
    areas : name → free area of the vessel at it [m²], at most that of the outlet
    loads : name → imposed flow over the free discharge through it
    flow : solids that the plate lets through, or free discharge [m³/s]
    speed : of the plate, or of the free discharge through the outlet [m/s]
    flow_energy : kinetic energy of a bed that flows at twice the mean speed everywhere [J/kg]
    elastic_energy : that the bed holds at most [J/kg], and sets free when it sticks and slips
    fall : greatest height of free fall that the flow may take [m]; 0 where it sinks with the plate all the way
    brink : area of the opening that it falls from [m²]
    shares : name → part of the flow that passes it, where there are several outlets
    left_by : centres (n, 3) [m] → number of the outlet, in the order of `levels`, beyond which each of them lies, or
        −1; None where all pass every opening
    """

    measure: Measure | None
    inside: Callable[[Array], Mask]
    levels: Mapping[str, float]
    areas: Mapping[str, float]
    loads: Mapping[str, float]
    flow: float
    speed: float
    flow_energy: float
    elastic_energy: float
    fall: float
    brink: float
    shares: Mapping[str, float] = field(default_factory=dict)
    left_by: Callable[[Array], NDArray[np.int64]] | None = None

    def at_pace(self, pace: float) -> FlowLimits:
        """The same where everything flows so many times faster."""
        return replace(
            self,
            loads={name: pace * load for name, load in self.loads.items()},
            flow=pace * self.flow,
            speed=pace * self.speed,
            flow_energy=pace**2 * self.flow_energy,
        )


def check_balance(before: int, status: Status, fallen: int = 0) -> None:
    """RunError unless particles present before, inserted and discharged since make those present now.

    `fallen` of those present before may be gone unseen: they had passed the catcher, which has counted them, but were
    not taken out yet when the restart file was written; LIGGGHTS forgets that it has to.
    """
    missing = before + status.inserted - status.discharged - status.particles
    if not 0 <= missing <= fallen:
        raise RunError(
            f"step {status.step}: the particle balance does not close: {before} present before + {status.inserted} "
            f"inserted − {status.discharged} discharged ≠ {status.particles} present; particles were lost: a smaller "
            "dem.time_step, or a larger contact.youngs_modulus, keeps them inside the walls"
        )


class FillingHealth:
    """Health while a vessel is filled: particles fall, but not from higher than the feed.

    Parameters
    ----------
    placed : particles at the start
    """

    def __init__(self, settings: Settings, case: Case, placed: int) -> None:
        self.placed = placed
        self.mass = settings.classes.mean_mass(case.material.density)
        self.limit = _fall_energy(settings)

    def row(self, status: Status) -> None:
        """Check a row of the thermo table.

        Raises
        ------
        RunError : particles were lost, or move faster than they can
        """
        check_balance(self.placed, status)
        _check_energy(status, self.mass, self.limit, _FALL)


class FlowHealth:
    """Health of a flowing bed.

    Parameters
    ----------
    present : particles at the start
    fallen : those of them that have passed an open outlet's catcher already
    """

    def __init__(self, settings: Settings, case: Case, vessel: FlowLimits, present: int, fallen: int = 0) -> None:
        self.settings, self.case, self.vessel = settings, case, vessel
        self.present, self.fallen = present, fallen
        self.mass = settings.classes.mean_mass(case.material.density)
        density, bed = case.material.density * settings.classes.mass_factor, present * self.mass
        self.energy = _mean_energy(vessel, density, bed)
        self.start_energy = _mean_energy(vessel.at_pace(settings.pace), density, bed)
        # what the bed has from a faster start may last as long as a fall through all of it
        fall = math.ceil(_fall_time(settings.wall_top - settings.lowest) / settings.time_step)
        self.calm_from = settings.start_steps + (fall if settings.start_steps > 0 else 0)
        self.falls_until = fall if settings.fall_steps > 0 else 0  # the bed was not at rest
        self.burst = _burst_energy(settings, vessel, density, bed)
        self.fed = _Fed(settings)
        self.drift = _Mean(round(settings.classes.sauter_diameter / (vessel.speed * settings.time_step)))
        self.passing = _Passing(settings, vessel)

    def row(self, status: Status) -> None:
        """Check a row of the thermo table: particle balance and kinetic energy.

        Raises
        ------
        RunError : particles were lost, or move faster than they can
        """
        check_balance(self.present, status, self.fallen)
        fed = self.fed.energy(status)
        if status.step < self.falls_until:
            _check_energy(status, self.mass, _fall_energy(self.settings), _FALL)
            return
        energy = self.energy if status.step >= self.calm_from else self.start_energy
        specific = _check_energy(status, self.mass, PEAK_ENERGY * energy + self.burst + fed, "flow and falls")
        if status.step < self.calm_from:
            return
        mean = self.drift.add(status.step, specific - fed)
        limit = MEAN_ENERGY * self.energy
        if mean > limit:
            raise RunError(
                f"step {status.step}: over the last diameter of plate travel the kinetic energy was {mean:.3g} J/kg on "
                f"average; flow and falls give {limit:.3g} J/kg at the most: the bed heats up; {_CALMER}"
            )

    def snapshot(self, snapshot: Snapshot) -> None:
        """Check where the particles of a snapshot are and how fast.

        Raises
        ------
        RunError : particles are outside the walls or too fast
        ArchError : an arch holds them up
        """
        self._check_place(snapshot)
        self._check_speed(snapshot)
        self.passing.add(snapshot)

    def closely(self, snapshot: Snapshot) -> Overlap:
        """The dearer check, for now and then: how far the particles overlap.

        Raises
        ------
        RunError : the particles overlap too far
        """
        overlap = measure_overlap(snapshot.position, snapshot.radius)
        for name, value, limit in (
            ("mean", overlap.mean, OVERLAP_MARGIN * contact.MEAN_OVERLAP),
            ("99th percentile", overlap.p99, OVERLAP_MARGIN * contact.P99_OVERLAP),
        ):
            if value > limit:
                raise RunError(
                    f"step {snapshot.step}: the particles overlap by {value:.1%} of a diameter ({name} of "
                    f"{overlap.contacts} contacts), {limit:.0%} at the most: they are too soft for this bed; give a "
                    f"larger contact.youngs_modulus than {self.settings.youngs_modulus:.3g} Pa, or auto"
                )
        return overlap

    def _check_place(self, snapshot: Snapshot) -> None:
        settings = self.settings
        z = snapshot.position[:, 2]
        below = z < (settings.lowest if settings.open_outlet else settings.plate_level(snapshot.step))
        if self.vessel.left_by is not None:
            below |= (
                z < np.append(settings.plate_levels(snapshot.step), -np.inf)[self.vessel.left_by(snapshot.position)]
            )
        gone = below & settings.open_outlet  # on its way out of the box
        outside = np.flatnonzero((~self.vessel.inside(snapshot.position) | below | (z > settings.wall_top)) & ~gone)
        if len(outside):
            one = outside[0]
            raise RunError(
                f"step {snapshot.step}: {counted(len(outside), 'particle')} outside the walls, none may be; one "
                f"(radius {snapshot.radius[one]:.3g} m) at {self._place(snapshot.position[one])}: they were pressed "
                "or shot through; a larger contact.youngs_modulus or a smaller dem.time_step holds them"
            )

    def _place(self, position: Array) -> str:
        x, y, z = position.tolist()
        measure = self.vessel.measure
        across = f"x = {x:.4g} m, y = {y:.4g} m"
        if measure is not None and not measure.walled:
            across = f"{measure.letter} = {measure.across(position[0], position[1]):.4g} m"
        return f"{across}, z = {z:.4g} m"

    def _check_speed(self, snapshot: Snapshot) -> None:
        settings, parts = self.settings, self.case.contact
        speed = float(np.linalg.norm(snapshot.velocity, axis=1).max(initial=0.0))
        fall = math.hypot(math.sqrt(2 * contact.GRAVITY * (settings.wall_top - settings.lowest)), settings.feed_speed)
        if speed > PEAK_SPEED * fall:
            raise RunError(
                f"step {snapshot.step}: a particle moves at {speed:.3g} m/s; a free fall of the feed through the whole "
                f"vessel ends at {fall:.3g} m/s: the contacts are unstable; {_CALMER}"
            )
        if speed * settings.time_step > settings.skin / 2:
            raise RunError(
                f"step {snapshot.step}: a particle travels {speed * settings.time_step:.3g} m in a time step, half the "
                f"neighbour skin is {settings.skin / 2:.3g} m: contacts are seen too late; make dem.time_step smaller"
            )
        if parts.model != "hertz" or not speed:
            return
        density = settings.classes.smallest_density(self.case.material.density)
        collision = contact.hertz_time(
            settings.classes.smallest, density, settings.youngs_modulus, parts.poisson, speed
        )
        if settings.time_step > COLLISION_SHARE * collision:
            raise RunError(
                f"step {snapshot.step}: at {speed:.3g} m/s a collision lasts {collision:.3g} s, the time step is "
                f"{settings.time_step / collision:.0%} of that, {COLLISION_SHARE:.0%} at the most: make dem.time_step "
                "smaller"
            )


_CALMER = "make dem.time_step smaller, or leave it at auto"
_FALL = "a fall through the whole vessel"


def _check_energy(status: Status, particle_mass: float, limit: float, source: str) -> float:
    """Kinetic energy by mass [J/kg]; RunError if it is above the limit, or no number."""
    specific = status.kinetic_energy / (max(1, status.particles) * particle_mass)
    if not specific <= limit:
        raise RunError(
            f"step {status.step}: the particles' kinetic energy is {specific:.3g} J/kg; {source} can give {limit:.3g} "
            f"J/kg at the most: the contacts are unstable; {_CALMER}"
        )
    return specific


def _fall_energy(settings: Settings) -> float:
    """Most kinetic energy by mass [J/kg] of a bed that falls into place."""
    return contact.GRAVITY * (settings.wall_top - settings.lowest)


def _mean_energy(vessel: FlowLimits, density: float, mass: float) -> float:
    """Most kinetic energy by mass [J/kg] that flow, falls, sticking and slipping can give on average.

    A stream of mass flow Φ that falls freely from height h for t = √(2h/g) holds Φ ∫ ½ g²t² dt = Φ g² t³/6 at a time.
    """
    stream = density * vessel.flow * contact.GRAVITY**2 * _fall_time(vessel.fall) ** 3 / 6
    return vessel.flow_energy + vessel.elastic_energy + stream / mass


def _burst_energy(settings: Settings, vessel: FlowLimits, density: float, mass: float) -> float:
    """Kinetic energy by mass [J/kg] of a layer, one diameter thick, that breaks off at an opening and falls."""
    layer = density * PACKING * vessel.brink * settings.classes.sauter_diameter
    return layer * contact.GRAVITY * vessel.fall / mass


def _fall_time(height: float) -> float:
    return math.sqrt(2 * height / contact.GRAVITY)


class _Fed:
    """Energy that particles bring along which are fed above the bed: they come in lots, and fall onto it."""

    def __init__(self, settings: Settings) -> None:
        height = settings.feed_top - settings.feed_bottom
        self.each = 0.5 * settings.feed_speed**2 + contact.GRAVITY * height  # [J/kg]
        self.steps = _fall_time(height) / settings.time_step
        self.inserted: deque[tuple[int, int]] = deque([(-1, 0)])

    def energy(self, status: Status) -> float:
        """By mass of all particles [J/kg], of what may still be falling."""
        self.inserted.append((status.step, status.inserted))
        while self.inserted[1][0] < status.step - self.steps:
            self.inserted.popleft()
        return self.each * (status.inserted - self.inserted[0][1]) / max(1, status.particles)


class _Mean:
    """Mean of the latest values over a number of steps; 0 until there are that many."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.values: deque[tuple[int, float]] = deque()

    def add(self, step: int, value: float) -> float:
        self.values.append((step, value))
        if step - self.values[0][0] < self.steps:
            return 0.0
        while step - self.values[1][0] >= self.steps:
            self.values.popleft()
        return sum(value for _, value in self.values) / len(self.values)


class _Passing:
    """Solids that pass every opening while the plate sinks; ArchError where an arch holds them up."""

    def __init__(self, settings: Settings, vessel: FlowLimits) -> None:
        self.settings, self.vessel, self.names = settings, vessel, list(vessel.levels)
        self.levels = np.array(list(vessel.levels.values()))
        areas = np.array([vessel.areas[name] for name in self.names])
        self.shares = np.array([vessel.shares.get(name, 1.0) for name in self.names])
        # plate travel [m] by which the solids should have gone down by ARCH_TRAVEL diameters in each opening
        travel = ARCH_TRAVEL * settings.classes.sauter_diameter * PACKING * vessel.speed / vessel.flow
        self.windows = travel * areas / self.shares
        above = self.levels - settings.plate_z - np.array(settings.rises)
        self.moves_from = DILATION * np.maximum(0.0, above)  # plate travel [m]
        self.last: _Column | None = None
        self.passed: deque[tuple[float, Array]] = deque()  # between two snapshots: plate travel; the same while solids
        # move at each level, and the volume through it

    def add(self, snapshot: Snapshot) -> None:
        now = (snapshot.step, snapshot.id, snapshot.position.copy(), 4 / 3 * math.pi * snapshot.radius**3)
        before, self.last = self.last, now
        if before is None:
            return
        travelled, until_now = (self.vessel.speed * self.settings.paced(step) for step in (before[0], now[0]))
        travel, moving = until_now - travelled, travelled >= self.moves_from
        self.passed.append((travel, np.array([travel * moving, self._between(before, now) * moving])))
        while sum(t for t, _ in self.passed) - self.passed[0][0] >= self.windows.max():
            self.passed.popleft()
        self._check(snapshot.step)

    def _between(self, before: _Column, now: _Column) -> Array:
        """(levels,) volume that went down through each level, less what went up [m³]."""
        _, i, j = np.intersect1d(before[1], now[1], assume_unique=True, return_indices=True)
        if self.vessel.left_by is not None:  # with plates nothing is gone
            outlets = np.arange(len(self.levels))[:, None]
            left, left_before = (self.vessel.left_by(one) == outlets for one in (now[2][j], before[2][i]))
            return np.asarray((left.astype(float) - left_before) @ before[3][i])
        after = np.full(len(before[1]), -np.inf)  # what is gone went down, through the outlet
        after[i] = now[2][j, 2]
        above, still_above = before[2][:, 2] > self.levels[:, None], after > self.levels[:, None]
        return np.asarray((above.astype(float) - still_above) @ before[3])

    def _check(self, step: int) -> None:
        latest_first = np.array([each for _, each in reversed(self.passed)])
        travel, volume = np.cumsum(latest_first, axis=0).swapaxes(0, 1)  # (snapshots, levels)
        for one in np.flatnonzero(travel[-1] >= self.windows):
            enough = int((travel[:, one] >= self.windows[one]).argmax())
            imposed = self.shares[one] * self.vessel.flow / self.vessel.speed * travel[enough, one]
            if volume[enough, one] < ARCH_FLOW * imposed:
                seen = (
                    f"step {step}: over the last {travel[enough, one]:.3g} m of plate travel "
                    f"{volume[enough, one] / imposed:.1%} of the imposed flow has passed the {self.names[one]}, at "
                    f"least {ARCH_FLOW:.0%} must"
                )
                raise ArchError(seen, self._remedy(self.names[one], step), float(self.levels[one]))

    def _remedy(self, name: str, step: int) -> str:
        smaller = "smaller particles (material.size, dem.coarse_grain_factor), or a wider opening"
        starting = step <= self.settings.start_steps
        vessel = self.vessel.at_pace(self.settings.pace) if starting else self.vessel
        if (load := vessel.loads[name]) > FREE_SHARE:
            return (
                f"the plate takes {load:.0%} of the free discharge there: it is too fast, or an arch holds the solids "
                f"up; use a smaller dem.{'start_speed' if starting else 'plate_speed'}, {smaller}"
            )
        return f"an arch holds the solids up; use {smaller}"
