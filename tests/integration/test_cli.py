"""The command line as a user meets it: one clear message, the right exit status, no traceback, nothing half-done."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

COMMAND = [sys.executable, "-m", "granpipe"]


def granpipe(*arguments: str | Path, cwd: Path, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=120, check=False)


def changed(path: Path, **changes: object) -> Path:
    """The case with dotted keys (written with __) replaced."""
    data = yaml.safe_load(path.read_text())
    for key, value in changes.items():
        place = data
        *parents, last = key.split("__")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    path.write_text(yaml.safe_dump(data))
    return path


BAD = {
    "typo": ({"materials": {}}, "did you mean `material`"),
    "negative size": ({"material__size": {"diameter": "-2 cm"}}, "material.size.diameter"),
    "absurd density": ({"material__density": "1e9"}, "material.density"),
    "crossing the axis": ({"outline__wall": [[6, 10], [-1, 0]]}, "outline.wall"),
    "obstacle outside": ({"outline__obstacles": {"x": [[7, 4], [8, 4], [8, 5]]}}, "outline.obstacles.x"),
    "particles too large": ({"material__size": {"diameter": "5 cm"}}, "times the particles' d90"),
    "restitution": ({"contact__restitution": 1.3}, "contact.restitution"),
    "unit": ({"flow_rate": "3 parsec"}, "flow_rate"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_case_is_refused_with_its_place(tiny: Path, name: str) -> None:
    changes, words = BAD[name]
    done = granpipe("run", changed(tiny, **changes), cwd=tiny.parent)
    assert done.returncode == 2
    assert words in done.stderr
    assert "tiny.yaml:" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tiny.parent / "results" / "tiny").exists()


def test_a_self_crossing_obstacle_is_refused(tiny: Path) -> None:
    done = granpipe("check", changed(tiny, outline__obstacles={"x": [[1, 4], [2, 5], [2, 4], [1, 5]]}), cwd=tiny.parent)
    assert done.returncode == 2
    assert "outline.obstacles.x" in done.stderr


def test_a_missing_case_is_one_sentence(tmp_path: Path) -> None:
    done = granpipe("run", "nothing.yaml", cwd=tmp_path)
    assert done.returncode in (2, 3)
    assert "nothing.yaml" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_without_liggghts_the_remedy_is_named(tiny: Path) -> None:
    done = granpipe("run", tiny, cwd=tiny.parent, env=os.environ | {"PATH": "/nonexistent"})
    assert done.returncode == 3
    assert "apt-get install --no-install-recommends liggghts" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_results_folder_of_somebody_else_is_not_touched(tiny: Path) -> None:
    own = tiny.parent / "results" / "h"
    own.mkdir(parents=True)
    (own / "thesis.txt").write_text("years of work")
    hopper = Path(__file__).parents[2] / "cases" / "hopper.yaml"
    done = granpipe("run", hopper, "--set", "name=h", "--set", "figures=[]", cwd=tiny.parent)
    assert done.returncode == 3
    assert (own / "thesis.txt").read_text() == "years of work"
    assert "fluid" not in done.stderr  # it is refused before the work


def test_a_results_folder_that_cannot_be_made_is_one_sentence(tiny: Path) -> None:
    (tiny.parent / "results").write_text("a file, not a folder")
    done = granpipe("run", tiny, cwd=tiny.parent)
    assert done.returncode == 3
    assert "results" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("homogenize", "none.dump", "--cell", "1cm", "--time-step", "1", "--out", "x"), "none.dump: no such file"),
        (("homogenize", ".", "--cell", "1cm", "--time-step", "1", "--out", "x"), "a folder; give the files"),
        (
            ("homogenize", "a.dump", "--cell", "1cm", "--time-step", "1e300", "--out", "x"),
            "1e+300 s is no time step of a particle simulation",
        ),
        (("compare", "none", "none"), "none: no such folder; pass the results folder of a completed run"),
        (("scale", "none", "--flow", "1 kg/h", "--out", "x"), "none is not a results folder"),
        (("study", "tiny.yaml", "--hours", "nan"), "must be above 0"),
        (("run", "tiny.yaml", "--total-error", "0"), "must be above 0"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_what_is_not_there_or_wrong_is_one_sentence(tiny: Path, words: tuple[str, ...], told: str) -> None:
    done = granpipe(*words, cwd=tiny.parent)
    assert done.returncode in (2, 3)
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_cleaning_nothing_says_so(tmp_path: Path) -> None:
    assert "nothing to do" in granpipe("clean", cwd=tmp_path).stdout


def test_a_truncated_dump_is_refused_with_the_byte(tmp_path: Path) -> None:
    header = struct.pack("<qqi6i6dii", 0, 10, 0, *[1] * 6, *[0.0, 1.0] * 3, 9, 1)
    (tmp_path / "a.bin").write_bytes(header + struct.pack("<i", 90) + bytes(100))
    done = granpipe("homogenize", "a.bin", "--cell", "0.1", "--time-step", "1e-5", "--out", "field", cwd=tmp_path)
    assert done.returncode == 3
    assert "a.bin" in done.stderr
    assert "byte" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "field").exists()


def test_set_without_a_value_says_how_to_write_it(tiny: Path) -> None:
    done = granpipe("plan", tiny, "--set", "dem.seed", cwd=tiny.parent)
    assert done.returncode == 2
    assert "--set key=value" in done.stderr


def test_the_starter_case_can_be_planned_at_once(tmp_path: Path) -> None:
    assert granpipe("init", "case.yaml", cwd=tmp_path).returncode == 0
    again = granpipe("init", "case.yaml", cwd=tmp_path)
    assert again.returncode == 3
    assert "exists already" in again.stderr
    plan = granpipe("plan", "case.yaml", cwd=tmp_path)
    assert plan.returncode == 0
    assert "particles" in plan.stdout


def test_the_schema_is_json(tmp_path: Path) -> None:
    assert json.loads(granpipe("schema", cwd=tmp_path).stdout)["type"] == "object"


def test_the_hopper_runs_without_dem_and_without_pyvista(tmp_path: Path) -> None:
    hopper = Path(__file__).parents[2] / "cases" / "hopper.yaml"
    code = (
        "import sys; from granpipe.cli import main\n"
        f"try: main(['run', {str(hopper)!r}])\n"
        "finally: print(sorted(m for m in ('pyvista', 'vtkmodules', 'pint', 'jinja2') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "['jinja2']"  # of the COMSOL set-up file
    assert (tmp_path / "results" / "hopper" / "comsol" / "psi_grid.txt").is_file()
    assert not list((tmp_path / "results").glob(".store/produce-*"))


def test_dumps_need_no_case_and_two_lone_spheres_are_marked_as_no_bed(tmp_path: Path) -> None:
    for step in (0, 100):
        fallen = 0.1 * step * 1e-4
        rows = [(1, 1, 0.0, 0.0, 0.05 - fallen, 0, 0, -0.1, 0.01), (2, 1, 0.03, 0.0, 0.02 - fallen, 0, 0, -0.1, 0.01)]
        body = b"".join(struct.pack("<9d", *row) for row in rows)
        header = struct.pack("<qqi6i6dii", step, len(rows), 0, *[1] * 6, *[0.0, 1.0] * 3, 9, 1)
        (tmp_path / f"d.{step}.bin").write_bytes(header + struct.pack("<i", 9 * len(rows)) + body)
    arguments = ["d.0.bin", "d.100.bin", "--cell", "5 mm", "--time-step", "1e-4", "--out", "field"]
    done = granpipe("homogenize", *arguments, cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    assert "quality gate failed: reference packing" in done.stderr
    assert (tmp_path / "field" / "field.npz").is_file()
    assert granpipe("homogenize", *arguments, cwd=tmp_path).returncode == 3  # the folder exists
