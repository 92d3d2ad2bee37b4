"""The hybrid on the real LIGGGHTS: DEM of the part that needs it, joined to the fictitious fluid of the rest."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.errors import CaseError
from granpipe.field import Field, divergence, level_flow
from granpipe.pipeline.run import Outcome, plan_case, run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts

PIPE = """
name: pipe
outline:
  unit: cm
  wall: [[6, 40], [6, 10], [8.5, 10], [8.5, 0]]
  sections: {pipe: [40, 10], chamber: [10, 0]}
material:
  density: 2000 kg/m^3
  size: {diameter: 2 cm}
contact: {friction: 0.3, rolling_friction: 0.1}
flow_rate: 1 kg/s
dem: {max_time: 4 s, ranks: 1}
figures: []
export: [vtk]
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("hybrid")
    (folder / "pipe.yaml").write_text(PIPE)
    file = read_case(folder / "pipe.yaml")
    assert plan_case(file, cores=2).model == "hybrid"
    return run_case(file, folder / "results", Silent())


def test_the_field_conserves_and_carries_the_flow_asked_for(outcome: Outcome) -> None:
    field = Field.load(outcome.folder / "field.npz")
    flow = level_flow(field.flux_z, field.grid) * field.velocity_scale
    np.testing.assert_allclose(flow, 1.0 / (2000 * field.bulk_packing), rtol=1e-10)
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-10


def test_far_above_the_seam_the_pipe_is_a_plug(outcome: Outcome) -> None:
    field = Field.load(outcome.folder / "field.npz")
    top = field.flux_z[-2, :10]  # the pipe has 12 cells across its radius
    np.testing.assert_allclose(top, top.mean(), rtol=1e-3)


def test_the_forced_part_follows_the_dem_and_the_seam_is_reported(outcome: Outcome) -> None:
    figures = json.loads((outcome.folder / "provenance.json").read_text())["figures"]
    found = figures["difference_from_what_is_followed"]["chamber"]
    assert found["sections"] < 0.02
    # a pipe of six particles is not quite a plug: the layer along its wall is slower
    assert found["upper seam"] < 0.3


def test_settings_seeds_gates_and_times_of_the_sub_model_are_written_down(outcome: Outcome) -> None:
    plan, provenance = (json.loads((outcome.folder / f"{name}.json").read_text()) for name in ("plan", "provenance"))
    sub_plan, record = plan["submodels"]["chamber"], provenance["submodels"]["chamber"]
    assert sub_plan["z_m"] == [pytest.approx(0.2), 0.0]
    assert sub_plan["dem"]["steps"] > 0
    assert any(decision["name"] == "youngs_modulus" for decision in sub_plan["dem"]["decisions"])
    assert record["seeds"] == [1]
    assert record["figures"]["produce_wall_seconds"][0] > 0
    assert {f"chamber: {gate['name']}" for gate in record["quality"]} <= {g["name"] for g in provenance["quality"]}
    report = (outcome.folder / "report.html").read_text()
    assert "Settings and criteria of sub-model chamber" in report
    assert "Production of sub-model chamber" in report


def test_it_passes_its_gates(outcome: Outcome) -> None:
    assert outcome.failed == ()


def test_dem_ran_on_the_sub_model_alone(outcome: Outcome) -> None:
    """Half of the pipe is 0.2 m of 0.4 m: its particles, with their reservoir, stay below."""
    from granpipe.dem.deck import DUMP_COLUMNS
    from granpipe.dem.dump import read_snapshot

    settled = list((outcome.folder.parent / ".store").glob("settle-*/settled.bin"))
    assert len(settled) == 1
    assert read_snapshot(settled[0], DUMP_COLUMNS).position[:, 2].max() < 0.4


def test_the_fluid_is_written_on_its_mesh(outcome: Outcome) -> None:
    assert (outcome.folder / "fluid.vtu").is_file()


def test_an_earlier_field_is_followed_without_any_dem(outcome: Outcome, tmp_path: Path) -> None:
    (tmp_path / "pipe.yaml").write_text(PIPE)
    earlier = outcome.folder / "field.npz"
    changes = {"fluid.known_field": str(earlier), "model": "hybrid", "name": "again"}
    again = run_case(read_case(tmp_path / "pipe.yaml", changes), tmp_path, Silent())
    assert not list(tmp_path.glob(".store/settle-*"))
    one, two = Field.load(earlier), Field.load(again.folder / "field.npz")
    speed = [field.flux_z * field.velocity_scale for field in (one, two)]
    assert np.sqrt(((speed[0] - speed[1]) ** 2).mean()) < 0.02 * np.sqrt((speed[0] ** 2).mean())


def test_an_earlier_field_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "pipe.yaml").write_text(PIPE)
    with pytest.raises(CaseError, match=r"nothing\.npz cannot be read"):
        run_case(read_case(tmp_path / "pipe.yaml", {"fluid.known_field": "nothing.npz"}), tmp_path, Silent())
