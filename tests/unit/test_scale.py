"""Scaling: the same pattern at another flow rate, and a warning where the pattern would change."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from granpipe.api.result import load_result
from granpipe.case.reader import read_case
from granpipe.case.schema import Case
from granpipe.cli import main
from granpipe.errors import CaseError, DataError, RunError
from granpipe.field import Field, Grid, flux_from_psi
from granpipe.geometry.outline import Outline
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.plot import plot_result
from granpipe.pipeline.scale import scale_results
from granpipe.system.manifest import write_manifest

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A results folder with a uniform flow of 1 m³/s, whatever the walls."""
    folder = tmp_path / "hopper"
    folder.mkdir()
    (folder / "case.yaml").write_text(read_case(HOPPER).case.to_yaml())
    grid = Grid.covering(1.0, 3.4, 5.9, 0.1)
    psi = np.tile(-0.5 / np.pi * grid.r_edges**2, (len(grid.z_edges), 1))
    flux_r, flux_z = flux_from_psi(psi, grid)
    inside = Outline.from_case(read_case(HOPPER).case).inside_fraction(grid)
    Field(grid, inside, inside > 0, 0.6 * flux_r, 0.6 * flux_z, 1.0, 0.6, 1.0, psi=0.6 * psi).save(folder / "field.npz")
    write_manifest(folder)
    return folder


def case_at(flow: str) -> Case:
    return read_case(HOPPER, {"flow_rate": flow}).case


def test_the_scaled_field_carries_the_flow_asked_for(results: Path, tmp_path: Path) -> None:
    assert scale_results(results, case_at("7.2 m^3/h"), tmp_path / "out") == ((), ())
    field = Field.load(tmp_path / "out" / "field.npz")
    assert field.bulk_flow * field.flow_scale == pytest.approx(0.002)
    assert (tmp_path / "out" / "comsol" / "psi_grid.txt").is_file()


def test_times_go_down_as_the_flow_goes_up(results: Path, tmp_path: Path) -> None:
    field = Field.load(results / "field.npz")
    extra = {"residence_within": np.array([0.5]), "residence_time": np.array([7.8])}
    replace(field, extra=extra).save(results / "field.npz")
    write_manifest(results)
    scale_results(results, case_at("7.2 m^3/h"), tmp_path / "out")
    row = (tmp_path / "out" / "residence_time.csv").read_text().splitlines()[1]
    assert row.split(",")[:2] == ["0.5", "3900"]  # at 0.002 m³/s in place of 1


def test_a_flow_near_free_discharge_is_warned_about(results: Path, tmp_path: Path) -> None:
    (note,) = scale_results(results, case_at("0.5 m^3/s"), tmp_path / "out").notes
    assert "of the free discharge through the outlet" in note


def test_the_marks_of_a_result_go_with_the_scaled_one(results: Path, tmp_path: Path) -> None:
    mark = {"name": "statistical error", "value": 0.2, "limit": "at most 5%", "passed": False}
    (results / "provenance.json").write_text(json.dumps({"quality": [mark, mark | {"passed": True}]}))
    write_manifest(results)
    scaled = scale_results(results, case_at("7.2 m^3/h"), tmp_path / "out")
    assert scaled.failed == (Gate(**mark),)
    again = scale_results(tmp_path / "out", case_at("3 m^3/h"), tmp_path / "again")
    assert again.failed == scaled.failed
    assert load_result(tmp_path / "again").gates[0] == Gate(**mark)


@pytest.mark.parametrize("damage", ["gone", "edited"])
def test_marks_that_are_gone_or_edited_are_not_taken_for_none(damage: str, results: Path, tmp_path: Path) -> None:
    mark = {"name": "statistical error", "value": 0.2, "limit": "at most 5%", "passed": False}
    record = results / "provenance.json"
    record.write_text(json.dumps({"quality": [mark]}))
    write_manifest(results)
    if damage == "gone":
        record.unlink()
    else:
        record.write_text('{"quality": []}')
    with pytest.raises(DataError, match=r"provenance\.json: missing, damaged or changed"):
        scale_results(results, case_at("7.2 m^3/h"), tmp_path / "out")
    done = CliRunner().invoke(main, ["compare", str(results), str(results)])
    assert done.exit_code == 3
    assert "provenance.json: missing, damaged or changed" in done.output


def test_a_flow_above_free_discharge_is_refused_and_nothing_is_written(results: Path, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="times the free discharge through the outlet") as refusal:
        scale_results(results, case_at("1e9 t/h"), tmp_path / "out")
    assert refusal.value.key == ("flow_rate",)
    assert not (tmp_path / "out").exists()


def test_a_field_that_does_not_know_its_packing_is_not_scaled(results: Path, tmp_path: Path) -> None:
    field = Field.load(results / "field.npz")
    assert field.psi is not None
    solid = {"flux_r": field.flux_r / 0.6, "flux_z": field.flux_z / 0.6, "psi": field.psi / 0.6}
    replace(field, bulk_packing=1.0, **solid).save(results / "field.npz")
    write_manifest(results)
    with pytest.raises(DataError, match=r"run the case again with material\.bulk_density"):
        scale_results(results, case_at("1 t/h"), tmp_path / "out")


@pytest.mark.parametrize("flow", [0.0, -1.0])
def test_a_field_at_rest_or_upwards_is_not_scaled(flow: float, results: Path, tmp_path: Path) -> None:
    field = Field.load(results / "field.npz")
    assert field.psi is not None
    changed = {"flux_r": flow * field.flux_r, "flux_z": flow * field.flux_z, "psi": flow * field.psi + 0.0}
    replace(field, bulk_flow=flow, **changed).save(results / "field.npz")
    write_manifest(results)
    with pytest.raises(DataError, match=f"a flow of {flow:g} m³/s cannot be scaled"):
        scale_results(results, case_at("1 t/h"), tmp_path / "out")


@pytest.mark.parametrize("shape", [(1.0, 3.4, 6.9), (1.2, 3.4, 5.9), (1000.0, 3400.0, 5900.0)])
def test_the_field_of_another_vessel_is_not_taken_for_that_of_the_case(
    shape: tuple[float, float, float], results: Path, tmp_path: Path
) -> None:
    """Not scaled, drawn or opened; the case is that of a hopper from r = 1 m, z = 3.4 to 5.9 m."""
    grid = Grid.covering(*shape, shape[0] / 10)
    psi = np.tile(-0.3 / np.pi * (grid.r_edges / grid.r_edges[-1]) ** 2, (len(grid.z_edges), 1))
    ones = np.ones(grid.shape)
    Field(grid, ones, ones > 0, *flux_from_psi(psi, grid), 1.0, 0.6, 1.0, psi=psi).save(results / "field.npz")
    write_manifest(results)
    for use in (
        lambda: scale_results(results, case_at("7.2 m^3/h"), tmp_path / "out"),
        lambda: plot_result(results, "w", None, tmp_path / "picture.png"),
        lambda: load_result(results),
    ):
        with pytest.raises(DataError, match="is not the field of the case beside it"):
            use()


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_a_folder_without_a_name_is_there_already(
    name: str, results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RunError, match="exists already"):
        scale_results(results, case_at("1 m^3/h"), Path(name))


def test_an_existing_folder_is_not_overwritten(results: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="exists already"):
        scale_results(results, case_at("1 m^3/h"), results)
