"""`granpipe outline`: what it prints is an outline that a case can use, and the picture is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import yaml
from fakes.drawings import write_dxf

WALL = [(1000, 5900), (1000, 4900), (500, 3900), (500, 3400)]


def outline(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "granpipe", "outline", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_what_is_printed_can_be_pasted_into_a_case(tmp_path: Path) -> None:
    done = outline(write_dxf(tmp_path / "silo.dxf", [("wall", WALL, False)], insunits=4))
    assert done.returncode == 0, done.stderr
    assert yaml.safe_load(done.stdout)["outline"] == {"unit": "mm", "wall": [list(map(float, one)) for one in WALL]}
    assert (tmp_path / "silo.dxf.outline.png").stat().st_size > 10_000
    # shaft, cone frustum and throat, by hand
    volume = 3.141592653589793 * (1.0 + (1.0 + 0.5 + 0.25) / 3 + 0.25 * 0.5)
    assert f"volume    {volume:.6g} m³" in done.stderr


def test_a_drawing_without_a_unit_is_refused_and_a_mass_is_none(tmp_path: Path) -> None:
    file = write_dxf(tmp_path / "silo.dxf", [("wall", WALL, False)])
    assert (outline(file).returncode, "outline.unit" in outline(file).stderr) == (2, True)
    refused = outline(file, "--unit", "kg")
    assert (refused.returncode, "must be a length unit" in refused.stderr) == (2, True)
