"""Every case of the project, pinned by named figures with tolerances.

Cases that take minutes are pinned by their plans; `pytest tests/regression --update` writes the figures anew and
prints what changed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.field import Field, level_flow
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent

CASES = Path(__file__).parents[2] / "cases"
PINS = Path(__file__).with_name("pins.json")

EXACT = 1e-6
"""Relative tolerance of what does not depend on chance."""

SIGMAS = 4.0
"""DEM is chaotic: other compilers and rank counts give another sample of the same flow. Two samples agree within so
many standard errors of their difference."""

PACKING_SCATTER = 0.02
"""Relative tolerance of a packing fraction, and of all that is divided by it, between two fillings."""

Figures = dict[str, float]


def planned(name: str) -> Figures:
    plan = make_plan(read_case(CASES / f"{name}.yaml").case)
    runs = [plan] if plan.settings is not None else [part for _, part in plan.submodels]
    names = ("rows", "columns") if len(plan.grid.shape) == 2 else ("cells along z", "along y", "along x")
    return dict(zip(names, plan.grid.shape, strict=True)) | {
        f"{key} {number}": value for number, part in enumerate(runs) for key, value in settings_of(part).items()
    }


def settings_of(plan: Plan) -> Figures:
    dem = plan.dem
    return {
        "particles": dem.particles,
        "steps": dem.steps,
        "time step": dem.time_step,
        "plate speed": dem.plate_speed,
        "Young's modulus": dem.youngs_modulus,
        "plate level": dem.plate_z,
    }


def ran(name: str, results: Path, *heights: float) -> tuple[Figures, Figures]:
    """Flow and speeds on the axis and half-way to the wall, at the case's flow rate, with their standard errors."""
    outcome = run_case(read_case(CASES / f"{name}.yaml", {"figures": "[]"}), results, Silent())
    assert outcome.failed == ()
    field = Field.load(outcome.folder / "field.npz")
    velocity = field.flux_z * field.velocity_scale
    error = np.zeros_like(velocity) if field.flux_z_se is None else field.flux_z_se * field.velocity_scale
    figures = {"flow": float(level_flow(velocity, field.grid).mean()), "packing": field.bulk_packing}
    errors = {}
    for z in heights:
        row = np.abs(field.grid.z_edges - z).argmin()
        half = np.flatnonzero(velocity[row])[-1] // 2
        for place, cells in ("on the axis", slice(0, 2)), ("half-way to the wall", slice(half, half + 2)):
            figures[f"speed {place} at {z:g} m"] = float(-velocity[row, cells].mean())
            errors[f"speed {place} at {z:g} m"] = float(error[row, cells].mean())
    return figures, errors


def compare(
    kind: str, name: str, figures: Figures, request: pytest.FixtureRequest, errors: Figures | None = None
) -> None:
    pins: dict[str, Any] = json.loads(PINS.read_text()) if PINS.exists() else {}
    label = f"{name} ({kind})"
    if request.config.getoption("--update"):
        old = pins.get(label, {})
        for key, value in figures.items():
            if old.get(key) != value:
                print(f"{label}: {key}: {old.get(key)} → {value}")
        PINS.write_text(json.dumps(pins | {label: figures}, indent=2, sort_keys=True) + "\n")
        return
    assert figures.keys() == pins[label].keys()
    for key, value in figures.items():
        if errors is None:
            expected = pytest.approx(pins[label][key], rel=EXACT)
        else:
            noise = SIGMAS * np.sqrt(2) * errors.get(key, 0.0)
            expected = pytest.approx(pins[label][key], abs=noise + PACKING_SCATTER * pins[label][key])
        assert value == expected, key


@pytest.mark.parametrize("name", sorted(path.stem for path in CASES.glob("*.yaml")))
def test_the_plan_of_every_case_is_as_pinned(name: str, request: pytest.FixtureRequest) -> None:
    compare("plan", name, planned(name), request)


def test_the_hopper_flows_as_pinned(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    compare("fluid", "hopper", ran("hopper", tmp_path, 5.5, 4.4, 3.6)[0], request)


@pytest.mark.liggghts
def test_the_smoke_case_flows_as_pinned_and_tells_what_its_average_is_worth(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    found, errors = ran("smoke", tmp_path, 0.10, 0.0, -0.02)
    compare("dem", "smoke", found, request, errors)
    assert all(error < 0.15 * found[place] for place, error in errors.items())
    figures = json.loads((tmp_path / "smoke" / "provenance.json").read_text())["figures"]
    assert figures["effective_blocks"] > 7
    assert min(figures["turnovers"].values()) > 1
    assert 0 < figures["statistical_error"]["whole"] < 0.1
    assert set(figures["off_centre"]) == {"shaft", "hopper", "throat", "chamber"}
