"""Damaged drawings: a vessel that stands up to the checks of every outline, or one clear message."""

from __future__ import annotations

import os
import re
import signal
import traceback
from pathlib import Path

import numpy as np
import pytest
from fakes.drawings import revolved_stl, write_csv, write_dxf, write_mphtxt, write_step
from fuzz.mutate import TEXT, inputs
from fuzz.test_fuzz import SEED, check_all

from granpipe.drawings import cad
from granpipe.drawings.read import read_drawing
from granpipe.errors import CaseError
from granpipe.geometry.outline import Outline

WALL = [(1.0, 4.0), (1.0, 2.0), (0.5, 1.0), (0.5, 0.0)]
RING = [(0.7, 3.0), (0.9, 3.0), (0.9, 2.5), (0.7, 2.5)]
SHARE, CAD_SHARE = 8, 40
"""Part of the inputs that each format of drawings gets: a drawing takes ten times as long as a case."""
CAD_SECONDS = 1
"""Processor time of one CAD file [s]; `granpipe` allows `cad.LEAST_SECONDS`."""


def source(kind: str, folder: Path) -> bytes:
    path = folder / f"whole.{kind}"
    if kind == "dxf":
        write_dxf(path, [("0", WALL, False), ("0", RING, True)], insunits=6)
    elif kind == "csv":
        write_csv(path, [WALL, [*RING, RING[0]]])
    elif kind == "mphtxt":
        write_mphtxt(path, [(0, 0), (1, 0), (1, 2), (0, 2), (1, 4), (0, 4)],
                     [(0, 1, 2), (0, 2, 3), (3, 2, 4), (3, 4, 5)])  # fmt: skip
    elif kind in ("stl", "obj"):
        revolved_stl(path, WALL, facets=12)
        if kind == "obj":
            corners = re.findall(r"vertex (.*)", path.read_text())
            triangles = [f"f {n} {n + 1} {n + 2}" for n in range(1, len(corners), 3)]
            path.write_text("\n".join([*(f"v {corner}" for corner in corners), *triangles]))
    else:
        path = path.with_suffix(SUFFIX[kind])
        write_step(path, WALL, {}, turned=kind != "face")
    return path.read_bytes()


def read(path: Path) -> None:
    section = read_drawing(path, unit="m").section
    assert np.isfinite(section.wall).all()
    Outline.of(section.wall, section.obstacles)


def count_for(fuzz_inputs: int, share: int = SHARE) -> int:
    return max(20, fuzz_inputs // share)


@pytest.mark.parametrize("kind", ["dxf", "csv", "mphtxt", "stl", "obj"])
def test_drawings(tmp_path: Path, fuzz_inputs: int, kind: str) -> None:
    damaged = inputs(SEED, [source(kind, tmp_path)], TEXT, count_for(fuzz_inputs))
    assert check_all(tmp_path / f"damaged.{kind}", damaged, read, CaseError) > 0


SUFFIX = {"face": ".step", "body": ".step", "brep": ".brep"}


@pytest.mark.parametrize("kind", SUFFIX)
def test_cad_files(tmp_path: Path, fuzz_inputs: int, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Many in one process, as one for each takes ten times as long; a file that ends it is refused in a run."""
    damaged = list(inputs(SEED, [source(kind, tmp_path)], TEXT, count_for(fuzz_inputs, CAD_SHARE)))
    path, deadly = tmp_path / f"damaged{SUFFIX[kind]}", []
    with monkeypatch.context() as patch:
        patch.setattr("granpipe.drawings.cad.subprocess.run", lambda command, **_: cad._answer(command[-1]))
        refused = done = slow = 0
        while done < len(damaged):
            ends, signal_number = _read_in_child(path, damaged[done:])
            refused, done = refused + ends.count(b"r"), done + len(ends)
            if signal_number:
                slow += signal_number == signal.SIGPROF
                deadly += [damaged[done]] if signal_number != signal.SIGPROF else []
                done += 1
    assert refused > 0
    print(f"{kind}: {len(damaged)} files, {refused} refused, {len(deadly)} ended OpenCASCADE, {slow} slow")
    for data in deadly[:2]:
        path.write_bytes(data)
        with pytest.raises(CaseError, match="not a STEP or BREP file"):
            read(path)


def _read_in_child(path: Path, damaged: list[bytes]) -> tuple[bytes, int]:
    """How inputs ended, a letter each (read or refused), until a signal ended the child: its number, else 0."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # OpenCASCADE prints
        for data in damaged:
            signal.setitimer(signal.ITIMER_PROF, CAD_SECONDS)
            path.write_bytes(data)
            try:
                read(path)
            except CaseError:
                os.write(writing, b"r")
            except BaseException:
                os.write(2, traceback.format_exc().encode())
                os._exit(1)
            else:
                os.write(writing, b"o")
        os._exit(0)
    os.close(writing)
    ends = b""
    while some := os.read(reading, 4096):
        ends += some
    os.close(reading)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code <= 0, f"{path}: see the traceback above"
    return ends, -code
