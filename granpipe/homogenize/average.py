"""Time averages: sums over the snapshots of one segment, and how segments are joined.

A run is a chain of segments of fixed plate travel. A `Collector` takes the snapshots as they come and gives one
`Sums` per segment, so that nothing but the last snapshot is held in memory. Two ways of sampling the flow:

- ``velocity``: each snapshot with the velocities that it holds;
- ``displacement``: each pair of snapshots, every particle (by id) along its straight path with velocity Δx/Δt. The
  flow is then the time integral between the snapshots and closes the balance with the change of the deposited volume,
  ΔV/Δt + ∇·flow = 0, also where the motion stops and starts between them.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array, Box, Grid, Mask, Particles, restored
from granpipe.homogenize.deposit import Deposit, deposit, deposit_paths, empty_deposit

Sampling = Literal["velocity", "displacement"]

FORMAT_VERSION = 1
_EXTRA = "extra_"  # begins the names of extra sums in a file


@dataclass(frozen=True)
class Sample:
    """What an `Extra` is shown: a snapshot, or particles half-way between two.

    Parameters
    ----------
    position, velocity, radius : (n, 3), (n, 3), (n,) [m, m/s]
    deposit : gives the deposit of some of the particles, as it goes into the sums
    """

    position: Array
    velocity: Array
    radius: Array
    deposit: Callable[[Mask | slice], Deposit]


class Extra(Protocol):
    """Something more to be summed, only where it is asked for."""

    def sample(self, sample: Sample) -> Mapping[str, Array]:
        """Values of one sample by name; always the same names and shapes."""


@dataclass(frozen=True)
class Sums:
    """Sums over the samples of one segment, or of several merged ones.

    Parameters
    ----------
    grid : the deposition grid
    sampling : ``velocity`` (a sample is a snapshot) or ``displacement`` (a sample is a pair of snapshots)
    start, stop : times of the first and last snapshot [s]
    duration : time between snapshots that the segment covers [s]; `stop` − `start` unless merged across gaps or runs
    weight : sum of the samples' weights: 1 for a snapshot, the time between them [s] for a pair
    volume : (nz, nr) Σ weight × solids volume [m³ · weight]
    flow_r, flow_z : (nz, nr+1), (nz+1, nr) Σ weight × solids flow [m³/s · weight]
    gain : (nz, nr) volume at the end less volume at the beginning of `duration` [m³]
    time : (n,) time of each sample [s], the middle of a pair
    level_flow : (n, nz+1) solids flow of each sample through every level, positive downwards [m³/s]
    solids : (n,) solids volume on the grid [m³]
    kinetic : (n,) kinetic energy of the particles with centres in the grid's z-range, over their density [m⁵/s²]
    count : (n,) number of these particles
    moments : (6, nz) Σ weight × V × (w, w cos θ, w sin θ, w cos 2θ, w sin 2θ, v_θ) of the particles with centres in
        each row, V their volume and θ their angle about the axis [m⁴/s · weight]; None in sums without
    run : which of several independent runs the segment is of
    flow_y : (nz, ny+1, nx) of a grid in space Σ weight × solids flow along y [m³/s · weight]; otherwise None
    extra : more sums by name, Σ weight × value, as `Extra` gives them
    """

    grid: Grid
    sampling: Sampling
    start: float
    stop: float
    duration: float
    weight: float
    volume: Array
    flow_r: Array
    flow_z: Array
    gain: Array
    time: Array
    level_flow: Array
    solids: Array
    kinetic: Array
    count: Array
    moments: Array | None = None
    run: int = 0
    flow_y: Array | None = None
    extra: Mapping[str, Array] = field(default_factory=dict)

    @property
    def mean_volume(self) -> Array:
        """(nz, nr) time-averaged solids in each cell [m³]."""
        return self.volume / self.weight

    @property
    def mean_flux(self) -> tuple[Array, Array]:
        """Time-averaged solids flux (nz, nr+1), (nz+1, nr) over the whole faces [m/s]; 0 on the axis."""
        area = self.grid.side_area
        flux_r = np.divide(self.flow_r, self.weight * area, out=np.zeros_like(self.flow_r), where=area > 0)
        return flux_r, self.flow_z / (self.weight * self.grid.ring_area)

    @property
    def mean_flux_y(self) -> Array | None:
        """(nz, ny+1, nx) time-averaged solids flux along y [m/s] of a grid in space."""
        if self.flow_y is None or not isinstance(self.grid, Box):
            return None
        return self.flow_y / (self.weight * self.grid.front_area)

    @property
    def storage(self) -> Array:
        """(nz, nr) rate at which solids gather in each cell [m³/s]; 0 where a single snapshot cannot tell."""
        return self.gain / self.duration if self.duration > 0 else np.zeros_like(self.gain)

    @property
    def row_gain(self) -> Array:
        """(nz,) volume that each row of cells has gained [m³]."""
        return np.asarray(self.gain.reshape(len(self.gain), -1).sum(axis=1))

    def save(self, path: Path) -> None:
        """Write as ``.npz``."""
        stored: dict[str, Any] = {
            f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("grid", "extra")
        }
        stored |= {_EXTRA + name: value for name, value in self.extra.items()}
        stored = {name: value for name, value in stored.items() if value is not None}
        stored |= {"format_version": FORMAT_VERSION} | self.grid.stored()
        with path.open("wb") as file:
            np.savez(file, **stored)

    @classmethod
    def load(cls, path: Path) -> Sums:
        """Read what `save` wrote.

        Raises
        ------
        DataError : the file is damaged, or of another version
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                stored = {name: data[name] for name in data.files}
            if int(stored.pop("format_version")) != FORMAT_VERSION:
                raise DataError(f"{path}: segment sums of another version of granpipe; run again")
            grid = restored(stored)
            extra = {name.removeprefix(_EXTRA): stored.pop(name) for name in list(stored) if name.startswith(_EXTRA)}
            values = {name: value.item() if value.ndim == 0 else value for name, value in stored.items()}
            return cls(grid=grid, extra=extra, **values)
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: not segment sums that granpipe wrote ({error})") from error


