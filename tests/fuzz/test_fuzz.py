"""Damaged and hostile inputs to every reader: a result or one clear message, in little time and memory."""

from __future__ import annotations

import contextlib
import gzip
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fakes.analytic_flow import binary_snapshot, text_snapshot
from fuzz.limits import HangError, bounded
from fuzz.mutate import BINARY, TEXT, inputs

from granpipe.case.reader import read_case
from granpipe.dem.dump import first_step, read_dump
from granpipe.dem.dump_binary import is_complete
from granpipe.dem.wall_contacts import read_wall_contacts
from granpipe.errors import CaseError, DataError, GranpipeError
from granpipe.planning.plan import make_plan

SEED = 20261122
CASES = Path(__file__).parents[2] / "cases"
BOX = np.array([[-1.0, 1.0], [-1.0, 1.0], [0.0, 2.0]])


def check_all(path: Path, damaged: Iterator[bytes], read: Callable[[Path], object], refusal: type[Exception]) -> int:
    """Number of inputs that were refused; fails on any other end, with the input kept at `path`."""
    refused = 0
    with bounded() as next_one:
        for data in damaged:
            path.write_bytes(data)
            next_one()
            try:
                read(path)
            except refusal as error:
                if not str(error).strip():
                    raise
                refused += 1
    return refused


def case_sources() -> list[bytes]:
    """The cases of the project without their comments."""
    return [re.sub(rb"(?m)\s*#.*$", b"", path.read_bytes()) for path in sorted(CASES.glob("*.yaml"))]


def read_all(path: Path) -> None:
    """All that is ever asked of a dump."""
    for read in (is_complete, first_step, lambda path: list(read_dump(path))):
        with contextlib.suppress(DataError):
            read(path)
    list(read_dump(path))


def spheres(count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    return np.column_stack([np.arange(1, count + 1), np.ones(count), rng.normal(size=(count, 6)), np.full(count, 0.1)])


def dump_sources(kind: str) -> list[bytes]:
    write = binary_snapshot if kind == "binary" else text_snapshot
    whole = [write(step, BOX, spheres(count)) for step, count in ((0, 1), (5, 6), (7, 40))]
    return [*whole, whole[0] + whole[1], *([binary_snapshot(5, BOX, spheres(6), 3)] if kind == "binary" else [])]


def test_cases(tmp_path: Path, fuzz_inputs: int) -> None:
    damaged = inputs(SEED, case_sources(), TEXT, fuzz_inputs)
    refused = check_all(tmp_path / "case.yaml", damaged, lambda path: make_plan(read_case(path).case), CaseError)
    assert 0.3 * fuzz_inputs < refused < fuzz_inputs  # some stay good: the mutations reach behind the first check


@pytest.mark.parametrize(("kind", "mutators"), [("binary", BINARY), ("text", TEXT)])
def test_dumps(tmp_path: Path, fuzz_inputs: int, kind: str, mutators: tuple) -> None:
    damaged = inputs(SEED, dump_sources(kind), mutators, fuzz_inputs)
    refused = check_all(tmp_path / "dump", damaged, read_all, DataError)
    assert 0.3 * fuzz_inputs < refused < fuzz_inputs


def test_compressed_dumps(tmp_path: Path, fuzz_inputs: int) -> None:
    """Half of them damaged before they were compressed, half after."""
    outside = inputs(SEED, [gzip.compress(data) for data in dump_sources("text")], BINARY, fuzz_inputs // 2)
    inside = map(gzip.compress, inputs(SEED + 1, dump_sources("text"), TEXT, fuzz_inputs - fuzz_inputs // 2))
    for name, damaged in (("outside", outside), ("inside", inside)):
        assert check_all(tmp_path / f"{name}.gz", damaged, read_all, DataError) > 0.1 * fuzz_inputs


def test_the_limits_are_at_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fuzz.limits.SECONDS", 0.3)

    def hang(_: Path) -> None:
        while True:
            pass

    with pytest.raises(HangError):
        check_all(tmp_path / "x", iter([b"x"]), hang, GranpipeError)
    with pytest.raises(MemoryError):
        check_all(tmp_path / "x", iter([b"x"]), lambda _: np.ones(10**9), GranpipeError)


def test_contacts_with_walls(tmp_path: Path, fuzz_inputs: int) -> None:
    rows = "".join(f"{' '.join(f'{value:g}' for value in row)} \n" for row in spheres(20)[:, 2:8])
    head = "ITEM: TIMESTEP\n250\nITEM: NUMBER OF ENTRIES\n20\nITEM: BOX BOUNDS ff ff ff\n" + 3 * "-1 1\n"
    whole = f"{head}ITEM: ENTRIES c_contacts[1] c_contacts[2]\n{rows}".encode()
    damaged = inputs(SEED, [whole], TEXT, fuzz_inputs)
    refused = check_all(tmp_path / "contacts.txt", damaged, read_wall_contacts, DataError)
    assert 0.3 * fuzz_inputs < refused < fuzz_inputs
