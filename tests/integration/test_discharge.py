"""Free discharge of a small flat-bottomed silo: its rate, its counter, and a packing that is the bed's."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.runs import Stages

from granpipe.case.reader import read_case
from granpipe.field import Field
from granpipe.pipeline.run import run_case

pytestmark = pytest.mark.liggghts

SILO = """\
name: silo
outline:
  unit: mm
  wall: [[40, 60], [40, 0], [18, 0], [18, -6]]
material: {density: 2500 kg/m^3, size: {diameter: 6 mm}}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 0.1 kg/s
model: dem
dem: {outlet: open, max_time: 2.4 s, reservoir_height: 30 mm, ranks: 1}
homogenize: {start: 0.3 s}
export: []
figures: []
"""


class Notes(Stages):
    """Remembers the notes as well."""

    def __init__(self) -> None:
        super().__init__()
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


@pytest.fixture(scope="module")
def silo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """(results folder, what was said) of one run."""
    folder = tmp_path_factory.mktemp("silo")
    (folder / "silo.yaml").write_text(SILO)
    notes = Notes()
    outcome = run_case(read_case(folder / "silo.yaml"), folder / "results", notes)
    return outcome.folder, notes.notes


def provenance(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "provenance.json").read_text())
    return data


def test_the_rate_is_that_of_liggghts_own_counter(silo: tuple[Path, list[str]]) -> None:
    discharge = provenance(silo[0])["figures"]["discharge"]
    assert discharge["kg_per_s"] == pytest.approx(discharge["counted_kg_per_s"], rel=0.01)
    assert 0 < discharge["standard_error"] < 0.05 * discharge["kg_per_s"]


def test_the_rate_is_near_beverloos(silo: tuple[Path, list[str]]) -> None:
    """0.58 ρ_b √g (D − 1.4 d)^2.5, which is good to a tenth, k 1.4 to 1.7 to another fifth at D/d = 6."""
    rate = provenance(silo[0])["figures"]["discharge"]["kg_per_s"]
    low, high = (0.58 * 0.58 * 2500 * np.sqrt(9.81) * (0.036 - k * 0.006) ** 2.5 for k in (1.8, 1.3))
    assert low < rate < high


def test_the_reference_packing_is_the_beds(silo: tuple[Path, list[str]]) -> None:
    """A diameter of the outlet above it and one of particles beside the walls, where layers make the mean another."""
    field = Field.load(silo[0] / "field.npz")
    assert field.packing_fraction is not None
    grid = field.grid
    bed = (grid.z_centres > 0.036)[:, None] & (grid.r_centres < 0.034)
    outlet = (grid.z_centres < 0.0)[:, None] & (grid.r_centres < 0.01)
    solids = field.packing_fraction * grid.cell_volume
    volume = np.broadcast_to(grid.cell_volume, solids.shape)
    assert field.bulk_packing == pytest.approx(np.median(field.packing_fraction[bed]), rel=0.02)
    assert field.bulk_packing > 1.05 * solids[outlet].sum() / volume[outlet].sum()


def test_rate_and_packing_pass_their_gates(silo: tuple[Path, list[str]]) -> None:
    gates = {gate["name"]: gate["passed"] for gate in provenance(silo[0])["quality"]}
    assert gates["reference packing"]
    assert gates["discharge rate, deviation from LIGGGHTS' own counter"]


def test_terminal_and_report_tell_the_rate(silo: tuple[Path, list[str]]) -> None:
    (said,) = [note for note in silo[1] if "discharge rate" in note]
    assert re.fullmatch(r"(note: )?discharge rate: 0\.\d+ ± 0\.\d+ kg/s; LIGGGHTS' own counter: 0\.\d+ kg/s", said)
    assert "Free discharge" in (silo[0] / "report.html").read_text()
