"""Damaged and hostile inputs to every reader: a result or one clear message, in little time and memory."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import os
import random
import re
import signal
import socket
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from fakes.analytic_flow import binary_snapshot, text_snapshot
from fakes.records import SEGMENT, SETTLED, WALLS
from fakes.synthetic import field_of, pipe
from fuzz.limits import HangError, bounded
from fuzz.mutate import BINARY, TEXT, inputs

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.dem.contacts import read_wall_contacts
from granpipe.dem.dump import first_step, read_dump, read_dumps
from granpipe.dem.dump_binary import is_complete
from granpipe.errors import CaseError, DataError, GranpipeError
from granpipe.field import Field
from granpipe.pipeline.provenance import Identity, Provenance, known_gates
from granpipe.pipeline.records import SegmentRecord, SettleRecord, WallRecord
from granpipe.planning.make import make_plan
from granpipe.study.budget import advise
from granpipe.study.findings import Notes
from granpipe.study.report import read_study
from granpipe.sweep.file import read_profile, read_sweep
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.queue import Jobs
from granpipe.sweep.state import State
from granpipe.system.jsonfile import read_json
from granpipe.system.manifest import _seal, read_manifest
from granpipe.system.rates import Rates

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
    rows = "".join(f"{' '.join(f'{value:g}' for value in row)} \n" for row in np.tile(spheres(20)[:, 2:5], 3))
    head = "ITEM: TIMESTEP\n250\nITEM: NUMBER OF ENTRIES\n20\nITEM: BOX BOUNDS ff ff ff\n" + 3 * "-1 1\n"
    whole = f"{head}ITEM: ENTRIES c_contacts[1] c_contacts[2]\n{rows}".encode()
    damaged = inputs(SEED, [whole], TEXT, fuzz_inputs)
    refused = check_all(tmp_path / "contacts.txt", damaged, read_wall_contacts, DataError)
    assert 0.3 * fuzz_inputs < refused < fuzz_inputs


def test_sweeps_and_clusters(tmp_path: Path, fuzz_inputs: int) -> None:
    (tmp_path / "hopper.yaml").write_text("name: hopper\n")
    text = "name: many\ncase: hopper.yaml\naxes:\n  - contact.friction: [0.2, 0.4]\n"
    text += "  - dem.seed: {first: 1, last: 8, number: 8}\npoints:\n  slow: {dem.seed: 9}\nchart: [wall_seconds]\n"
    profile = re.sub(rb"(?m)\s*#.*$", b"", (CASES / "sweeps" / "cluster.yaml").read_bytes())
    for source, read in ((text.encode(), read_sweep), (profile, read_profile)):
        refused = check_all(tmp_path / "a.yaml", inputs(SEED, [source], TEXT, fuzz_inputs // 2), read, CaseError)
        assert 0.1 * fuzz_inputs < refused < fuzz_inputs // 2


def field_sources() -> list[bytes]:
    """Files of a field, as stored and compressed."""
    field = field_of(pipe(), 0.3)
    extra = {"wall_surface": np.array(["wall", "ring"]), "wall_ends": np.ones((2, 2, 2)), "wall_slip": np.ones(2)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "field.npz"
        replace(field, extra=extra).save(path)
        with np.load(path) as data:
            np.savez(Path(folder) / "stored.npz", **data)
        return [path.read_bytes(), (Path(folder) / "stored.npz").read_bytes()]


def in_archive(rng: random.Random, data: bytes) -> bytes:
    """The file with one array damaged: its checksum holds, its content does not."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w") as new:
        damaged = rng.choice(old.namelist())
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, rng.choice(BINARY)(rng, content) if name == damaged else content)
    return buffer.getvalue()


def use(path: Path) -> None:
    """All that is done with the field of a stranger: it is compared, and written for other programs."""
    field = Field.load(path)
    assert all(np.isfinite(one.observed) and np.isfinite(one.upper) for one in compare(field, field, {}, 0.1))
    assert np.isfinite(field.velocity_scale * field.flux_z).all()


