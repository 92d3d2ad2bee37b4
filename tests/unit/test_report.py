"""One page that needs nothing beside itself."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import pytest

from granpipe.errors import DataError
from granpipe.export.report import Section, markdown, write_page, write_run_report

PICTURE = b"\x89PNG not really"


def page(tmp_path: Path, *sections: Section) -> str:
    write_page(tmp_path / "page.html", "A < B", ["text"], sections)
    return (tmp_path / "page.html").read_text()


def test_pictures_are_inside(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(PICTURE)
    text = page(tmp_path, Section("Chart", figures=[tmp_path / "a.png"]))
    (inside,) = re.findall(r'src="data:image/png;base64,([A-Za-z0-9+/=]+)"', text)
    assert base64.b64decode(inside) == PICTURE
    assert not re.search(r'(?:src|href)="(?!data:)', text)


def test_text_of_the_user_is_no_markup(tmp_path: Path) -> None:
    text = page(tmp_path, Section("<script>", ["<b>"], head=("a",), rows=[("<i>",)]))
    assert "<script>" not in text
    assert "<b>" not in text
    assert "&lt;i&gt;" in text
    assert "A &lt; B" in text


def test_tables_as_markdown() -> None:
    text = markdown([Section("Table", ["words"], head=("a", "b"), rows=[("1", "2")])])
    assert text.splitlines() == ["## Table", "", "words", "", "| a | b |", "|---|---|", "| 1 | 2 |"]


def results(folder: Path) -> Path:
    plan = {
        "model": "dem",
        "stages": [{"stage": "produce", "reason": "it widens"}],
        "warnings": ["narrow"],
        "outside_the_range": [],
        "dem": {"decisions": [{"name": "time_step", "value": "1e-4 s", "criterion": "damping"}]},
    }
    figures = {
        "statistical_error": {"whole": 0.034, "throat": 0.05},
        "produce_wall_seconds": [400.0],
        "averaging_seconds": [3.0],
    }
    provenance = {
        "case": "silo",
        "made": "2026-01-01",
        "granpipe": "0.1",
        "wall_seconds": 410.0,
        "forecast_seconds": 100.0,
        "figures": figures,
        "quality": [{"name": "packing", "value": 0.58, "limit": "0.5 to 0.68", "passed": True}],
    }
    (folder / "plan.json").write_text(json.dumps(plan))
    (folder / "provenance.json").write_text(json.dumps(provenance))
    return folder


def test_the_report_of_a_run_tells_gates_errors_settings_and_times(tmp_path: Path) -> None:
    write_run_report(results(tmp_path))
    text = (tmp_path / "report.html").read_text()
    for wanted in (
        "silo",
        "packing",
        "passed",
        "3.40%",
        "throat",
        "time_step",
        "damping",
        "6 min 40 s",
        "narrow",
        "1 min 40 s",
    ):
        assert wanted in text, wanted


def test_a_damaged_folder_is_told(tmp_path: Path) -> None:
    folder = results(tmp_path)
    (folder / "plan.json").write_text("{}")
    with pytest.raises(DataError, match="damaged"):
        write_run_report(folder)


def test_the_first_words_tell_whether_the_result_is_marked(tmp_path: Path) -> None:
    folder = results(tmp_path)
    provenance = json.loads((folder / "provenance.json").read_text())
    gate = {"name": "packing in the plug", "value": 0.4, "limit": "0.5 to 0.68"}
    for passed, words in (
        (True, "All 1 quality gates passed."),
        (False, "failed 1 of 1 quality gates: packing in the"),
    ):
        provenance["quality"] = [gate | {"passed": passed}]
        (folder / "provenance.json").write_text(json.dumps(provenance))
        write_run_report(folder)
        assert words in (folder / "report.html").read_text()
