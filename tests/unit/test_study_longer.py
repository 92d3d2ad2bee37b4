"""Points of a study that end without a field: which of them go on, for how long, and that a study ends."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.progress import Silent
from granpipe.study import run
from granpipe.study.longer import lengthened
from granpipe.study.points import Study, make_study
from granpipe.sweep.file import Sweep
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import Point, point_case
from granpipe.sweep.state import INTERRUPTED, State

SMOKE = Path(__file__).parents[2] / "cases" / "smoke.yaml"
FASTER = {"dem.plate_speed": "0.03", "dem.max_time": "4 s"}
REASON = "the filling changes too fast"


@pytest.fixture(scope="module")
def study() -> Study:
    """The smoke scene for 8 s, and a faster plate for 4 s."""
    return make_study(load_case(SMOKE), 1.0, 2, points=[FASTER])


def times(sweep: Sweep) -> list[float]:
    folder = Folder(Path("nowhere"), sweep.inputs)
    return [float(point_case(folder, name).case.dem.max_time) for name in folder.variants]


def leave(sweep: Sweep, results: Path, name: str, **state: str) -> Folder:
    """Leave a point's folder and state as a run leaves them."""
    folder = Folder(results / sweep.name, sweep.inputs)
    (folder.root / "state").mkdir(parents=True, exist_ok=True)
    folder.inputs.write(folder.root)
    replace(State.begins(folder.key(name)), **state).save(folder.state_file(name))  # type: ignore[arg-type]
    return folder


def fails(
    sweep: Sweep, results: Path, name: str = "base", cause: str = "short", error: str = f"{REASON}; try", told: str = ""
) -> None:
    """Leave a point as a run without a field leaves it."""
    folder = leave(sweep, results, name, phase="failed", error=error)
    failed = folder.points / f"{name}.failed"
    failed.mkdir(parents=True, exist_ok=True)
    (failed / "failure.json").write_text(json.dumps({"reason": told or REASON, "cause": cause, "text": "…"}))


def test_a_point_that_is_too_short_goes_on_by_an_eighth_and_the_others_stay(study: Study, tmp_path: Path) -> None:
    assert times(lengthened(study.sweep(), tmp_path, Silent())) == [8, 4]
    fails(study.sweep(), tmp_path)
    assert times(lengthened(study.sweep(), tmp_path, Silent())) == [9, 4]
    fails(study.sweep(), tmp_path, name=study.variants[1].variant.name)
    assert times(lengthened(study.sweep(), tmp_path, Silent())) == [9, 4.5]


def test_in_all_it_goes_on_by_a_half(study: Study, tmp_path: Path) -> None:
    sweep, found = study.sweep(), []
    for _ in range(6):
        fails(sweep, tmp_path)
        sweep = lengthened(study.sweep(), tmp_path, Silent())
        found.append(times(sweep)[0])
    assert found == [9, 10, 11, 12, 12, 12]


@pytest.mark.parametrize(("blocks", "time"), [(6, 9), (7, 8)])
def test_a_field_without_an_error_bar_is_too_short(study: Study, tmp_path: Path, blocks: int, time: float) -> None:
    folder = leave(study.sweep(), tmp_path, "base", phase="done")
    results = folder.points / "base"
    results.mkdir(parents=True)
    told = {"case": "base", "wall_seconds": 1.0, "quality": [], "figures": {"blocks": blocks}}
    (results / "provenance.json").write_text(json.dumps(told))
    assert times(lengthened(study.sweep(), tmp_path, Silent())) == [time, 4]


@pytest.mark.parametrize(
    "failure",
    [
        {"cause": "arch"},
        {"cause": "feed"},
        {"error": INTERRUPTED},
        {"error": "LIGGGHTS was killed"},
        {"told": "another reason, of a run before"},
    ],
)
def test_what_time_alone_does_not_mend_is_left(study: Study, tmp_path: Path, failure: dict[str, str]) -> None:
    fails(study.sweep(), tmp_path, **failure)
    assert lengthened(study.sweep(), tmp_path, Silent()).inputs == study.sweep().inputs


def test_what_went_on_stays_longer_and_another_case_begins_anew(study: Study, tmp_path: Path) -> None:
    fails(study.sweep(), tmp_path)
    longer = lengthened(study.sweep(), tmp_path, Silent())
    leave(longer, tmp_path, "base", phase="done")
    assert times(lengthened(study.sweep(), tmp_path, Silent())) == [9, 4]
    other = make_study(load_case(SMOKE, {"dem.max_time": "6 s"}), 1.0, 2, points=[FASTER])
    assert times(lengthened(other.sweep(), tmp_path, Silent())) == [6, 4]


def test_a_folder_whose_time_is_damaged_is_no_reason_to_go_on(study: Study, tmp_path: Path) -> None:
    fails(study.sweep(), tmp_path)
    path = tmp_path / study.name / "points.json"
    points = json.loads(path.read_text())
    points["points"][0]["changes"]["dem.max_time"] = "soon"
    path.write_text(json.dumps(points))
    assert lengthened(study.sweep(), tmp_path, Silent()).inputs == study.sweep().inputs


@dataclass
class Burst:
    """In the place of what runs the points: the case has no field before a time [s], the other point never."""

    over: float
    runs: list[float] = field(default_factory=list)
    others: int = 0

    def __call__(self, folder: Folder, points: Sequence[Point], *_: object) -> bool:
        self.others += len(points) - 1
        sweep = Sweep(folder.name, folder.inputs, "smoke", None)  # type: ignore[arg-type]
        self.runs.append(times(sweep)[0])
        if self.runs[-1] < self.over:
            fails(sweep, folder.root.parent)
        else:
            leave(sweep, folder.root.parent, "base", phase="done")
        return True


@pytest.mark.parametrize(("over", "runs"), [(7, [8]), (9.5, [8, 9, 10]), (20, [8, 9, 10, 11, 12])])
def test_a_study_goes_on_until_its_case_has_a_field_or_its_time_is_over(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, over: float, runs: list[float]
) -> None:
    burst = Burst(over)
    monkeypatch.setattr(run, "run_missing", burst)
    monkeypatch.setattr(run, "report_study", lambda *_: ([Path("report.html")], []))
    assert run.run_study(study, tmp_path, None, 2, None, Silent()).complete
    assert burst.runs == runs
    assert burst.others == 1  # what fails for another reason is not tried again and again
