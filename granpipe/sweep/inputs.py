"""What a sweep is to run: `case.yaml` and `points.json` in its folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from granpipe.case.yamlfile import MAX_BYTES
from granpipe.errors import DataError
from granpipe.sweep.variants import Variant
from granpipe.system.files import write_whole
from granpipe.system.jsonfile import read_json
from granpipe.system.reading import read_bytes, reason

_REMEDY = "start the sweep or study again: it writes the file anew and keeps what is done"


@dataclass(frozen=True)
class SweepInput:
    """What a sweep is to run: the case that it varies, its points, and what to show of them.

    Parameters
    ----------
    text : of the case that is varied
    variants : every point by name, in order; its changes include those that all points share
    axes : keys of the axes, in order
    chart : columns of the table to draw
    table : formats of the table
    beside : further files to write, by name
    """

    text: str
    variants: dict[str, Variant]
    axes: tuple[str, ...] = ()
    chart: tuple[str, ...] = ()
    table: tuple[str, ...] = ("csv",)
    beside: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write it down, for the processes that run the points."""
        points = [asdict(variant) for variant in self.variants.values()]
        plan = {"axes": self.axes, "chart": self.chart, "table": self.table, "points": points}
        write_whole(folder / "case.yaml", self.text)
        write_whole(folder / "points.json", json.dumps(plan, indent=1, ensure_ascii=False))
        for name, text in self.beside.items():
            write_whole(folder / name, text)

    @classmethod
    def read(cls, folder: Path) -> SweepInput:
        """What `write` wrote; DataError where it is gone or damaged."""
        path = folder / "case.yaml"
        try:
            text = read_bytes(path, MAX_BYTES).decode()
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: damaged ({reason(error)}); {_REMEDY}") from error
        stored = read_json(folder / "points.json", _Stored, _REMEDY)
        variants = {one.name: one for one in stored.points}
        return cls(text, variants, stored.axes, stored.chart, stored.table)


@dataclass(frozen=True)
class _Stored:
    """What ``points.json`` holds."""

    axes: tuple[str, ...]
    chart: tuple[str, ...]
    table: tuple[str, ...]
    points: Annotated[tuple[Variant, ...], Field(min_length=1)]
