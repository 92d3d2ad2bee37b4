"""A slab on the real LIGGGHTS, in small: a slice of the hopper of `cases/slot_hopper.yaml`, and one that discharges."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.runs import run

from granpipe.case.reader import read_case
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import read_snapshot
from granpipe.field import Box, Field, divergence, level_flow

pytestmark = pytest.mark.liggghts

CASE = Path(__file__).parents[2] / "cases" / "slot_hopper.yaml"
SMALL = {"dem.thickness": "20 mm", "dem.ranks": "1", "figures": "[]"}


def provenance(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "provenance.json").read_text())
    return data


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a slice four particles thick."""
    folder = tmp_path_factory.mktemp("plane")
    changes = SMALL | {
        "dem.max_time": "1.2 s", "dem.keep_snapshots": "thinned", "homogenize.start": "0.2 s",
    }  # fmt: skip
    return run(read_case(CASE, changes), folder)[0].folder


def test_the_flow_is_that_of_the_stated_depth_through_every_level(made: Path) -> None:
    field = Field.load(made / "field.npz")
    assert isinstance(field.grid, Box)
    assert field.grid.measure.turn == 1.0
    flow = level_flow(field.flux_z, field.grid) * field.flow_scale
    solids = 1000 / 3600 / 2500
    np.testing.assert_allclose(flow, solids, rtol=1e-10)
    scale = np.abs(field.flux_z).max() / field.grid.cell
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-12 * scale


def test_every_gate_but_that_of_the_thin_slice_is_passed(made: Path) -> None:
    failed = [gate["name"] for gate in provenance(made)["quality"] if not gate["passed"]]
    assert len(failed) == 1
    assert "thickness" in failed[0]


def test_no_wall_layer_is_seen_at_the_periodic_faces(made: Path) -> None:
    """Particles are as many beside the faces as midway: walls order them there, images do not."""
    (chain,) = (made.parent / ".store").glob("produce-*")
    beds = [read_snapshot(path, DUMP_COLUMNS) for path in sorted((chain / "snapshots").iterdir())]
    y = np.concatenate([bed.position[:, 1] for bed in beds]) % 0.02
    near, far = np.sum((y < 0.0025) | (y > 0.0175)), np.sum((y > 0.0075) & (y < 0.0125))
    assert near == pytest.approx(far, rel=0.1)


FURNACE = """\
name: furnace
outline:
  symmetry: plane
  unit: mm
  left: [[-60, 150], [-60, 130], [-80, 130], [-80, 70], [-50, 20], [-50, 0]]
  right: [[60, 150], [60, 130], [80, 130], [80, 70], [50, 20], [50, 0]]
  depth: 500
material: {density: 2500, bulk_density: 1500, size: {diameter: 10 mm}}
flow_rate: 10 kg/h
model: fluid
fluid: {rheology: frictional}
homogenize: {cell: 5 mm}
export: []
figures: []
"""


@pytest.mark.slow
def test_a_frictional_fluid_of_a_mirror_symmetric_slab_passes_its_gates_and_is_its_own_mirror_image(
    tmp_path: Path,
) -> None:
    path = tmp_path / "furnace.yaml"
    path.write_text(FURNACE)
    outcome = run(read_case(path), tmp_path)[0]
    assert not outcome.failed
    field = Field.load(outcome.folder / "field.npz")
    np.testing.assert_allclose(level_flow(field.flux_z, field.grid) * field.flow_scale, 10 / 3600 / 2500, rtol=1e-10)
    size = np.abs(field.flux_z).max()
    np.testing.assert_allclose(field.flux_z[:, ::-1], field.flux_z, atol=0.05 * size)
    np.testing.assert_allclose(-field.flux_r[:, ::-1], field.flux_r, atol=0.05 * size)
    void = ~field.bulk & (field.inside_fraction > 0.99)
    assert void[:, :16].sum() == void[:, 16:].sum() > 0  # below both ledges


@pytest.mark.slow
def test_stress_and_walls_bear_the_bed_with_contacts_through_the_periodic_faces(tmp_path: Path) -> None:
    """Were such contacts lost or counted twice, a tenth of the weight or more would be missing or too much."""
    changes = SMALL | {
        "dem.max_time": "0.7 s", "homogenize.start": "0.2 s", "homogenize.fields": "[stress, wall_pressure]",
    }  # fmt: skip
    folder = run(read_case(CASE, changes), tmp_path)[0].folder
    forces = provenance(folder)["figures"]["forces"]
    assert abs(forces["imbalance"]) < 0.05
    extra = Field.load(folder / "field.npz").extra
    for side in ("left", "right"):
        assert extra["wall_pressure"][extra["wall_surface"] == side].mean() > 0


@pytest.mark.slow
def test_discharge_is_that_of_the_stated_depth(tmp_path: Path) -> None:
    """1.03 ρ_b √g L (w − 1.4 d)^1.5, L = 1 m, or up to two fifths more: the law is for flat floors."""
    changes = SMALL | {
        "dem.outlet": "open", "dem.max_time": "0.9 s", "homogenize.cell": "2.5 mm", "homogenize.start": "0.3 s",
        "export": "[]",
    }  # fmt: skip
    figures = provenance(run(read_case(CASE, changes), tmp_path)[0].folder)["figures"]
    law = 1.03 * figures["bulk_density_kg_per_m3"] * np.sqrt(9.81) * (0.030 - 1.4 * 0.005) ** 1.5
    assert 0.9 * law < figures["discharge"]["kg_per_s"] < 1.4 * law
    assert figures["discharge"]["kg_per_s"] == pytest.approx(figures["discharge"]["counted_kg_per_s"], rel=0.02)
