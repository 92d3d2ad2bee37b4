"""All particles at one time, as a dump holds them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array

OWN_COLUMNS = ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")
"""What granpipe's own decks dump."""

READ_COLUMNS = {*OWN_COLUMNS, "diameter", *(axis + kind for axis in "xyz" for kind in ("u", "s", "su"))} - {"type"}
"""What is made use of; other columns may hold anything."""

Periodic = tuple[bool, bool, bool]

_MOST_SPEED = 1e4  # m/s
_NAMED_RIGHT = "are the columns named in the order of the dump command?"


class TruncatedError(DataError):
    """The file ends before its own header says so."""


@dataclass(frozen=True)
class Snapshot:
    """All particles at one step.

    Parameters
    ----------
    step : time step number of the simulation
    box : (3, 2) low and high bound of the simulation box in x, y, z [m]
    columns : names of the columns
    values : (n, columns) one row per particle, in the file's order (which changes with the rank layout: use `id`);
        nan where a column holds text
    time : what the dump says [s], if it does
    """

    step: int
    box: Array
    columns: tuple[str, ...]
    values: Array
    time: float | None = None

    def __len__(self) -> int:
        return len(self.values)

    def column(self, name: str) -> Array:
        """(n,) the named column; the first one where a dump repeats a name.

        Raises
        ------
        DataError : there is none
        """
        if name not in self.columns:
            raise DataError(f"step {self.step}: the dump has no column '{name}' (it has {', '.join(self.columns)})")
        return np.asarray(self.values[:, self.columns.index(name)])

    def _vector(self, names: tuple[str, str, str]) -> Array:
        return np.column_stack([self.column(name) for name in names])

    @property
    def id(self) -> NDArray[np.int64]:
        """(n,) particle numbers.

        Raises
        ------
        DataError : the dump lacks the column
        """
        return self.column("id").astype(np.int64)

    @property
    def position(self) -> Array:
        """(n, 3) centres [m].

        Raises
        ------
        DataError : the dump lacks the columns
        """
        return self._vector(("x", "y", "z"))

    @property
    def velocity(self) -> Array:
        """(n, 3) [m/s].

        Raises
        ------
        DataError : the dump lacks the columns
        """
        return self._vector(("vx", "vy", "vz"))

    @property
    def radius(self) -> Array:
        """(n,) [m].

        Raises
        ------
        DataError : the dump lacks the column
        """
        return self.column("radius")

    def having(self, **columns: Array | float) -> Snapshot:
        """The same with more columns (n,), or one value for all particles; those of the same names are replaced.

        Raises
        ------
        DataError : the dump lacks the column
        """
        names = tuple(name for name in self.columns if name not in columns)
        kept = [self.column(name) for name in names]
        added = [np.broadcast_to(np.asarray(column, dtype=float), len(self)) for column in columns.values()]
        return replace(self, columns=(*names, *columns), values=np.column_stack([*kept, *added]))


def with_standard_columns(snapshot: Snapshot, where: str, periodic: Periodic = (False, False, False)) -> Snapshot:
    """With x, y, z and radius from what stands for them: ``diameter``; scaled (``xs``), unwrapped (``xu``, ``xsu``).

    Parameters
    ----------
    where : file and step, for messages
    periodic : in which directions unwrapped positions are put back into the box

    Raises
    ------
    DataError : numbers that are not finite, radii that are not positive, ids that are not whole numbers from 0: mostly
        a sign that the columns are named in another order than dumped
    """
    added: dict[str, Array] = {}
    if "radius" not in snapshot.columns and "diameter" in snapshot.columns:
        added["radius"] = 0.5 * snapshot.column("diameter")
    for axis, (low, high), wraps in zip("xyz", snapshot.box, periodic, strict=True):
        kind = next((kind for kind in ("", "s", "u", "su") if axis + kind in snapshot.columns), "")
        if not kind:
            continue
        place = snapshot.column(axis + kind)
        place = low + (high - low) * place if "s" in kind else place
        added[axis] = low + (place - low) % (high - low) if wraps and "u" in kind else place
    snapshot = snapshot.having(**added) if added else snapshot
    _check_numbers(snapshot, where)
    return snapshot


def _check_numbers(snapshot: Snapshot, where: str) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        suspicious = not np.isfinite(snapshot.values.sum())  # one fast pass; a huge but finite column also ends here
    if suspicious:
        for name in snapshot.columns:
            if name in READ_COLUMNS and not np.isfinite(snapshot.column(name)).all():
                raise DataError(f"{where}: column '{name}' is not finite everywhere; {_NAMED_RIGHT}")
    if "radius" in snapshot.columns and len(snapshot) and snapshot.column("radius").min() <= 0:
        raise DataError(f"{where}: column 'radius' is not positive everywhere; {_NAMED_RIGHT}")
    if "id" in snapshot.columns:
        number = snapshot.column("id").copy()  # in one piece
        if len(number) and (number.min() < 0 or number.max() >= 2**53 or (number != np.floor(number)).any()):
            raise DataError(f"{where}: column 'id' does not hold whole numbers from 0; {_NAMED_RIGHT}")


def check_plausible(snapshot: Snapshot) -> None:
    """Refuse particles that cannot be: in dumps that granpipe's own runs did not make.

    Raises
    ------
    DataError : a particle more than a length of the box away from the box, larger than the box, or faster than 1e4 m/s
    """
    low, high = snapshot.box.T
    length = high - low
    for axis, name in enumerate("xyz"):
        place = snapshot.column(name)
        far = np.flatnonzero((place < low[axis] - length[axis]) | (place > high[axis] + length[axis]))
        if len(far):
            raise DataError(
                f"step {snapshot.step}: a particle at {name} = {place[far[0]]:g} m is far outside the box, "
                f"{low[axis]:g} … {high[axis]:g} m; {_NAMED_RIGHT}"
            )
    if len(snapshot) and (largest := snapshot.radius.max()) > length.max():
        raise DataError(
            f"step {snapshot.step}: a particle of radius {largest:g} m in a box of {length.max():g} m; {_NAMED_RIGHT}"
        )
    for name in {"vx", "vy", "vz"} & set(snapshot.columns):
        if len(snapshot) and (fastest := np.abs(snapshot.column(name)).max()) > _MOST_SPEED:
            raise DataError(
                f"step {snapshot.step}: a particle with {name} = {fastest:g} m/s; {_NAMED_RIGHT} Did the run blow up?"
            )