def merge(segments: Sequence[Sums]) -> Sums:
    """One `Sums` of several segments (or of runs), in the order of run and time; refuses other grids or sampling.

    Raises
    ------
    DataError : no segments, or segments of different grids or sampling
    """
    if not segments:
        raise DataError("no segments to average: none was sampled, or all lie before the start of the average")
    ordered = sorted(segments, key=lambda segment: (segment.run, segment.start))
    first = ordered[0]
    for segment in ordered[1:]:
        if segment.sampling != first.sampling:
            raise DataError(f"segments sampled by {first.sampling} and by {segment.sampling} do not merge")
        if not _same_grid(segment.grid, first.grid):
            raise DataError(
                f"segments on different grids do not merge: {_describe(first.grid)}; {_describe(segment.grid)}"
            )
    added = ["duration", "weight", "volume", "flow_r", "flow_z", "gain"]
    added += [name for name in ("moments", "flow_y") if all(getattr(segment, name) is not None for segment in ordered)]
    joined = ("time", "level_flow", "solids", "kinetic", "count")
    values = {name: sum(getattr(segment, name) for segment in ordered) for name in added}
    values |= {name: np.concatenate([getattr(segment, name) for segment in ordered]) for name in joined}
    return Sums(
        grid=first.grid,
        sampling=first.sampling,
        start=first.start,
        stop=max(p.stop for p in ordered),
        run=first.run,
        extra=_added_extras(ordered),
        **values,
    )


def _added_extras(segments: Sequence[Sums]) -> dict[str, Array]:
    """The extra sums of all segments together; refused where not all have the same ones."""
    names = set(segments[0].extra)
    if any(set(segment.extra) != names for segment in segments):
        raise DataError("segments with different extra sums do not merge")
    return {name: np.sum([segment.extra[name] for segment in segments], axis=0) for name in segments[0].extra}


def _same_grid(one: Grid, other: Grid) -> bool:
    mine, yours = one.stored(), other.stored()
    return mine.keys() == yours.keys() and all(np.array_equal(mine[name], yours[name]) for name in mine)


def _describe(grid: Grid) -> str:
    return f"{'×'.join(map(str, grid.shape))} cells of {grid.cell:g} m from z = {grid.z_edges[0]:g} m"


