"""A results folder without a run: the records that the report is made from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

FIELD = {
    "flow_rate_m3_per_s": 1 / 3600,
    "reference_packing": 0.58,
    "largest_speed_m_per_s": 0.002,
    "reference_density_kg_per_m3": 1450.0,
    "mass_flow_kg_per_s": 1450 / 3600,
    "sections": {
        "throat": {
            "z_m": [1.0, 0.0],
            "mean_speed_m_per_s": 0.001,
            "largest_speed_m_per_s": 0.002,
            "at_rest_m2": 0.0,
            "void_m2": 0.25,
        }
    },
}
GATE = {"name": "packing in the plug", "value": 0.58, "limit": "0.5 to 0.68", "passed": True}
RECORD = {
    "figures": {
        "statistical_error": {"whole": 0.034, "throat": 0.05},
        "turnovers": {"throat": 0.7},
        "off_centre": {"throat": {"amplitudes": [0.01, 0.03], "amplitudes_se": [0.02, 0.01]}},
        "particles": [12345],
        "produce_wall_seconds": [400.0],
        "averaging_seconds": [3.0],
    },
    "quality": [GATE],
    "notes": ["turned over less than once"],
}
DEM = {"decisions": [{"name": "time_step", "value": "1e-4 s", "criterion": "damping"}]}


def results(folder: Path, model: str = "dem", **changes: Any) -> Path:
    """A results folder of a model, as `granpipe run` leaves it."""
    plan: dict[str, Any] = {
        "model": model,
        "stages": [{"stage": "produce", "reason": "it widens"}],
        "left_out": [{"what": "fluid solve", "reason": "DEM covers it"}],
        "warnings": ["narrow"],
        "outside_the_range": [],
        "wall_factors": [],
        "submodels": {},
    }
    measured: Mapping[str, Any] = RECORD
    submodels: dict[str, Any] = {}
    if model == "dem":
        plan["dem"] = DEM
    else:
        measured = {"figures": {}, "quality": [GATE], "notes": []}
    if model == "hybrid":
        plan["submodels"] = {"d": {"dem": DEM}}
        submodels = {"d": RECORD}
    provenance = {
        "case": "silo",
        "made": "2026-01-01T12:30:01+00:00",
        "granpipe": "0.1",
        "versions": {"numpy": "2.4.6"},
        "wall_seconds": 410.0,
        "forecast_seconds": 100.0,
        "field": FIELD,
        **measured,
        "submodels": submodels,
        **changes,
    }
    (folder / "comsol").mkdir(parents=True, exist_ok=True)
    (folder / "comsol" / "import_comsol.java").write_text("")
    (folder / "plan.json").write_text(json.dumps(plan))
    (folder / "provenance.json").write_text(json.dumps(provenance))
    return folder
