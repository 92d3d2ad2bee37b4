"""All cases; running their pieces, each resumable; the files of results that the page is made from."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from granpipe.system.jsonfile import read_json, write_json
from validation import (
    article,
    beverloo,
    dosta,
    error_bars,
    hoppers,
    janssen,
    monte_carlo,
    other_code,
    other_surface,
    pebble_bed,
    repose,
)
from validation.case import Case, Data

BENCHMARKS = Path(__file__).resolve().parents[1]

CASES: tuple[Case, ...] = (
    monte_carlo.CASE,
    error_bars.CASE,
    other_code.CASE,
    other_surface.CASE,
    beverloo.CASE,
    beverloo.SPREADING,
    dosta.CASE,
    janssen.CASE,
    pebble_bed.CASE,
    repose.CASE,
    hoppers.CASE,
    article.CASE,
)
"""In the order of the page."""

DATA_OF = {beverloo.SPREADING.name: beverloo.CASE.name}
"""Cases that judge the results of another one."""


def run_piece(case: Case, piece: str, results: Path, data: Path) -> None:
    """Run a piece and keep what it found, unless it was found before; the time of runs that were stopped counts."""
    path = data / f"{case.name}.json"
    if piece in stored(path):
        return
    print(f"{case.name}: {piece}", flush=True)
    folder, spent = results / case.name, results / case.name / f"{piece}.seconds.json"
    folder.mkdir(parents=True, exist_ok=True)
    earlier = stored(spent)
    began, worked = time.perf_counter(), processor_seconds()
    times: dict[str, float] = {}
    try:
        values = case.pieces[piece](folder)
    finally:
        times["seconds"] = round(earlier.get("seconds", 0.0) + time.perf_counter() - began, 1)
        times["processor_seconds"] = round(earlier.get("processor_seconds", 0.0) + processor_seconds() - worked, 1)
        write_json(spent, times)
    data.mkdir(parents=True, exist_ok=True)
    made = {"made": f"{datetime.now(UTC):%Y-%m-%d}"}
    write_json(path, stored(path) | {piece: made | times | {"found": values}})


def processor_seconds() -> float:
    """Processor time of this process and of those that it has started and seen to their end."""
    each = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in each)


def run_together(pieces: Sequence[tuple[Case, str]], jobs: int, results: Path, data: Path) -> list[str]:
    """Run several cases at a time, each in a process of its own, its pieces one after the other; names of failed ones.

    Cases of many pieces begin first, so that none of them is left for the end. What a case prints goes to
    RESULTS/NAME.log.
    """
    names: dict[str, list[str]] = {}
    for case, piece in pieces:
        names.setdefault(case.name, []).append(piece)
    names = dict(sorted(names.items(), key=lambda item: -len(item[1])))
    results.mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join([str(BENCHMARKS), os.environ.get("PYTHONPATH", "")])

    def run(name: str) -> int:
        chosen = [option for piece in names[name] for option in ("--piece", piece)]
        places = ("--results", str(results), "--data", str(data))
        began = time.perf_counter()
        with (results / f"{name}.log").open("a") as log:
            command = [sys.executable, "-m", "validation", "run", "--only", name, *chosen, *places]
            status = subprocess.run(
                command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": paths}
            ).returncode
        words = f"done, {(time.perf_counter() - began) / 60:.1f} min" if status == 0 else f"failed: {log.name}"
        print(f"{name}: {words}", flush=True)
        return status

    with ThreadPoolExecutor(jobs) as pool:
        return [name for name, status in zip(names, pool.map(run, names), strict=True) if status]


def stored(path: Path) -> dict[str, Any]:
    """What a file of results holds: piece → made, seconds, found."""
    return dict(read_json(path)) if path.exists() else {}


def results_of(case: Case, data: Path) -> tuple[Data, dict[str, Any]]:
    """What the pieces of a case have found, in their order, and when and in what time."""
    kept = stored(data / f"{DATA_OF.get(case.name, case.name)}.json")
    owner = next(one for one in CASES if one.name == DATA_OF.get(case.name, case.name))
    kept = {piece: kept[piece] for piece in owner.pieces if piece in kept}
    return {piece: one["found"] for piece, one in kept.items()}, kept


def wanted(names: Sequence[str], short: bool) -> list[tuple[Case, str]]:
    """Pieces of the cases of some names (none: of all), or their short forms."""
    unknown = set(names) - {case.name for case in CASES}
    if unknown:
        raise ValueError(f"no such case: {', '.join(sorted(unknown))}; there are {', '.join(c.name for c in CASES)}")
    return [
        (case, piece)
        for case in CASES
        if not names or case.name in names
        for piece in (case.short if short else case.pieces)
    ]
