"""What a sweep is to run: `case.yaml` and `points.json` in its folder."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from granpipe.errors import DataError
from granpipe.sweep.variants import Variant


@dataclass(frozen=True)
class Content:
    """What is to be run.

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
        replace_text(folder / "case.yaml", self.text)
        replace_text(folder / "points.json", json.dumps(plan, indent=1, ensure_ascii=False))
        for name, text in self.beside.items():
            replace_text(folder / name, text)

    @classmethod
    def read(cls, folder: Path) -> Content:
        """What `write` wrote; DataError where it is gone or damaged."""
        with _explained(folder / "case.yaml") as path:
            text = path.read_bytes().decode()
        with _explained(folder / "points.json") as path:
            match json.loads(path.read_bytes()):
                case {"axes": [*axes], "chart": [*chart], "table": [*table], "points": [_, *_] as points}:
                    variants = {one.name: one for one in map(_variant, points)}
                    return cls(text, variants, tuple(map(str, axes)), tuple(map(str, chart)), tuple(map(str, table)))
            raise ValueError("it does not tell the points of a sweep")


def _variant(point: Any) -> Variant:
    match point:
        case {"name": str(name), "changes": dict(changes)} if all(isinstance(text, str) for text in changes.values()):
            return Variant(name, changes)
    raise ValueError(f"{point!r} is no point")


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[Path]:
    try:
        yield path
    except (FileNotFoundError, ValueError) as error:
        raise DataError(
            f"{path}: damaged ({error}); start the sweep or study again: it writes the file anew and keeps what is done"
        ) from error


def replace_text(path: Path, text: str) -> None:
    """Write a file by one rename."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_text(text, encoding="utf-8")
    aside.replace(path)
