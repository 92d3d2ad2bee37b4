"""Reader of the contacts that the production deck dumps (``dump local``) where forces are asked for."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array
from granpipe.system.reading import read_bytes, reason

_HEAD = 9  # lines
_MOST_BYTES = 2_000_000_000


class Contacts(NamedTuple):
    """Contacts at one time, each of a particle with another one or with a wall.

    centre : (n, 3) of the particle [m]
    end : (n, 3) centre of the other particle, or the point on the wall [m]
    force : (n, 3) on the particle [N]
    """

    centre: Array
    end: Array
    force: Array

    def through_faces(self, period: float) -> Contacts:
        """With the other ends moved to where they are nearest along y, by periods of the vessel [m]; 0: it has none."""
        if not period:
            return self
        away = self.end[:, 1] - self.centre[:, 1]
        return self._replace(end=self.end - np.outer(period * np.round(away / period), [0.0, 1.0, 0.0]))

    def across_depth(self) -> Contacts:
        """Without those along y: with the front and the back wall of a slab, if walls they are with."""
        x, y, z = np.abs(self.centre - self.end).T
        return Contacts(*(one[y < np.hypot(x, z)] for one in self))

    def within_friction(self, friction: float) -> Contacts:
        """With tangential forces of at most `friction` times the normal ones.

        LIGGGHTS computes the forces once more for the dump, without the step's own sliding. A contact that slides is
        then just below the limit of friction, as at rest, and is given its damping on top of that limit.
        """
        branch = self.centre - self.end
        normal = branch / np.maximum(np.linalg.norm(branch, axis=1, keepdims=True), 1e-300)
        pressing = (self.force * normal).sum(axis=1, keepdims=True)
        along = self.force - pressing * normal
        size, most = np.linalg.norm(along, axis=1, keepdims=True), friction * np.abs(pressing)
        share = np.divide(most, size, out=np.ones_like(size), where=size > most)
        return self._replace(force=pressing * normal + share * along)


def read_wall_contacts(path: Path) -> Contacts:
    """Contacts with walls in one snapshot.

    Raises
    ------
    DataError : the file cannot be read, or is damaged
    """
    values = _read(path, 9)
    return Contacts(values[:, 3:6], values[:, :3], values[:, 6:])


def read_pair_contacts(path: Path, number: NDArray[np.int64], position: Array) -> Contacts:
    """Contacts between particles in one snapshot; a pair that two ranks have written counts once.

    Parameters
    ----------
    number : (n,) ids of the particles
    position : (n, 3) their centres [m]

    Raises
    ------
    DataError : the file cannot be read, is damaged, or names particles that are not there
    """
    values = _read(path, 5)
    order = np.argsort(number)
    ids = values[:, :2]
    place = np.searchsorted(number, ids, sorter=order).clip(max=max(0, len(number) - 1))
    if len(ids) and (not len(number) or (number[order[place]] != ids).any() or (ids[:, 0] == ids[:, 1]).any()):
        raise DataError(f"{path}: contacts of particles that the snapshot does not hold")
    pair = np.sort(place, axis=1)
    _, once = np.unique(pair[:, 0] * np.int64(len(number)) + pair[:, 1], return_index=True)
    one, other = order[place[once]].T
    return Contacts(position[one], position[other], values[once, 2:])


def _read(path: Path, columns: int) -> Array:
    """(n, columns) the numbers in a dump of contacts."""
    try:
        text = read_bytes(path, _MOST_BYTES).decode("ascii", errors="replace")
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read ({reason(error)})") from error
    *head, body = [*text.split("\n", _HEAD), ""][: _HEAD + 1]
    if len(head) < _HEAD or not head[2].startswith("ITEM: NUMBER OF ENTRIES"):
        raise DataError(f"{path}: not a dump of contacts, or cut short")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.fromstring(body, sep=" ") if body.strip() else np.zeros(0)
        count = int(head[3])
    except (ValueError, DeprecationWarning) as error:
        raise DataError(f"{path}: the numbers cannot be read ({error})") from error
    if count < 0 or values.size != count * columns or body[-1:] not in ("", "\n") or not np.isfinite(values).all():
        raise DataError(f"{path}: {count} contacts of {columns} numbers announced, {values.size} good numbers found")
    return values.reshape(-1, columns)