def test_fields(tmp_path: Path, fuzz_inputs: int) -> None:
    """Half of them damaged as files, half inside, where no checksum tells."""
    sources = field_sources()
    outside = inputs(SEED, sources, BINARY, fuzz_inputs // 2)
    inside = inputs(SEED + 1, sources[1:], [in_archive], fuzz_inputs // 2)
    for damaged in (outside, inside):
        assert check_all(tmp_path / "field.npz", damaged, use, DataError) > 0.1 * fuzz_inputs


GATE = {"name": "turnovers", "value": 1.5, "limit": "at least 1", "passed": True}
CASE = {
    "name": "column", "outline": {"wall": [[0.1, 0.3], [0.1, 0.0]]}, "flow_rate": "1 kg/h",
    "material": {"density": 1000, "size": {"diameter": 0.02}}, "dem": {"max_time": 1.0}, "model": "dem",
}  # fmt: skip
STATE = asdict(State("abc", "running", "produce", 0.5, "step 7", "", (), "node", 12, "7_1", 1.5e9, 1.6e9))
MANIFEST = {"files": {"a": "1f"}, "sha256": _seal({"a": "1f"})}
IDENTITY = {
    "key": "k", "quality": [GATE], "origin": {"file": "/a/case.yaml", "outline": "o", "case": "c"},
}  # fmt: skip
OPTION = {
    "point": "base", "method": "psi", "travel": 1.5, "seconds": 9.0, "cores": 1, "statistical": {"whole": 0.01},
    "blocks": 20.0, "systematic": {"whole": {"value": 0.01, "upper": 0.02}}, "changes": {"dem.max_time": "4"},
}  # fmt: skip

FILES: dict[str, tuple[object, Callable[[Path], object]]] = {
    "provenance.json": (
        {"case": "a", "wall_seconds": 1.5, "quality": [GATE], "figures": {"flow": 1.0, "errors": {"whole": 0.1}}},
        lambda path: list(Provenance.read(path.parent).numbers),
    ),
    "provenance.json of a case": (IDENTITY, lambda path: Identity.read(path.parent)),
    "provenance.json of a known field": ({"quality": [GATE]}, lambda path: known_gates(path.parent)),
    "points.json": (
        {"axes": ["dem.seed"], "chart": [], "table": ["csv"], "points": [{"name": "a", "changes": {"dem.seed": "1"}}]},
        lambda path: SweepInput.read(path.parent),
    ),
    "study.json": (
        {"case": CASE, "fill_angle_deg": 60.0, "options": [OPTION], "unknown": ["time_step"]},
        lambda path: advise(read_study(path).options, 0.05),
    ),
    "axes.json": ({"axes": {"a": "seed"}, "forecast_seconds": {"a": 3.0}}, lambda path: read_json(path, Notes, "x")),
    "jobs.json": ({"jobs": [{"job": "7", "points": [["a", "b"]]}]}, lambda path: read_json(path, Jobs, "x")),
    "state.json": (STATE, lambda path: (read_json(path, State), State.load(path))),
    "rates.json": ({"cpu": {"made": "2026", "rates": {"1": 1e6}}}, lambda path: read_json(path, dict[str, Rates])),
    "programs.json": ({"liggghts 1 2": "3.8"}, lambda path: read_json(path, dict[str, str])),
    "segment.json": (asdict(SEGMENT), lambda path: SegmentRecord.read(path.parent)),
    "settle.json": (asdict(SETTLED), lambda path: SettleRecord.read(path.parent)),
    "walls.json": (asdict(WALLS), lambda path: WallRecord.read(path.parent)),
    "manifest.json": (MANIFEST, lambda path: read_manifest(path.parent)),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_json(tmp_path: Path, fuzz_inputs: int, name: str) -> None:
    content, read = FILES[name]
    (tmp_path / "case.yaml").write_text("name: hopper\n")
    sources = [json.dumps(content).encode(), json.dumps(content, indent=1).encode()]
    refused = check_all(
        tmp_path / name.partition(" ")[0], inputs(SEED, sources, (*TEXT, nest), fuzz_inputs), read, DataError
    )
    assert 0.1 * fuzz_inputs < refused


def nest(rng: random.Random, data: bytes) -> bytes:
    """Deeper than a parser may recurse."""
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((b"[", b'{"a":')) * rng.choice((100, 10_000)) + data[at:]


READERS: dict[str, Callable[[Path], object]] = {
    "case": read_case,
    "sweep": read_sweep,
    "cluster": read_profile,
    "field": Field.load,
    "json": read_json,
    "dump": lambda path: list(read_dumps([path])),
    "wall contacts": read_wall_contacts,
}


@pytest.mark.parametrize("kind", ["folder", "pipe", "device", "socket", "missing", "no name"])
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, reader: str, kind: str) -> None:
    path = tmp_path / kind
    with contextlib.ExitStack() as stack:
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "socket":
            stack.enter_context(socket.socket(socket.AF_UNIX)).bind(str(path))
        elif kind == "folder":
            path.mkdir()
        path = {"device": Path("/dev/zero"), "no name": Path("a\0b")}.get(kind, path)
        next_one = stack.enter_context(bounded())
        next_one()
        signal.alarm(20)
        try:
            with pytest.raises(GranpipeError):
                READERS[reader](path)
        finally:
            signal.alarm(0)


def test_a_gigabyte_of_empty_lines_is_refused_in_little_time_and_memory(tmp_path: Path) -> None:
    path = tmp_path / "dump.gz"
    block = gzip.compress(b"\n" * 10**7)
    path.write_bytes(gzip.compress(text_snapshot(0, BOX, spheres(3))) + 100 * block)
    with bounded() as next_one:
        next_one()
        with pytest.raises(DataError):
            list(read_dumps([path]))
