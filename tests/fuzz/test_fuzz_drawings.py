"""Damaged drawings: a vessel that stands up to the checks of every outline, or one clear message."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fakes.drawings import revolved_stl, write_csv, write_dxf, write_mphtxt, write_step
from fuzz.mutate import TEXT, inputs
from fuzz.test_fuzz import SEED, check_all

from granpipe.drawings.read import read_drawing
from granpipe.errors import CaseError
from granpipe.geometry.outline import Outline

WALL = [(1.0, 4.0), (1.0, 2.0), (0.5, 1.0), (0.5, 0.0)]
RING = [(0.7, 3.0), (0.9, 3.0), (0.9, 2.5), (0.7, 2.5)]
SHARE = {"step": 40}
"""Formats of which only this part of the inputs is tried: OpenCASCADE takes a hundred times as long."""


def source(kind: str, folder: Path) -> bytes:
    path = folder / f"whole.{kind}"
    if kind == "dxf":
        write_dxf(path, [("0", WALL, False), ("0", RING, True)], insunits=6)
    elif kind == "csv":
        write_csv(path, [WALL, [*RING, RING[0]]])
    elif kind == "mphtxt":
        write_mphtxt(path, [(0, 0), (1, 0), (1, 2), (0, 2), (1, 4), (0, 4)],
                     [(0, 1, 2), (0, 2, 3), (3, 2, 4), (3, 4, 5)])  # fmt: skip
    elif kind == "stl":
        revolved_stl(path, WALL, facets=12)
    else:
        write_step(path, WALL, {}, turned=False)
    return path.read_bytes()


def read(path: Path) -> None:
    section = read_drawing(path, unit="m").section
    assert np.isfinite(section.wall).all()
    Outline.of(section.wall, section.obstacles)


@pytest.mark.parametrize("kind", ["dxf", "csv", "mphtxt", "stl", "step"])
def test_drawings(tmp_path: Path, fuzz_inputs: int, kind: str) -> None:
    damaged = inputs(SEED, [source(kind, tmp_path)], TEXT, max(20, fuzz_inputs // SHARE.get(kind, 8)))
    assert check_all(tmp_path / f"damaged.{kind}", damaged, read, CaseError) > 0
