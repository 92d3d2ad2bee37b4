"""A run without a field leaves its story, and nothing takes that for results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import granpipe
from granpipe.case.reader import read_case
from granpipe.cli import main
from granpipe.dem import health
from granpipe.errors import DataError
from granpipe.pipeline import dem_field
from granpipe.pipeline.failure import NoFieldError
from granpipe.pipeline.run import run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts


def test_a_run_without_a_field_keeps_its_story_beside_the_results(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = tmp_path / "results"
    short = {"dem.max_time": "0.6 s", "homogenize.start": "0.1 s"}
    with monkeypatch.context() as faulty:

        def refuse(*_: object) -> None:
            raise DataError("the filling changes too fast")

        faulty.setattr(dem_field, "steady_segments", refuse)
        with pytest.raises(NoFieldError, match=r"changes too fast; .*max_time: .* s more.*; report and pictures in"):
            run_case(read_case(tiny, short), results, Silent())
    kept = results / "tiny.failed"
    names = {path.relative_to(kept).as_posix() for path in kept.rglob("*") if path.is_file()}
    assert {
        "report.html",
        "level_flow.csv",
        "figures/level_flow.png",
        "figures/raw_average.png",
        "failure.json",
    } <= names
    assert '<p class="verdict failed"><b>Failed.</b> There is no field: ' in (kept / "report.html").read_text()
    assert json.loads((kept / "failure.json").read_text())["cause"] in ("short", "arch", "feed")
    assert not (results / "tiny").exists()
    with pytest.raises(DataError):
        granpipe.load_result(kept)
    for command in (
        ["scale", str(kept), "--flow", "1 kg/s", "--out", str(tmp_path / "out")],
        ["compare", str(kept), str(kept)],
    ):
        answer = CliRunner().invoke(main, command)
        assert answer.exit_code in (2, 3), answer.output
    assert not (tmp_path / "out").exists()

    (kept / "mine.txt").write_text("kept")
    run_case(read_case(tiny, short), results, Silent())
    assert (results / "tiny" / "field.npz").is_file()
    assert [path.name for path in kept.iterdir()] == ["mine.txt"]


def test_a_run_that_an_arch_stops_keeps_its_story_too(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit is raised so far that an ordinary flow counts as blocked."""
    monkeypatch.setattr(health, "ARCH_FLOW", 10.0)
    monkeypatch.setattr(health, "ARCH_TRAVEL", 0.3)
    results = tmp_path / "results"
    told = r"imposed flow has passed the outlet.*arch holds.*since .* s; report and pictures in .*tiny\.failed\n"
    with pytest.raises(NoFieldError, match=told) as caught:
        run_case(read_case(tiny), results, Silent())
    kept = results / "tiny.failed"
    assert json.loads((kept / "failure.json").read_text())["cause"] == "arch"
    assert (kept / "figures" / "level_flow.png").is_file()
    assert (kept / "figures" / "raw_average.png").is_file()
    assert caught.value.evidence is not None
    assert list(caught.value.evidence.glob("snapshot.*.bin"))
