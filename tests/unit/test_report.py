"""One page that needs nothing beside itself: verdict first, everything in it escaped, every picture told in words."""

from __future__ import annotations

import base64
import json
import re
import struct
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import yaml
from fakes.results_folder import GATE, results

from granpipe.errors import DataError
from granpipe.export.report import Link, Number, Picture, Section, Verdict, markdown, write_page
from granpipe.export.run_report import CITATION, write_failure_report, write_run_report

ROOT = Path(__file__).parents[2]
PICTURE = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 40, 30) + b"not really"
VOID = {"meta", "img", "br", "link"}


class Page(HTMLParser):
    """Reads a page strictly: every tag closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def page(tmp_path: Path, *sections: Section, **more: Any) -> str:
    write_page(tmp_path / "page.html", "A < B", ["text"], sections, **more)
    return (tmp_path / "page.html").read_text()


def test_pictures_are_inside_with_their_size_and_their_words(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(PICTURE)
    figures = [tmp_path / "a.png", Picture(tmp_path / "a.png", "A caption.", "An <alt>.")]
    text = page(tmp_path, Section("Chart", figures=figures))
    first, second = Page(text).all("img")
    assert base64.b64decode(str(first["src"]).removeprefix("data:image/png;base64,")) == PICTURE
    assert (first["width"], first["height"]) == ("40", "30")
    assert (first["alt"], second["alt"]) == ("Chart", "An <alt>.")
    assert "<figcaption>A caption.</figcaption>" in text


def test_a_page_asks_the_network_for_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(PICTURE)
    text = page(tmp_path, Section("Chart", figures=[tmp_path / "a.png"]))
    assert not re.search(r'(?:src)="(?!data:)|https?:|@import|url\(', text)


def test_text_of_the_user_is_no_markup(tmp_path: Path) -> None:
    hostile = '"><script>alert(1)</script>'
    section = Section(
        hostile, [hostile], head=(hostile,), rows=[(hostile,), (Link(hostile, hostile),)], items=[hostile]
    )
    text = page(tmp_path, section, verdict=Verdict("marked", hostile), numbers=[Number(hostile, hostile, hostile)])
    assert "<script" not in text
    assert "A &lt; B" in text
    Page(text)


def test_a_link_leads_beside_the_page_whatever_the_name_of_the_file(tmp_path: Path) -> None:
    text = page(tmp_path, Section("Files", head=("file",), rows=[(Link("a", "a b/c#d.txt"),)]))
    assert [one["href"] for one in Page(text).all("a")] == ["a%20b/c%23d.txt"]


@pytest.mark.parametrize(("standing", "word"), [("good", "Good."), ("marked", "Marked."), ("failed", "Failed.")])
def test_the_verdict_comes_first(standing: Any, word: str, tmp_path: Path) -> None:
    text = page(tmp_path, Section("More"), verdict=Verdict(standing, "It is so."), numbers=[Number("flow", "1 m³/h")])
    assert f'<p class="verdict {standing}"><b>{word}</b> It is so.</p>' in text
    assert text.index("It is so.") < text.index("1 m³/h") < text.index("<h2")


def test_tables_as_markdown() -> None:
    text = markdown([Section("Table", ["words"], head=("a", "b"), rows=[("1", Link("2", "two.txt"))])])
    assert text.splitlines() == ["## Table", "", "words", "", "| a | b |", "|---|---|", "| 1 | [2](two.txt) |"]


def report(folder: Path) -> str:
    write_run_report(folder)
    return (folder / "report.html").read_text()


def test_the_report_of_a_run_tells_all_that_was_measured(tmp_path: Path) -> None:
    text = report(results(tmp_path))
    Page(text)
    for wanted in (
        "silo",
        "The field passed all 1 quality gates, and its statistical error is 3.4 % (worst section throat: 5 %).",
        "2 notes say what to keep in mind",
        "1 m³/h",
        "1.45 t/h",
        "1450 kg/m³",
        "0.580",
        "2 mm/s",
        "12\u202f345",
        "0.7",
        "3 ± 1 %",
        "6 min 40 s",
        "1 min 40 s",
        "0.25 m² of the half section",
        "time_step",
        "damping",
        "narrow",
        "turned over less than once",
        "DEM covers it",
        'href="comsol/import_comsol.java"',
        "comsol compile",
        "2.4.6",
        CITATION[0],
    ):
        assert wanted in text, wanted


@pytest.mark.parametrize("model", ["fluid", "hybrid"])
def test_the_other_models_tell_what_they_know(model: str, tmp_path: Path) -> None:
    text = report(results(tmp_path, model))
    Page(text)
    assert ("no particle was simulated" in text) == (model == "fluid")
    assert ("Stagnant zones and free surfaces" in text) == (model == "fluid")
    assert ("Turnover is how often" in text) == (model == "hybrid")
    assert ("statistical error, sub-model d" in text) == (model == "hybrid")
    assert ("its statistical error in sub-model d is 3.4 %" in text) == (model == "hybrid")
    assert ("Settings and criteria of sub-model d" in text) == (model == "hybrid")


def test_no_report_calls_particles_without_an_error_bar_a_fluid_without_noise(tmp_path: Path) -> None:
    noiseless = "a fluid has no noise"
    assert noiseless in report(results(tmp_path / "fluid", "fluid"))
    short = report(results(tmp_path / "short", figures={"blocks": 6}))
    assert "too few segments were averaged" in short
    assert noiseless not in short
    dumps = results(tmp_path / "dumps", case=None, sampling="displacement", method="none", figures={})
    (dumps / "plan.json").unlink()
    assert noiseless not in report(dumps)


def test_a_frictional_fluid_is_not_said_to_know_no_free_surfaces(tmp_path: Path) -> None:
    text = report(results(tmp_path, "fluid", figures={"sensitivity": {"whole": 0.1}}))
    assert "a fluid with the friction of the bulk" in text
    assert "Arching, flow in jerks" in text
    assert "moves everywhere" not in text


def test_the_report_of_a_field_in_space_does_not_call_it_a_mean_over_the_turn(tmp_path: Path) -> None:
    assert "the average over the full turn" in report(results(tmp_path))
    assert "the average over the full turn" not in report(results(tmp_path, figures={"conserving_changes": 0.0}))


def test_averaged_dumps_have_a_report_without_a_plan_or_a_case(tmp_path: Path) -> None:
    folder = results(tmp_path, case=None, sampling="displacement", method="none", field={"flow_rate_m3_per_s": 0.01})
    (folder / "plan.json").unlink()
    text = report(folder)
    Page(text)
    assert "<h1>Averaged dumps</h1>" in text
    assert "at the scale of the dumps" in text
    assert "sampled by displacement" in text


def test_a_marked_result_says_so_first_and_why(tmp_path: Path) -> None:
    text = report(results(tmp_path, quality=[GATE, GATE | {"value": 0.4, "passed": False}]))
    told = "The result failed 1 of 2 quality gates: packing in the plug: 0.4, must be 0.5 to 0.68."
    assert f'<p class="verdict marked"><b>Marked.</b> {told}</p>' in text
    assert text.index(told) < text.index("<h2")


def test_a_field_without_gates_is_not_called_good(tmp_path: Path) -> None:
    assert 'class="verdict marked"' in report(results(tmp_path, quality=[]))


@pytest.mark.parametrize("content", ["{}", '{"model": "dem"}', '{"model": []}'])
def test_a_damaged_folder_is_told(content: str, tmp_path: Path) -> None:
    folder = results(tmp_path)
    (folder / "plan.json").write_text(content)
    with pytest.raises(DataError, match="damaged"):
        write_run_report(folder)


def failure(folder: Path, **changes: str) -> Path:
    """What `granpipe run` leaves of a run without a field."""
    results(folder)
    told = {"case": "silo", "run": "silo", "made": "2026-01-01T12:30:01+00:00", "granpipe": "0.1", "versions": {}}
    told |= {"reason": "levels differ", "cause": "arch", "text": "an arch holds the solids up at z = 1 m"}
    (folder / "failure.json").write_text(json.dumps(told | changes))
    return folder


def test_a_failed_run_tells_first_why_and_what_to_do(tmp_path: Path) -> None:
    folder = failure(tmp_path, run="silo-d")
    write_failure_report(folder)
    text = (folder / "report.html").read_text()
    Page(text)
    told = "There is no field: an arch holds the solids up at z = 1 m."
    assert f'<p class="verdict failed"><b>Failed.</b> {told}</p>' in text
    assert text.index(told) < text.index("sub-model silo-d said: levels differ.") < text.index("<h2")
    assert "damping" in text


def test_a_damaged_failure_is_told(tmp_path: Path) -> None:
    folder = failure(tmp_path)
    (folder / "failure.json").write_text("{}")
    with pytest.raises(DataError, match="damaged"):
        write_failure_report(folder)


def test_the_citation_is_that_of_the_citation_file() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["title"], citation["references"][0]["title"]) == CITATION
    assert citation["license"] == "MIT"
    (article,) = citation["references"]
    assert (article["year"], [one["family-names"] for one in article["authors"]]) == (2017, ["Sparta", "Halvorsen"])
