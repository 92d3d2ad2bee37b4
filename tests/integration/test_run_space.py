"""A vessel in space on the real LIGGGHTS, in small: two outlets, 60 : 40, below a bin five particles deep."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fakes.runs import run
from fakes.space_walls import two_outlets, write_stl

import granpipe
from granpipe.api.flow import SpaceFlow
from granpipe.case.reader import read_case
from granpipe.field import Box, Field, level_flow

pytestmark = pytest.mark.liggghts

CASES = Path(__file__).parents[2] / "cases"
SHARE = 0.6


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a lower bin than that of `cases/two_outlets.yaml`, and a short run."""
    folder = tmp_path_factory.mktemp("space")
    write_stl(folder / "two_outlets.stl", two_outlets(ridge=25, height=40))
    (folder / "case.yaml").write_text((CASES / "two_outlets.yaml").read_text())
    changes = {"dem.max_time": "1 s", "dem.ranks": "1", "contact.youngs_modulus": "2e6 Pa"}
    return run(read_case(folder / "case.yaml", changes), folder / "results")[0].folder


def box_of(field: Field) -> Box:
    assert isinstance(field.grid, Box)
    return field.grid


def test_the_flow_of_the_process_passes_every_level_and_leaves_by_its_shares(made: Path) -> None:
    field = Field.load(made / "field.npz")
    solids = 100 / 3600 / 2500
    np.testing.assert_allclose(level_flow(field.flux_z, field.grid) * field.flow_scale, solids, rtol=1e-10)
    grid = box_of(field)
    left = 0.5 * (grid.r_edges[1:] + grid.r_edges[:-1]) < 0
    out = -field.flux_z[0] * grid.ring_area * field.flow_scale
    assert out[:, left].sum() == pytest.approx(SHARE * solids, rel=1e-10)


def test_every_cell_balances_and_no_wall_is_passed(made: Path) -> None:
    field = Field.load(made / "field.npz")
    grid = box_of(field)
    assert field.flux_y is not None
    areas = grid.side_area[0], grid.front_area, grid.ring_area[0]
    x, y, z = (flux * area for flux, area in zip((field.flux_r, field.flux_y, field.flux_z), areas, strict=True))
    out = np.diff(x, axis=2) + np.diff(y, axis=1) + np.diff(z, axis=0)
    assert np.abs(out).max() <= 1e-12 * field.bulk_flow
    closed = field.inside_fraction == 0
    assert not z[1:][closed].any()
    assert not x[..., 1:][closed].any()


def test_the_simulated_shares_are_those_of_the_plates(made: Path) -> None:
    provenance = json.loads((made / "provenance.json").read_text())
    left, right = provenance["figures"]["outlets"]
    assert (left["name"], left["share"], right["share"]) == ("left", SHARE, 0.4)
    assert left["measured_share"] == pytest.approx(SHARE, abs=0.04)
    gates = {gate["name"]: gate["passed"] for gate in provenance["quality"]}
    assert gates["share of an outlet in the flow apart from the one asked for"]


def test_the_files_for_other_programs_hold_the_field(made: Path) -> None:
    field = Field.load(made / "field.npz")
    lines = (made / "comsol" / "w_grid.txt").read_text().splitlines()
    assert (lines[0], lines[4]) == ("% Grid", "% Data")
    assert [len(line.split()) for line in lines[1:4]] == [*reversed(field.grid.shape)]
    values = np.array([list(map(float, line.split())) for line in lines[5:]]).reshape(field.grid.shape)
    own = 0.5 * (field.flux_z[1:] + field.flux_z[:-1]) * field.velocity_scale
    np.testing.assert_allclose(values, own, rtol=1e-12)
    for name in ("field.vtr", "report.html", "figures/space_w.png", "figures/vessel.png"):
        assert (made / name).stat().st_size > 1000


def test_python_reads_the_flow_at_the_rate_of_the_process(made: Path) -> None:
    result = granpipe.load_result(made)
    assert isinstance(result.field, SpaceFlow)
    assert result.model == "dem"
    x, y = np.meshgrid(np.linspace(-0.049, 0.049, 99), np.linspace(-0.0195, 0.0195, 40))
    w = result.field.velocity(x, y, np.full(x.shape, 0.035))[2]
    density = result.figures["bulk_density_kg_per_m3"]
    assert -np.nanmean(w) * 0.1 * 0.04 * density == pytest.approx(100 / 3600, rel=0.05)


def test_nothing_is_left_to_do_the_second_time(made: Path) -> None:
    changes = {"dem.max_time": "1 s", "dem.ranks": "1", "contact.youngs_modulus": "2e6 Pa"}
    outcome, stages = run(read_case(made.parent.parent / "case.yaml", changes), made.parent)
    assert not outcome.made
    assert not stages
