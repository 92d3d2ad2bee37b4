"""The stability suite on the real LIGGGHTS: a few rows here, all of them in make verify."""

from __future__ import annotations

from pathlib import Path

import pytest
from stability.rows import rows, subset
from stability.suite import run_suite, write_page

from granpipe.progress import Silent
from granpipe.system.cores import usable_cores

pytestmark = pytest.mark.liggghts


@pytest.mark.slow
def test_granpipes_word_is_true_in_a_few_rows_and_rows_are_not_repeated(tmp_path: Path) -> None:
    few = subset(rows())
    judged = run_suite(few, tmp_path, usable_cores(), Silent())
    assert [one.wrong for one in judged] == [""] * len(few)
    assert {one.verdict for one in judged} >= {"done", "stopped", "refused"}
    assert any(not one.stable for one in judged)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/*.json")}
    run_suite(few, tmp_path, usable_cores(), Silent())
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/*.json")} == before
    text = write_page(judged, tmp_path, tmp_path / "docs").read_text()
    assert text.count("\n| column |") == len(few)
    assert (tmp_path / "docs/images/stability.png").stat().st_size > 10_000


@pytest.mark.slow
def test_granpipes_word_is_true_in_every_row(tmp_path: Path) -> None:
    judged = run_suite(rows(), tmp_path, usable_cores(), Silent())
    assert {one.row.name: one.wrong for one in judged if one.wrong} == {}
