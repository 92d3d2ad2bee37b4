"""CSV: a polyline as two columns, r and z; blank lines separate the wall from obstacles."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from granpipe.drawings.lines import Line, Lines
from granpipe.errors import CaseError

MOST_BYTES = 50_000_000

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_BEGINS_AS_NUMBER = re.compile(r"[-+]?\.?\d")


def read_csv(path: Path, sagitta: float | None = None) -> Lines:
    """The lines of a table with two columns: r and z, separated by commas, semicolons, tabs or spaces.

    A head line, none of whose fields begins as a number does, and lines that begin with ``#`` or ``%`` are passed over.
    A blank line begins a new line of the drawing.
    With semicolons a comma is a decimal comma. The first line is the wall, unless there is only one.

    Raises
    ------
    CaseError : a row that is not two numbers, or a point between blank lines, with its line
    """
    if path.stat().st_size > MOST_BYTES:
        raise CaseError(f"larger than {MOST_BYTES / 1e6:.0f} MB; a polyline has some hundred points")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise CaseError("no text in UTF-8; save the table as CSV (UTF-8)") from None
    runs: list[list[tuple[float, float]]] = [[]]
    last = 0
    for number, row in enumerate(text.splitlines(), start=1):
        stripped = row.strip()
        if not stripped:
            _check_run(runs[-1], last)
            runs.append([])
        elif stripped[0] not in "#%" and not (number == 1 and _is_head(stripped)):
            found, last = _numbers(stripped), number
            if len(found) != 2:
                raise CaseError(f"line {number}: {stripped[:60]!r} is not two numbers, r and z")
            runs[-1].append((found[0], found[1]))
    lines = [Line(np.array(run)) for run in runs if run]
    if not lines:
        raise CaseError("holds no polyline: give two rows of r and z or more")
    _check_run(runs[-1], last)
    return Lines(lines, half=True)


def _check_run(run: list[tuple[float, float]], number: int) -> None:
    """CaseError for a single point, which is no line: one would be left out of the wall without a word."""
    if len(run) == 1:
        raise CaseError(f"line {number}: a point alone; take out the blank line beside it, or give it more points")


def _is_head(row: str) -> bool:
    return not any(map(_BEGINS_AS_NUMBER.match, _fields(row)))


def _numbers(row: str) -> list[float]:
    """The numbers of a row; none where something else stands in it."""
    fields = _fields(row)
    return [float(field) for field in fields] if all(map(_NUMBER.fullmatch, fields)) else []


def _fields(row: str) -> list[str]:
    if ";" in row:
        return [field.strip().replace(",", ".") for field in row.split(";")]
    return [field for field in re.split(r"[,\s]+", row) if field]