class Collector:
    """Takes the snapshots of a run in the order of time; gives the sums of the segment that they make.

    The last snapshot of a segment is where the next one begins, so that volume gained between the two is not missed.

    Parameters
    ----------
    grid : the deposition grid
    sampling : see `Sums`
    points : Gauss points over a cell's height
    jump : for ``displacement``: where particles leave and enter the field's neighbourhood, they are followed there
        with the velocities that they have in the one snapshot that holds them; so are those that travel farther than
        `jump` [m] and what three times their speeds explain: they left and came back elsewhere. None: they are not
        followed
    extras : what to sum beside volume and flow
    """

    def __init__(
        self,
        grid: Grid,
        sampling: Sampling = "velocity",
        points: int = 3,
        jump: float | None = None,
        extras: Sequence[Extra] = (),
    ) -> None:
        self.grid, self.sampling, self.extras = grid, sampling, extras
        self.points, self.jump = points, jump
        self.jumps = 0  # of particles, so far
        self._last: tuple[float, Particles] | None = None
        self._last_volume: Array | None = None
        self._begin()

    def _begin(self) -> None:
        """Empty the sums; the present last snapshot is the beginning of the segment."""
        self._first = self._last
        self._first_volume = self._last_volume
        self._sum = empty_deposit(self.grid)
        self._moments = None if isinstance(self.grid, Box) else np.zeros((6, self.grid.shape[0]))
        self._extra: dict[str, Array] = {}
        self._weight = 0.0
        self._series: list[tuple[float, Array, float, float, int]] = []

    def add(self, time: float, particles: Particles) -> None:
        """Take one snapshot, later than all before it.

        Raises
        ------
        DataError : the snapshot is not later than those before it
        """
        if self._last is not None and time <= self._last[0]:
            raise DataError(f"a snapshot at {time:g} s comes after one at {self._last[0]:g} s")
        volume = None
        if self.sampling == "velocity":
            volume = self._take(time, 1.0, self._at(particles)).volume
        elif self._last is not None:
            sample = self._between(self._last, (time, particles))
            self._take(0.5 * (self._last[0] + time), time - self._last[0], sample)
        self._last, self._last_volume = (time, particles), volume
        if self._first is None:
            self._first, self._first_volume = self._last, self._last_volume

    @property
    def _axes(self) -> list[int]:
        """Directions in which a way counts: a depth that nothing is cut by does not matter."""
        return [0, 2] if isinstance(self.grid, Box) and not self.grid.cut else [0, 1, 2]

    def observe(self, values: Mapping[str, Array]) -> None:
        """Add values that were not seen on the particles to the extra sums of the segment, without a weight."""
        for name, value in values.items():
            self._extra[name] = self._extra.get(name, 0.0) + value

    def _at(self, particles: Particles) -> Sample:
        position, velocity, radius = particles.position, particles.velocity, particles.radius
        return Sample(
            position,
            velocity,
            radius,
            lambda those: deposit(position[those], radius[those], velocity[those], self.grid, self.points),
        )

    def _between(self, before: tuple[float, Particles], after: tuple[float, Particles]) -> Sample:
        (then, old), (now, new) = before, after
        _, at_old, at_new = np.intersect1d(old.id, new.id, return_indices=True)
        start, radius, duration = old.position[at_old], new.radius[at_new], now - then
        path = self._shortest(new.position[at_new] - start)
        if self.jump is not None:
            speed = np.maximum(*(np.linalg.norm(v, axis=1) for v in (old.velocity[at_old], new.velocity[at_new])))
            went = ~jumped(path[:, self._axes], speed * duration, self.jump)
            self.jumps += int((~went).sum())
            leaves, enters = _others(len(old.id), at_old[went]), _others(len(new.id), at_new[went])
            out, into = old.velocity[leaves] * duration, new.velocity[enters] * duration
            start = np.concatenate([start[went], old.position[leaves], new.position[enters] - into])
            path = np.concatenate([path[went], out, into])
            radius = np.concatenate([radius[went], old.radius[leaves], new.radius[enters]])
        return Sample(
            start + 0.5 * path,
            path / duration,
            radius,
            lambda those: deposit_paths(start[those], path[those], radius[those], duration, self.grid, self.points),
        )

    def _shortest(self, path: Array) -> Array:
        """Paths (n, 3) that leave a slab through one end of its depth and come in at the other, made whole again."""
        if period := self.grid.period:
            path[:, 1] -= period * np.round(path[:, 1] / period)
        return path

    def _take(self, time: float, weight: float, sample: Sample) -> Deposit:
        """Add one sample to the sums and to the series."""
        deposited = sample.deposit(slice(None))
        for total, part in zip(self._sum, deposited, strict=True):
            total += weight * part
        for extra in self.extras:
            self.observe({name: weight * value for name, value in extra.sample(sample).items()})
        self._weight += weight
        z_edges, place = self.grid.z_edges, sample.position
        within = (place[:, 2] >= z_edges[0]) & (place[:, 2] < z_edges[-1])
        position, velocity, volume = place[within], sample.velocity[within], 4 / 3 * np.pi * sample.radius[within] ** 3
        if self._moments is not None:
            self._moments += weight * _row_moments(position, velocity, volume, self.grid)
        energy = 0.5 * volume @ (velocity**2).sum(axis=1)
        flow = -deposited.flow_z.reshape(len(z_edges), -1).sum(axis=1)
        self._series.append((time, flow, float(deposited.volume.sum()), float(energy), len(volume)))
        return deposited

    def take(self) -> Sums:
        """The sums of the segment so far; the next snapshot begins the next segment.

        Raises
        ------
        DataError : too few snapshots for a segment
        """
        if not self._series or self._first is None or self._last is None:
            raise DataError(f"too few snapshots for a segment sampled by {self.sampling}")
        time, level_flow, solids, kinetic, count = (
            np.array(values, dtype=float) for values in zip(*self._series, strict=True)
        )
        start_volume, stop_volume = (
            self._volume(self._first, self._first_volume),
            self._volume(self._last, self._last_volume),
        )
        sums = Sums(
            grid=self.grid,
            sampling=self.sampling,
            start=self._first[0],
            stop=self._last[0],
            duration=self._last[0] - self._first[0],
            weight=self._weight,
            volume=self._sum.volume,
            flow_r=self._sum.flow_r,
            flow_z=self._sum.flow_z,
            gain=stop_volume - start_volume,
            time=time,
            level_flow=level_flow,
            solids=solids,
            kinetic=kinetic,
            count=count,
            moments=self._moments,
            flow_y=self._sum.flow_y if self._sum.flow_y.size else None,
            extra=self._extra,
        )
        self._last_volume = stop_volume
        self._begin()
        return sums

    def _volume(self, snapshot: tuple[float, Particles], known: Array | None) -> Array:
        """(nz, nr) deposited volume of a snapshot, computed where it is not known yet."""
        if known is not None:
            return known
        particles = snapshot[1]
        position = particles.position
        return deposit(position, particles.radius, np.zeros_like(position), self.grid, self.points).volume


def jumped(path: Array, explained: Array, jump: float) -> Mask:
    """(n,) whether paths (n, k) are longer than a length [m] and three times what speeds explain (n,) [m]."""
    return np.asarray(np.linalg.norm(path, axis=1) > jump + 3 * explained)


def _others(count: int, chosen: NDArray[np.int64]) -> Mask:
    """(count,) those not among the chosen indices."""
    left = np.ones(count, dtype=bool)
    left[chosen] = False
    return left


def _row_moments(position: Array, velocity: Array, volume: Array, grid: Grid) -> Array:
    """(6, nz) see `Sums.moments`."""
    row = np.minimum(((position[:, 2] - grid.z_edges[0]) / grid.cell).astype(int), grid.shape[0] - 1)
    angle = np.arctan2(position[:, 1], position[:, 0])
    flow = volume * velocity[:, 2]
    spin = volume * (velocity[:, 1] * np.cos(angle) - velocity[:, 0] * np.sin(angle))
    waves = [f(m * angle) for m in (1, 2) for f in (np.cos, np.sin)]
    columns = [flow, *(flow * wave for wave in waves), spin]
    return np.array([np.bincount(row, column, grid.shape[0]) for column in columns])
