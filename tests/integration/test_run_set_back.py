"""Walls set back for enlarged particles, on the real LIGGGHTS: what is simulated, and what comes out as drawn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import read_snapshot
from granpipe.field import Field, level_flow
from granpipe.pipeline.run import run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts

CASE = """
name: column
outline: {unit: cm, wall: [[6, 10], [6, 0]]}
material: {density: 2000 kg/m^3, size: {diameter: 1 cm}}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 1 kg/s
model: dem
dem: {coarse_grain_factor: 1.6, walls: set_back, max_time: 1.2 s, plate_speed: 0.03 m/s, ranks: 1,
  reservoir_height: 8 cm}
homogenize: {start: 0.4 s}
figures: []
export: [comsol]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("column")
    (folder / "column.yaml").write_text(CASE)
    run_case(read_case(folder / "column.yaml"), folder / "results", Silent())
    return folder / "results"


def test_particles_lie_between_the_walls_set_back(results: Path) -> None:
    (last,) = sorted(results.glob(".store/produce-*/segment-*/snapshot.bin"))[-1:]
    bed = read_snapshot(last, DUMP_COLUMNS)
    r = np.hypot(bed.position[:, 0], bed.position[:, 1])
    assert np.unique(bed.radius) == pytest.approx([0.008])
    # 6.5 mm from the drawn wall, but for soft contacts and flat facets: the mean of 8 mm and the material's 5 mm
    assert r.max() == pytest.approx(0.0535, abs=0.0016)


def test_the_field_is_that_of_the_vessel_as_drawn_with_its_whole_flow(results: Path) -> None:
    field = Field.load(results / "column" / "field.npz")
    assert field.grid.r_edges[-1] == pytest.approx(0.06, abs=field.grid.cell)
    flow = level_flow(field.flux_z, field.grid) * field.flow_scale
    assert flow * 2000 == pytest.approx(np.ones(len(flow)), rel=1e-6)  # kg/s, through every level
    assert 0.5 < field.bulk_packing < 0.66


def test_results_tell_how_far_and_how_much_was_left_out(results: Path) -> None:
    told: dict[str, Any] = json.loads((results / "column" / "provenance.json").read_text())
    (gate,) = (one for one in told["quality"] if "drawn solid" in one["name"])
    assert (
        0.001 < gate["value"] < 1 - (6 / 6.15) ** 2
    )  # less than the share of the area: spheres are thin at their sides
    assert "back 0.0015 m" in (results / "column" / "plan.json").read_text()
