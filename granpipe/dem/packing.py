"""The bed that a filling begins with: spheres packed at random, nearly as dense as a slow bed and without overlap.

Particles that are dropped in take most of a filling to fall, to pack and to come to rest. Spheres that are pushed apart
on a computer are packed at once: a block with periodic faces is made, repeated, and cut to the vessel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granpipe.dem.sizes import SizeClasses
from granpipe.errors import RunError
from granpipe.field import Array, Boxes, Frustum, Mask

LOOSE = 0.55
"""Packing of the spheres that a filling begins with: from it a bed settles to the packing of one that is dropped in;
what is denser must dilate before it flows steadily (docs/validation/filling.md)."""

LARGEST_OVERLAP = 1e-4
"""Of two spheres, as part of the sum of their radii, at most: hard spheres that overlap more would fly apart."""

WIDEST = 4.0
"""Radius of the largest over that of the smallest sphere, at most: searching for neighbours takes far longer beyond."""

_LEAST, _MOST, _RAREST = 3000, 20_000, 8
"""Spheres in a block, at least and at most; of the rarest class, where the most allows it."""

_SEARCH = 0.2  # distance beyond touching up to which pairs are kept, in radii of the smallest sphere
_FARTHEST = 0.2  # that a sphere is moved at a time, in its radii
_PUSH, _KEPT = 0.25, 0.9  # what an overlap adds to the move of a sphere, and what is left of its last move
_ROUNDS = 1000  # up to 200 are usual


@dataclass(frozen=True)
class Packing:
    """Spheres in a block with periodic faces.

    Parameters
    ----------
    position : (n, 3) centres [m], from 0 to `edges`
    number : (n,) size class of each
    edges : (3,) of the block [m]
    """

    position: Array
    number: NDArray[np.int64]
    edges: Array

    def layers(self, low: Array, high: Array) -> Iterator[tuple[Array, NDArray[np.int64]]]:
        """Centres (m, 3) [m] and classes (m,) in a box between two corners (3,), the block repeated to fill it, from
        the bottom up.

        Periodic in each direction in which the box holds the block a whole number of times.
        """
        across, along, up = np.ceil((high - low) / self.edges - 1e-9).astype(int)
        for level in range(up):
            numbers = np.meshgrid(np.arange(across), np.arange(along), level, indexing="ij")
            corners = np.stack(numbers, axis=-1).reshape(-1, 1, 3)
            position = (low + self.position + corners * self.edges).reshape(-1, 3)
            inside = (position < high).all(axis=1)
            yield position[inside], np.tile(self.number, len(corners))[inside]


def pack(classes: SizeClasses, packing: float, seed: int, depth: float | None = None) -> Packing:
    """A block of spheres in all size classes, packed at random.

    Overlaps are springs between weightless spheres; they are let go until hardly any overlap is left. Below random
    close packing, 0.64 for equal spheres, that succeeds.

    Parameters
    ----------
    packing : volume of the spheres over that of the block
    depth : what the second edge of the block must divide [m]

    Raises
    ------
    RunError : overlaps are left; the packing is too dense
    """
    rng = np.random.default_rng(seed)
    number = _numbers(classes)
    radius = classes.radius[number]
    edges = _edges(float(4 / 3 * np.pi * (radius**3).sum()) / packing, depth)
    position = rng.random((len(radius), 3)) * edges
    move, pairs, seen = np.zeros_like(position), _touching(position, radius, edges), position
    for _ in range(_ROUNDS):
        if float(np.abs(position - seen).max()) > 0.25 * _SEARCH * classes.smallest:
            pairs, seen = _touching(position, radius, edges), position
        push, worst = _pushes(position, radius, edges, pairs)
        if worst <= LARGEST_OVERLAP:
            return Packing(position % edges, number, edges)
        if float((move * push).sum()) < 0:  # gone too far
            move[:] = 0.0
        move = _KEPT * move + _PUSH * push
        length = np.sqrt((move**2).sum(axis=1))
        position = position + move * np.minimum(1.0, _FARTHEST * radius / np.maximum(length, 1e-300))[:, None]
    raise RunError(f"the particles could not be packed to {packing:g}: some overlap by {worst:.2g} of their size still")


def _numbers(classes: SizeClasses) -> NDArray[np.int64]:
    """(n,) class of each sphere, as often as its share says."""
    wanted = max(_LEAST, int(_RAREST / max(classes.number_share.min(), _RAREST / _MOST)))
    ends = np.round(wanted * np.cumsum(classes.number_share)).astype(int)
    return np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))


def _edges(volume: float, depth: float | None) -> Array:
    edge = np.cbrt(volume)
    if depth is None:
        return np.full(3, edge)
    across = depth / max(1, round(depth / edge))
    along = np.sqrt(volume / across)
    return np.array([along, across, along])


def _touching(position: Array, radius: Array, edges: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of all spheres in pairs that touch, or nearly do."""
    near = _SEARCH * float(radius.min())
    tree = cKDTree(np.minimum(position % edges, np.nextafter(edges, 0.0)), boxsize=edges)
    i, j = tree.query_pairs(2 * float(radius.max()) + near, output_type="ndarray").T
    close = (_between(position, edges, i, j) ** 2).sum(axis=1) < (radius[i] + radius[j] + near) ** 2
    return i[close], j[close]


