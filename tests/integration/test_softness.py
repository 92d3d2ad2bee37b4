"""The packing that a soft run reports is that of a stiff one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from fakes.runs import run

from granpipe.case.reader import read_case

pytestmark = [pytest.mark.liggghts, pytest.mark.slow]

SHAFT = """\
name: shaft
outline: {unit: mm, wall: [[30, 30], [30, 0]]}
material:
  density: 2500 kg/m^3
  size: {diameter: {normal: {mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}, classes: 3}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 0.1 kg/s
model: dem
dem: {max_time: 0.4 s, plate_speed: 0.03 m/s, reservoir_height: 30 mm, ranks: 1}
export: []
figures: []
"""


def figures(folder: Path, modulus: str) -> dict[str, Any]:
    """The measured figures of the shaft with particles of this Young's modulus."""
    (folder / "shaft.yaml").write_text(SHAFT)
    changes = {"contact.youngs_modulus": modulus}
    outcome, _ = run(read_case(folder / "shaft.yaml", changes), folder / "results")
    data: dict[str, Any] = json.loads((outcome.folder / "provenance.json").read_text())
    return data["figures"]


def test_a_soft_run_has_the_packing_of_a_stiff_one(tmp_path: Path) -> None:
    soft, stiff = figures(tmp_path, "1e6"), figures(tmp_path, "1.6e7")
    as_simulated = [run["bulk_packing"] / run["overlap_correction"] for run in (soft, stiff)]
    assert as_simulated[0] > 1.015 * as_simulated[1]
    assert soft["bulk_packing"] == pytest.approx(stiff["bulk_packing"], rel=0.013)
    assert soft["bulk_density_kg_per_m3"] == pytest.approx(2500 * soft["bulk_packing"])
