"""What a sweep found: the results of all its points collected in one table, and a chart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from granpipe.errors import GranpipeError
from granpipe.pipeline.provenance import Provenance
from granpipe.sweep.folder import Folder
from granpipe.sweep.status import PointStatus, statuses, summary
from granpipe.sweep.table import Row, draw, longest_axis, write_csv, write_netcdf
from granpipe.system.files import replace_whole, unique


@dataclass(frozen=True)
class Written:
    """The state of all points, the files that were written, and why others could not be."""

    statuses: list[PointStatus]
    files: list[Path]
    problems: list[GranpipeError]

    @property
    def text(self) -> str:
        """How many points are in which state, and the files."""
        return "\n".join([summary(self.statuses), *(f"wrote {file}" for file in self.files)])

    @property
    def failures(self) -> list[str]:
        """Each point that failed, and why."""
        return [f"{one.name}: {one.text}" for one in self.statuses if one.state == "failed"]

    @property
    def complete(self) -> bool:
        """Whether every point is done and every file written."""
        return not self.problems and all(one.state == "done" for one in self.statuses)

    @property
    def marked(self) -> bool:
        """Whether a point failed a quality gate."""
        return any(one.state == "done" and one.text for one in self.statuses)


def write_table(folder: Folder) -> Written:
    """Write the table and the chart from what is there; failed points have a row, too.

    Raises
    ------
    DataError : the results of a point are damaged
    """
    found, inputs = statuses(folder), folder.inputs
    keys = _varied_keys(folder)
    rows = [_row(folder, one, keys) for one in found]
    writers: dict[str, Callable[[Path], None]] = {}
    if "csv" in inputs.table:
        writers["table.csv"] = partial(write_csv, rows)
    if "netcdf" in inputs.table:
        writers["table.nc"] = partial(write_netcdf, rows)
    done = [row for row, one in zip(rows, found, strict=True) if one.state == "done"]
    over = longest_axis(done, inputs.axes)
    if over is not None and inputs.chart:
        others = [axis for axis in inputs.axes if axis != over]
        writers["chart.png"] = partial(draw, done, over, others, inputs.chart)
    result = Written(found, [], [])
    for name, write in writers.items():
        try:
            _write_aside(write, folder.root / name)
        except GranpipeError as error:
            result.problems.append(error)
        else:
            result.files.append(folder.root / name)
    return result


def _write_aside(write: Callable[[Path], None], path: Path) -> None:
    """Write a file by one rename: two jobs of a sweep may write its table at the same moment."""
    aside = unique(path, path.suffix)
    try:
        write(aside)
        replace_whole(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def _varied_keys(folder: Folder) -> list[str]:
    """Keys of the case that are not the same in every point, in the order in which the sweep names them."""
    changes = [variant.changes for variant in folder.variants.values()]
    keys = dict.fromkeys(key for one in changes for key in one)
    return [key for key in keys if len({one.get(key) for one in changes}) > 1]


def _row(folder: Folder, status: PointStatus, keys: Sequence[str]) -> Row:
    """Changes, status, quality figures and everything measured that is a single number."""
    changes = folder.variants[status.name].changes
    row: dict[str, str | float] = {"point": status.name, **{key: changes.get(key, "") for key in keys}}
    row |= {"status": status.state, "remark": status.text}
    if status.state == "done":
        row |= _measured(folder.points / status.name)
    return row


def _measured(folder: Path) -> dict[str, str | float]:
    provenance = Provenance.of_point(folder)
    gates = provenance.quality
    found: dict[str, str | float] = {"wall_seconds": provenance.wall_seconds}
    found["failed_gates"] = sum(not gate.passed for gate in gates)
    return found | {f"quality: {gate.name}": gate.value for gate in gates} | dict(provenance.numbers)
