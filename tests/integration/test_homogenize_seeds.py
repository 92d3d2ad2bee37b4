"""What a run says of its own error, against other runs: eight fillings of a small vessel on the real LIGGGHTS."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from granpipe.case.reader import read_case
from granpipe.field import Field
from granpipe.pipeline.run import run_case
from granpipe.progress import Silent

pytestmark = [pytest.mark.liggghts, pytest.mark.slow]

SMOKE = Path(__file__).parents[2] / "cases" / "smoke.yaml"
SEEDS = range(1, 9)


@pytest.fixture(scope="module")
def fields(tmp_path_factory):
    results = tmp_path_factory.mktemp("seeds")
    found = []
    for seed in SEEDS:
        changes = {"name": f"seed{seed}", "dem.seed": str(seed), "dem.max_time": "12 s", "dem.ranks": "1"}
        run_case(read_case(SMOKE, changes | {"export": "[]", "figures": "[]"}), results, Silent())
        folder = results / f"seed{seed}"
        figures = json.loads((folder / "provenance.json").read_text())["figures"]
        found.append((Field.load(folder / "field.npz"), figures["effective_blocks"]))
    return found


@pytest.mark.parametrize("name", ["raw_flux_r", "raw_flux_z", "flux_r", "flux_z"])
def test_intervals_hold_the_mean_of_the_other_seeds_as_often_as_they_say(fields, name):
    flux = np.array([getattr(field, name) for field, _ in fields])
    se = np.array([getattr(field, f"{name}_se") for field, _ in fields])
    speed = np.sqrt(np.mean([field.raw_flux_z**2 for field, _ in fields]))
    flowing = np.abs(flux.mean(axis=0)) > 0.05 * speed
    share = np.sqrt(1 + 1 / (len(fields) - 1))  # the others' mean has an error, too
    held = [
        (np.abs(flux[i] - np.delete(flux, i, axis=0).mean(axis=0)) <= share * stats.t.ppf(0.975, count / 3) * se[i])[
            flowing
        ].mean()
        for i, (_, count) in enumerate(fields)
    ]
    assert 0.90 <= np.mean(held) <= 0.99
