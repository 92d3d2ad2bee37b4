"""A slab between a front and a back wall on the real LIGGGHTS: the hopper of `cases/slot_hopper.yaml`, 7 d deep."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fakes.runs import run

from granpipe.case.reader import read_case
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import read_snapshot
from granpipe.dem.snapshot import Snapshot
from granpipe.field import Field, level_flow

pytestmark = pytest.mark.liggghts

CASE = Path(__file__).parents[2] / "cases" / "slot_hopper.yaml"
DIAMETER, DEPTH = 0.005, 0.035


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a short run between walls as rough as the particles."""
    changes = {
        "outline.depth": "35", "outline.front_and_back": "walls", "flow_rate": "35 kg/h", "dem.ranks": "1",
        "dem.max_time": "0.9 s", "dem.keep_snapshots": "all", "homogenize.start": "0.2 s", "figures": "[]",
        "homogenize.fields": "[stress]",
    }  # fmt: skip
    return run(read_case(CASE, changes), tmp_path_factory.mktemp("walls"))[0].folder


@pytest.fixture(scope="module")
def beds(made: Path) -> list[Snapshot]:
    (chain,) = (made.parent / ".store").glob("produce-*")
    return [read_snapshot(path, DUMP_COLUMNS) for path in sorted((chain / "snapshots").iterdir())]


def test_every_gate_is_passed_and_walls_and_contacts_bear_the_weight(made: Path) -> None:
    """The balance of forces holds only with the friction of the front and the back wall in it."""
    provenance = json.loads((made / "provenance.json").read_text())
    assert [gate["name"] for gate in provenance["quality"] if not gate["passed"]] == []
    assert provenance["field"]["front_and_back_walls"]
    assert abs(provenance["figures"]["forces"]["imbalance"]) < 0.05


def test_no_particle_is_beyond_the_walls_and_layers_lie_along_them(beds: list[Snapshot]) -> None:
    """Walls order the particles beside them: their centres gather half a diameter away, as no image does it."""
    y = np.concatenate([bed.position[:, 1] for bed in beds])
    assert y.min() > 0.4 * DIAMETER
    assert y.max() < DEPTH - 0.4 * DIAMETER
    away = np.minimum(y, DEPTH - y) / DIAMETER
    assert np.mean(away < 0.6) > 2 * np.mean((away > 0.8) & (away < 0.9))


def test_the_same_flow_passes_every_level_and_is_that_of_the_whole_depth(made: Path) -> None:
    field = Field.load(made / "field.npz")
    assert field.grid.measure.walled
    assert field.grid.measure.turn == pytest.approx(DEPTH)
    flow = level_flow(field.flux_z, field.grid) * field.flow_scale
    np.testing.assert_allclose(flow, 35 / 3600 / 2500, rtol=1e-10)


def test_particles_are_slower_beside_the_front_and_the_back_wall_than_midway(beds: list[Snapshot]) -> None:
    """In the hopper and its slot; between periodic faces they are as fast."""
    beside, midway = [], []
    for bed in beds[len(beds) // 4 :]:
        y, z = bed.position[:, 1], bed.position[:, 2]
        low = (z > 0.005) & (z < 0.045)
        beside.append(bed.velocity[low & (np.minimum(y, DEPTH - y) < DIAMETER), 2].mean())
        midway.append(bed.velocity[low & (np.abs(y - 0.5 * DEPTH) < DIAMETER), 2].mean())
    assert np.mean(midway) < 0
    assert 0 < np.mean(beside) / np.mean(midway) < 0.95
