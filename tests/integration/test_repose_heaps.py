"""Heaps of real LIGGGHTS runs: made, found again in the store, and the pair behind an angle found."""

import math
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import read_case, resolve
from granpipe.case.yamlfile import Places
from granpipe.progress import Silent
from granpipe.repose import heap, heaps
from granpipe.repose.heap import Pair
from granpipe.repose.heaps import Asked, Heaps
from granpipe.repose.run import calibrate_friction
from granpipe.system.store import Store
from granpipe.system.versions import program_versions

CASE = """\
name: beads
outline: {wall: [[0.3, 1], [0.3, 0]]}
material: {density: 1000, size: {diameter: {normal: {mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}, classes: 3}}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 1 kg/h
"""


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heap of some hundred particles and few steps: seconds instead of a minute."""
    for name, value in {
        "LENGTH": 6.0,
        "WIDTH": 3.0,
        "LEDGE": 1.0,
        "DROPS": 3,
        "DISCARDED": 1,
        "REST_CHUNKS": 2,
    }.items():
        monkeypatch.setattr(heap, name, value)
    monkeypatch.setattr(heaps, "DROPS", 3)
    monkeypatch.setattr(heaps, "DISCARDED", 1)


@pytest.mark.usefixtures("small")
def test_heaps_are_run_once_and_then_found_in_the_store(tmp_path: Path) -> None:
    case = resolve(
        {
            "name": "x",
            "outline": {"wall": [[0.1, 0.5], [0.1, 0]]},
            "material": {"density": 2000, "size": {"radius": 0.005}},
            "flow_rate": "1 kg/h",
        },
        Places("x"),
    ).case
    store = Store(tmp_path / ".store")
    made = Heaps(case, store, program_versions(tmp_path / "programs.json")["liggghts"], 2, Silent())
    asked = [Asked(Pair(0.2, 0.01), 1), Asked(Pair(0.9, 0.4), 1)]
    assert made.missing(asked) == asked
    low, high = made.run(asked, "heaps")
    assert made.missing(asked) == []
    assert made.run(asked, "heaps") == [low, high]
    assert all(-0.2 < value < 2 for value in (*low.slopes, *high.slopes))
    assert not list(tmp_path.rglob("rest.*"))


@pytest.mark.slow
def test_the_pair_whose_angle_is_given_lies_in_the_valley(tmp_path: Path) -> None:
    """About ten minutes on two cores. Other seeds than those of the search give the angle."""
    path = tmp_path / "case.yaml"
    path.write_text(CASE)
    file, pair = read_case(path), Pair(0.5, 0.1)
    store = Store(tmp_path / "results" / ".store")
    liggghts = program_versions(store.root / "programs.json")["liggghts"]
    own = Heaps(file.case, store, liggghts, 2, Silent()).run([Asked(pair, seed) for seed in range(101, 105)], "own")
    slopes = [record.slope for record in own]
    angle, error = math.atan(float(np.mean(slopes))), float(np.std(slopes, ddof=1)) / 2
    found = calibrate_friction(file, angle, error * math.cos(angle) ** 2, tmp_path / "results", 2, Silent()).found
    assert found.kept
    assert found.best.low <= pair.rolling <= found.best.high
    assert found.frictions[0] <= pair.friction <= found.frictions[1]
    assert not found.failed
