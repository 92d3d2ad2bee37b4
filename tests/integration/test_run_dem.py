"""The main job on the real LIGGGHTS, in small: results, balance, caching."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.runs import run

from granpipe.case.reader import read_case
from granpipe.field import Field, level_flow
from granpipe.homogenize.average import Sums, merge

pytestmark = pytest.mark.liggghts


def provenance(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "provenance.json").read_text())
    return data


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, tiny_text: str) -> tuple[Path, Path]:
    """(case file, results) of one finished run."""
    folder = tmp_path_factory.mktemp("run")
    case = folder / "tiny.yaml"
    case.write_text(tiny_text)
    run(read_case(case), folder / "results")
    return case, folder / "results"


def test_a_run_leaves_every_promised_file(finished: tuple[Path, Path]) -> None:
    folder = finished[1] / "tiny"
    names = {"case.yaml", "plan.json", "provenance.json", "field.npz", "comsol/flow_spreadsheet.txt", "logs/settle.txt"}
    assert all((folder / name).is_file() for name in names)


def test_the_field_carries_the_same_flow_through_every_level(finished: tuple[Path, Path]) -> None:
    field = Field.load(finished[1] / "tiny" / "field.npz")
    flow = level_flow(field.flux_z, field.grid)
    np.testing.assert_allclose(flow, field.bulk_flow * field.bulk_packing, rtol=1e-10)


def test_raw_flow_and_storage_close_the_balance_of_every_row(finished: tuple[Path, Path]) -> None:
    """Flow from displacement between snapshots: what flows into a row and stays is what the row has gained."""
    chain = next((finished[1] / ".store").glob("produce-*"))
    sums = merge([Sums.load(path) for path in sorted(chain.glob("segment-*/sums.npz"))])
    flow = level_flow(sums.mean_flux[1], sums.grid)
    gained = sums.storage.sum(axis=1)
    assert np.abs(np.diff(flow) - gained).max() < 2e-3 * flow.mean()


def distinct(seen: list[str]) -> list[str]:
    """Stages in their order, those of the pilot not repeated."""
    return list(dict.fromkeys(seen))


def test_a_second_run_has_nothing_to_do(finished: tuple[Path, Path]) -> None:
    case, results = finished
    outcome, seen = run(read_case(case), results)
    assert not outcome.made
    assert seen == []


def test_another_smoothing_reruns_no_dem(finished: tuple[Path, Path]) -> None:
    case, results = finished
    _, seen = run(read_case(case, {"homogenize.smoothing_passes": "1", "name": "other"}), results)
    assert distinct(seen) == ["walls: done before", "settle: done before", "produce: done before", "field", "results"]


def test_a_faster_plate_settles_no_new_bed_if_the_box_still_fits(finished: tuple[Path, Path]) -> None:
    case, results = finished
    changes = {"dem.plate_speed": "0.015", "dem.start_speed": "0.015", "dem.max_time": "2.4", "name": "slow"}
    _, seen = run(read_case(case, changes), results)
    assert distinct(seen)[:3] == ["walls: done before", "settle: done before", "produce"]


def test_snapshots_are_gone_unless_they_are_asked_for(finished: tuple[Path, Path]) -> None:
    chain = next((finished[1] / ".store").glob("produce-*"))
    assert not list(chain.glob("**/snapshot.*.bin"))
    kept = [path.parent.name for path in sorted(chain.glob("segment-*/restart"))]
    assert kept == [path.name for path in sorted(chain.glob("segment-*"))][-2:]


@pytest.mark.slow
def test_free_discharge_closes_its_balance_and_is_fed_as_fast_as_it_flows(tiny: Path, tmp_path: Path) -> None:
    changes = {"dem.outlet": "open", "outline.wall": "[[6, 10], [6, 6], [5, 0]]", "material.size.diameter": "1.4 cm"}
    outcome, _ = run(read_case(tiny, changes), tmp_path / "results")
    figures = provenance(outcome.folder)["figures"]
    segments = sorted((tmp_path / "results" / ".store").glob("produce-*/segment-*/segment.json"))
    last = json.loads(segments[-1].read_text())
    assert last["discharged"] > figures["inserted_to_settle"][0]  # the whole bed has been renewed
    assert last["particles"] > 0.7 * figures["inserted_to_settle"][0]
    assert [gate for gate in outcome.failed if "raw flow" in gate.name] == []
