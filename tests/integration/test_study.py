"""A study of a real scene: points run, compared, reported; afterwards there is nothing left to run."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.study.points import make_study
from granpipe.study.report import read_study
from granpipe.sweep.points import plan_points

SMOKE = Path(__file__).parents[2] / "cases" / "smoke.yaml"
HOURS = 0.00127  # enough for the case and the faster of two plates
ARGUMENTS = [
    "study", str(SMOKE), "--axis", "plate_speed", "--hours", str(HOURS), "--cores", "2",
    "--set", "dem.max_time=1.8 s", "--set", "homogenize.start=0.4 s",
]  # fmt: skip


def granpipe(folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "granpipe", *ARGUMENTS, *more]
    environment = os.environ | {"XDG_CACHE_HOME": str(folder)}  # forecasts as if this machine had not been measured
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=300, env=environment
    )


@pytest.mark.liggghts
def test_a_study_runs_its_points_and_tells_error_against_time(tmp_path: Path) -> None:
    first = granpipe(tmp_path)
    assert first.returncode == 0, first.stderr
    folder = tmp_path / "results" / "smoke-study"
    options = read_study(folder / "study.json").options
    points = {option.point for option in options}
    assert points == {"base", "plate_speed-0_052"}  # the slow one is too dear
    assert "left out: plate_speed-0_013" in first.stderr
    for option in options:
        assert option.seconds > 0
        assert 0 < option.statistical["whole"] < 1
        assert option.error().value <= option.error().upper
    whole = max((o for o in options if o.point == "base" and o.method == "psi"), key=lambda o: o.travel)
    assert whole.travel == pytest.approx(1.4 * 0.026 / 0.15, rel=0.15)  # averaging time × plate speed over the outlet
    with (folder / "points.csv").open(newline="") as file:
        assert {row["point"] for row in csv.DictReader(file)} == points
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "Recommended settings" in page

    counted = granpipe(tmp_path, "--reference", "results/smoke-study/points/plate_speed-0_052")
    assert counted.returncode == 0, counted.stderr
    found = {(one.point, one.method): one for one in read_study(folder / "study.json").options}
    assert found["base", "psi"].systematic["whole"].upper > 0
    assert found["plate_speed-0_052", "psi"].systematic == found["reference", "psi"].systematic  # the same run
    assert found["reference", "psi"].core_seconds > 0
    assert "an earlier run, results/smoke-study/points/plate_speed-0_052" in (folder / "report.md").read_text()

    case = load_case(SMOKE, dict(text.split("=") for text in ARGUMENTS if "=" in text))
    root, missing = plan_points(make_study(case, HOURS, 2, {"plate_speed": []}).sweep(), tmp_path / "results")
    assert root.root == folder
    assert not missing
