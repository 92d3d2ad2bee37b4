"""The hybrid of a slab on the real LIGGGHTS: a shaft with a chamber to one side, particles in the chamber only."""

from __future__ import annotations

import json

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.field import Field, divergence, level_flow
from granpipe.pipeline.run import Outcome, plan_case, run_case
from granpipe.progress import Silent

pytestmark = [pytest.mark.liggghts, pytest.mark.slow]

FURNACE = """
name: furnace
outline:
  symmetry: plane
  unit: cm
  left: [[-6, 50], [-6, 0]]
  right: [[6, 50], [6, 10], [8.5, 10], [8.5, 0]]
  depth: 100
  sections: {shaft: [50, 10], chamber: [10, 0]}
material:
  density: 2000 kg/m^3
  size: {diameter: 2 cm}
contact: {friction: 0.3, rolling_friction: 0.1}
flow_rate: 10 kg/s
dem: {max_time: 2.5 s, ranks: 1}
figures: [rz]
export: [comsol]
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("hybrid")
    (folder / "furnace.yaml").write_text(FURNACE)
    file = read_case(folder / "furnace.yaml")
    assert plan_case(file, cores=2).model == "hybrid"
    return run_case(file, folder / "results", Silent())


def test_the_field_conserves_and_carries_the_flow_of_the_whole_depth(outcome: Outcome) -> None:
    field = Field.load(outcome.folder / "field.npz")
    assert field.grid.measure.turn == 1.0
    flow = level_flow(field.flux_z, field.grid) * field.velocity_scale
    np.testing.assert_allclose(flow, 10.0 / (2000 * field.bulk_packing), rtol=1e-10)
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-10


def test_far_above_the_seam_the_shaft_is_a_plug(outcome: Outcome) -> None:
    field = Field.load(outcome.folder / "field.npz")
    inside = (field.grid.r_centres > -0.05) & (field.grid.r_centres < 0.05)
    top = field.flux_z[-2, inside]
    np.testing.assert_allclose(top, top.mean(), rtol=0.01)


def test_the_forced_part_follows_the_particles_and_the_seam_is_within_its_gate(outcome: Outcome) -> None:
    figures = json.loads((outcome.folder / "provenance.json").read_text())["figures"]
    found = figures["difference_from_what_is_followed"]["chamber"]
    assert found["sections"] < 0.03
    assert found["upper seam"] < 0.3
    assert outcome.failed == ()


def test_particles_fill_a_slice_of_the_chamber_and_half_of_the_shafts_hydraulic_diameter(outcome: Outcome) -> None:
    plan = json.loads((outcome.folder / "plan.json").read_text())["submodels"]["chamber"]
    assert plan["z_m"] == [pytest.approx(0.22, abs=0.006), 0.0]
    assert any(one["name"] == "slab thickness" and one["value"] == "0.16 m" for one in plan["dem"]["decisions"])


def test_both_walls_are_drawn_and_the_exports_are_those_of_a_slab(outcome: Outcome) -> None:
    assert (outcome.folder / "figures").is_dir()
    assert {one.name for one in (outcome.folder / "comsol").iterdir()} >= {"u_grid.txt", "w_grid.txt"}
