"""Attacks that are cheap and typical end in what is right; all of them: ``python -m attacks`` in benchmarks/."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from attacks import MODULES
from attacks.attack import Attack, Ran, Right, judge, marked, preload, refused, right, told, try_attack

PINNED = [one for name in MODULES for one in importlib.import_module(f"attacks.{name}").attacks() if one.pinned]


@pytest.fixture(scope="module", autouse=True)
def _preloaded() -> None:
    preload()


@pytest.mark.parametrize("attack", PINNED, ids=lambda one: f"{one.kind}: {one.name}")
def test_what_is_attacked_holds(attack: Attack, tmp_path: Path) -> None:
    outcome = try_attack(attack, tmp_path / "attack")
    assert outcome.held, f"{outcome.verdict}: {outcome.why}"


@pytest.mark.parametrize(
    ("what", "status", "output", "verdict"),
    [
        (refused("axis"), 2, "the wall meets the axis", "refused"),
        (refused("axis"), 2, "no", "UNCLEAR"),
        (refused(), 0, "", "WRONG"),
        (refused(), 1, "", "TRACEBACK"),
        (refused(), 2, "Traceback (most recent call last):", "TRACEBACK"),
        (refused(), None, "", "HANG"),
        (marked(), 4, "", "marked"),
        (marked(), 0, "", "WRONG"),
        (told("unit"), 0, "note: the unit?", "told"),
        (told("unit"), 0, "", "WRONG"),
        (right(lambda *_: ""), 0, "", "right"),
        (right(lambda *_: "twice as fast"), 0, "", "WRONG"),
        (right(lambda *_: str(1 / 0)), 0, "", "WRONG"),
        (right(lambda *_: ""), 0, "x.py:3: RuntimeWarning: divide by zero", "WARNING"),
        (right(lambda *_: ""), 4, "", "UNCLEAR"),
    ],
)
def test_an_attack_is_judged_by_what_was_stated(what: Right, status: int | None, output: str, verdict: str) -> None:
    assert judge(what, Path(), Ran(status, output))[0] == verdict
