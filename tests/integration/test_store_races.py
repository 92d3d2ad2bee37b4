"""Many processes at one store: every artefact is whole, made once, and made by another where its maker was killed."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import time
from pathlib import Path

from granpipe.system.store import Store

RACES = 1000
PROCESSES = 6
PARTS = 3

context = multiprocessing.get_context("fork")


def make(root: Path, race: int) -> Path:
    """One stage of several files that belong together; every making of it is noted outside of the store."""

    def work(folder: Path) -> None:
        with (root / f"made-{race}").open("a") as notes:
            notes.write(f"{os.getpid()}\n")
        for part in range(PARTS):
            (folder / f"part-{part}").write_text(f"{race} {os.getpid()}\n" * 50)

    return Store(root / "store", waiting=lambda _: None).make("walls", f"{race:04d}", work)


def is_whole(folder: Path, race: int) -> bool:
    """All its files are there, complete, and of one maker."""
    texts = [path.read_text() for path in folder.glob("part-*")]
    return len(texts) == PARTS and len(set(texts)) == 1 and texts[0].count(f"{race} ") >= 50


def take_part(root: Path, number: int) -> None:
    """Make every stage in an order of one's own, near that of the others."""
    chance = random.Random(number)
    races = sorted(range(RACES), key=lambda race: race + chance.uniform(0, 8))
    broken = [race for race in races if not is_whole(make(root, race), race)]
    (root / f"broken-{number}").write_text(repr(broken))


def test_a_thousand_races_leave_no_corrupt_artefact(tmp_path: Path) -> None:
    racers = [context.Process(target=take_part, args=(tmp_path, number)) for number in range(PROCESSES)]
    for racer in racers:
        racer.start()
    for racer in racers:
        racer.join(120)
        assert racer.exitcode == 0
    assert {(tmp_path / f"broken-{number}").read_text() for number in range(PROCESSES)} == {"[]"}
    made = [(tmp_path / f"made-{race}").read_text().split() for race in range(RACES)]
    assert {len(makers) for makers in made} == {1}
    assert len({makers[0] for makers in made}) > 1  # it was a race
    left = {path.name for path in (tmp_path / "store").iterdir() if not path.name.endswith(".lock")}
    assert left == {f"walls-{race:04d}" for race in range(RACES)}


def test_who_waits_takes_over_where_the_maker_is_killed(tmp_path: Path) -> None:
    def slow(folder: Path) -> None:
        (folder / "half").write_text("half")
        time.sleep(60)

    first = context.Process(target=lambda: Store(tmp_path).make("walls", "k", slow))
    first.start()
    while not list(tmp_path.glob(".walls-k.*.part/half")):
        time.sleep(0.01)
    told: list[str] = []

    def kill_it(message: str) -> None:
        told.append(message)
        assert first.pid is not None
        os.kill(first.pid, signal.SIGKILL)

    made = Store(tmp_path, waiting=kill_it).make("walls", "k", lambda folder: (folder / "whole").touch())
    assert {path.name for path in made.iterdir()} == {"manifest.json", "stage.json", "whole"}
    assert len(told) == 1
    assert f"process {first.pid}" in told[0]
    first.join()
