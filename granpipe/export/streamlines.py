"""``streamlines.csv``: streamlines with residence times, r z t, as codes for the depletion of pebbles read them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from granpipe.export.exported import Exported, numbers, write_lines
from granpipe.field import Array


class Line(Protocol):
    """A streamline: part of the flow within it, and its (n,) points [m] with times [s] from the inlet on."""

    @property
    def within(self) -> float: ...

    @property
    def r(self) -> Array: ...

    @property
    def z(self) -> Array: ...

    @property
    def time(self) -> Array: ...

    @property
    def leaves(self) -> bool: ...


def write_streamlines(exported: Exported, lines: Iterable[Line], path: Path) -> None:
    """Write a row for each point."""
    write_lines(path, _rows(exported, list(lines)))


def _rows(exported: Exported, lines: list[Line]) -> Iterator[str]:
    staying = [str(number) for number, line in enumerate(lines, start=1) if not line.leaves]
    yield from (f"# {line}" for line in exported.head[:3])
    yield f"# {len(lines)} streamlines from the inlet, each amid one of as many streamtubes of equal flow"
    yield f"# that do not come to the outlet: {', '.join(staying) or 'none'}"
    measure = exported.field.grid.measure
    first = "axis" if measure.axial else "left_wall"
    yield f"streamline,flow_between_{first}_and_streamline,{measure.letter}_m,z_m,t_s"
    for number, line in enumerate(lines, start=1):
        for point in zip(line.r.tolist(), line.z.tolist(), line.time.tolist(), strict=True):
            yield f"{number},{line.within:.6g},{numbers(point, ',')}"
