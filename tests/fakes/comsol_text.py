"""Readers for COMSOL's three interpolation text formats, written from its documentation and its own exports."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Spreadsheet:
    """Header entries in their order, column heads, where these begin in their line, and the rows."""

    entries: dict[str, str]
    heads: list[str]
    starts: list[int]
    rows: np.ndarray


def read_spreadsheet(path: Path) -> Spreadsheet:
    lines = path.read_text(encoding="ascii").splitlines()
    comments = [line for line in lines if line.startswith("%")]
    assert lines[: len(comments)] == comments, "comments after the first row"
    pairs = [re.fullmatch(r"% ([\w ]+): +(.*)", line) for line in comments[:-1]]
    found = list(re.finditer(r"\S+(?: \S+)*", comments[-1][2:]))
    return Spreadsheet(
        entries={pair[1]: pair[2] for pair in pairs},
        heads=[match[0] for match in found],
        starts=[match.start() + 2 for match in found],
        rows=np.array([line.split() for line in lines[len(comments) :]], dtype=float),
    )


def read_sections(path: Path) -> dict[str, np.ndarray]:
    """Blocks of rows by the comment above them: ``Grid`` as two rows of axes, ``Data``, ``Coordinates``, …"""
    blocks: dict[str, list[list[float]]] = {}
    for line in path.read_text(encoding="ascii").splitlines():
        if line.startswith("%"):
            rows = blocks.setdefault(line[1:].strip(), [])
        else:
            rows.append([float(word) for word in line.split()])
    return {name: rows if name == "Grid" else np.array(rows) for name, rows in blocks.items()}
