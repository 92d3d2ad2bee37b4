"""Additional fields that a case may request: extra sums over the samples, and the arrays made from them.

Fields that are not requested are neither computed nor written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array, Mask, Measure
from granpipe.homogenize.assemble import packing_fraction
from granpipe.homogenize.average import Sample, Sums, merge
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, standard_error

Arrays = dict[str, NDArray[Any]]


class Surface(Protocol):
    """Pieces of walls in the (r, z) plane."""

    def __len__(self) -> int: ...

    def nearest(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Nearest piece (n,) of each point (n, 2) and the distance to it (n,) [m]."""

    @property
    def labels(self) -> NDArray[np.str_]:
        """(m,) name of the surface that each piece is of."""

    @property
    def ends(self) -> Array:
        """(m, 2, 2) [piece, end, (r, z)] [m]."""

    @property
    def tangent(self) -> Array:
        """(m, 2) unit vectors (r, z) along the pieces."""

    @property
    def normal(self) -> Array:
        """(m, 2) unit normals (r, z) into the solid."""

    @property
    def measure(self) -> Measure:
        """What their plane stands for."""

    @property
    def area(self) -> Array:
        """(m,) area that each piece stands for [m²]."""


class Touching(Protocol):
    """Contacts, each once: (n, 3) forces [N] on particles with centres (n, 3), from what is at (n, 3) ends [m]."""

    @property
    def centre(self) -> Array: ...

    @property
    def end(self) -> Array: ...

    @property
    def force(self) -> Array: ...


class SizeClassVolumes:
    """Sums the solids of each size class: ``class_volume`` (classes, nz, nr).

    Parameters
    ----------
    radii : (classes,) [m]; a particle belongs to the nearest
    """

    def __init__(self, radii: Array) -> None:
        self.radii = radii

    def sample(self, sample: Sample) -> Mapping[str, Array]:
        """Deposit every class by itself; together they are the whole deposit."""
        member = np.abs(sample.radius[:, None] - self.radii).argmin(axis=1)
        return {"class_volume": np.array([sample.deposit(member == k).volume for k in range(len(self.radii))])}


class WallSlip:
    """Sums the particles that touch a wall, piece by piece, by their cross-section a = π r².

    ``wall_shadow`` (m,) Σ a and ``wall_slide`` (m,) Σ a v_t, v_t their velocity along the wall.

    Parameters
    ----------
    surface : the pieces
    reach : particles touch whose surface is nearer than this [m]: the facets of a wall lie so far from the true one
    """

    def __init__(self, surface: Surface, reach: float) -> None:
        self.surface, self.reach = surface, reach

    def sample(self, sample: Sample) -> Mapping[str, Array]:
        """Of all particles, at their places."""
        x, y, z = sample.position.T
        measure = self.surface.measure
        piece, distance = self.surface.nearest(np.column_stack([measure.across(x, y), z]))
        touching = (distance < sample.radius + self.reach) & _beside(self.surface, z)
        outward, _, upward = measure.components(sample.position, sample.velocity)
        along = (np.column_stack([outward, upward]) * self.surface.tangent[piece]).sum(axis=1)
        at, shadow = piece[touching], np.pi * sample.radius[touching] ** 2
        count = len(self.surface)
        return {
            "wall_shadow": _per_piece(at, shadow, count),
            "wall_slide": _per_piece(at, shadow * along[touching], count),
        }


def wall_forces(surface: Surface, point: Array, force: Array) -> dict[str, Array]:
    """Contacts with walls in one snapshot as values for `Collector.observe`.

    ``wall_force`` (m,) is the force that presses on each piece [N], ``wall_looks`` (1,) counts the snapshots.

    Parameters
    ----------
    point : (n, 3) contact points [m]
    force : (n, 3) forces on the particles [N]
    """
    beside = _beside(surface, point[:, 2])  # not above the inlet, nor on the plate below the outlet
    point, force = point[beside], force[beside]
    measure = surface.measure
    piece, _ = surface.nearest(np.column_stack([measure.across(point[:, 0], point[:, 1]), point[:, 2]]))
    outward, _, upward = measure.components(point, force)
    pressing = -(np.column_stack([outward, upward]) * surface.normal[piece]).sum(axis=1)
    return {"wall_force": _per_piece(piece, pressing, len(surface)), "wall_looks": np.ones(1)}


def _beside(surface: Surface, z: Array) -> Mask:
    """(n,) whether heights lie between the lower and upper end of all pieces."""
    heights = surface.ends[:, :, 1]
    return np.asarray((z >= heights.min()) & (z <= heights.max()))


def _per_piece(piece: NDArray[np.int64], value: Array, count: int) -> Array:
    return np.bincount(piece, value, count).astype(float)


def size_class_arrays(segments: Sequence[Sums], radii: Array, inside_fraction: Array) -> Arrays:
    """Packing of every class and Sauter diameter, Σ V / Σ (V/d), in every cell; 0 where nothing ever is.

    Raises
    ------
    DataError : the segments do not merge
    """
    sums = merge(segments)
    volume, diameter = sums.extra["class_volume"] / sums.weight, 2 * radii
    per_diameter = np.tensordot(1 / diameter, volume, axes=1)
    total = volume.sum(axis=0)
    sauter = np.divide(total, per_diameter, out=np.zeros_like(total), where=per_diameter > 0)
    room = packing_fraction(total, inside_fraction, sums.grid)
    share = np.divide(volume, total, out=np.zeros_like(volume), where=total > 0)
    return {"class_diameter": diameter, "class_packing": share * room, "sauter_diameter": sauter}


def wall_slip_arrays(segments: Sequence[Sums], surface: Surface) -> Arrays:
    """Mean velocity along each piece of the particles that touch it, and the part of it that lies behind them.

    Raises
    ------
    DataError : the segments hold no slip along walls
    """

    def contact(sums: Sums) -> Array:
        return sums.extra["wall_shadow"] / (sums.weight * surface.area)

    def slip(sums: Sums) -> Array:
        return _ratio(sums.extra["wall_slide"], sums.extra["wall_shadow"])

    return _places(surface) | measured("wall_contact", segments, contact) | measured("wall_slip", segments, slip)


def wall_pressure_arrays(segments: Sequence[Sums], surface: Surface) -> Arrays:
    """Mean pressure on each piece [Pa].

    Raises
    ------
    DataError : the segments hold no contacts with walls
    """

    def pressure(sums: Sums) -> Array:
        return sums.extra["wall_force"] / (sums.extra["wall_looks"] * surface.area)

    return _places(surface) | measured("wall_pressure", segments, pressure)


def _places(surface: Surface) -> Arrays:
    return {"wall_surface": surface.labels, "wall_ends": surface.ends}


def measured(name: str, segments: Sequence[Sums], measure: Callable[[Sums], Array]) -> Arrays:
    """A mean over all segments, and its standard error from blocks of them where there are enough."""
    found: Arrays = {name: measure(merge(segments))}
    if len(segments) >= LEAST_BLOCKS:
        found[f"{name}_se"] = standard_error(np.array([measure(block) for block in blocks(segments)]))
    return found


def measured_together(names: Sequence[str], segments: Sequence[Sums], measure: Callable[[Sums], Array]) -> Arrays:
    """The same of several quantities that are measured at once, as an array (names, …)."""
    found = measured("all", segments, measure)
    return {
        name + end: array
        for end in ("", "_se")
        if f"all{end}" in found
        for name, array in zip(names, found[f"all{end}"], strict=True)
    }


def _ratio(top: Array, bottom: Array) -> Array:
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom > 0)