def _between(position: Array, edges: Array, i: NDArray[np.int64], j: NDArray[np.int64]) -> Array:
    """(pairs, 3) from the second sphere of each pair to the first, the shortest way [m]."""
    distance = position[i] - position[j]
    return np.asarray(distance - edges * np.round(distance / edges))


def _pushes(
    position: Array, radius: Array, edges: Array, pairs: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> tuple[Array, float]:
    """(n, 3) sum of the overlaps of each sphere, away from the other one [m]; largest overlap over the sum of radii."""
    i, j = pairs
    between, touching = _between(position, edges, i, j), radius[i] + radius[j]
    distance = np.sqrt((between**2).sum(axis=1))
    overlap = np.maximum(0.0, touching - distance)
    away = between * (overlap / np.maximum(distance, 1e-300))[:, None]
    push = [np.bincount(i, part, len(radius)) - np.bincount(j, part, len(radius)) for part in away.T]
    return np.stack(push, axis=1), float((overlap / touching).max(initial=0.0))


@dataclass(frozen=True)
class Bed:
    """Particles placed in a vessel: centres (n, 3) [m] and size classes (n,)."""

    position: Array
    number: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.number)

    def lowest(self, most: int) -> Bed:
        """The lowest particles, at most so many."""
        if len(self) <= most:
            return self
        kept = np.sort(np.argpartition(self.position[:, 2], most)[:most])
        return Bed(self.position[kept], self.number[kept])


def packable(classes: SizeClasses) -> bool:
    """Whether the sizes are near enough to each other for a packed bed."""
    return classes.largest <= WIDEST * classes.smallest


def packed_bed(
    classes: SizeClasses,
    packing: float,
    seed: int,
    pieces: Sequence[Sequence[Frustum | Boxes]],
    ends: tuple[Array, Array],
    periodic: bool = False,
) -> Bed:
    """Packed spheres that lie within a vessel, in the shares of their classes; none where sizes differ too much.

    Parameters
    ----------
    pieces : of the vessel, in which centres of each size class may lie
    ends : two corners (3,) [m] of a box that holds them
    periodic : whether the second direction is
    """
    none = Bed(np.empty((0, 3)), np.empty(0, dtype=np.int64))
    room = np.array([sum(one.volume for one in parts) for parts in pieces])
    if not room.all() or not packable(classes):
        return none
    due = classes.number_share / room  # large ones keep farther from walls
    wanted = replace(classes, number_share=due / due.sum())
    low, high = ends
    block = pack(wanted, packing, seed, float(high[1] - low[1]) if periodic else None)
    kept = []
    for position, number in block.layers(low, high):
        inside = np.zeros(len(number), dtype=bool)
        for one, parts in enumerate(pieces):
            of_class = np.flatnonzero(number == one)
            for part in parts:
                inside[of_class] |= _contains(part, position[of_class])
        kept.append(Bed(position[inside], number[inside]))
    return Bed(np.concatenate([bed.position for bed in kept]), np.concatenate([bed.number for bed in kept]))


def _contains(piece: Frustum | Boxes, position: Array) -> Mask:
    """(n,) which points (n, 3) lie in a piece."""
    x, y, z = position.T
    if isinstance(piece, Boxes):
        inside = np.zeros(len(z), dtype=bool)
        for a, b, c, d, e, f in piece.blocks:
            inside |= (x >= a) & (x < b) & (y >= c) & (y < d) & (z >= e) & (z < f)
        return inside
    share = (z - piece.z_low) / piece.height
    across = np.hypot(x, y) if piece.measure.axial else x
    inner = piece.inner_low + share * (piece.inner_high - piece.inner_low)
    outer = piece.outer_low + share * (piece.outer_high - piece.outer_low)
    inside = (share >= 0) & (share < 1) & (across >= inner) & (across <= outer)
    if not piece.measure.axial:
        inside &= (y >= piece.front) & (y <= piece.front + piece.measure.turn)
    return np.asarray(inside)
