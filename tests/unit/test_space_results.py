"""Results in space compared, drawn and scaled: two plug flows whose difference, and errors, are known."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from granpipe.analysis.compare import compare, thirds
from granpipe.case.reader import read_case
from granpipe.errors import CaseError, DataError
from granpipe.export.space import SPARSE, vtr_mesh, write_text
from granpipe.export.space_pictures import cut_figure
from granpipe.field import Box, Field, Grid
from granpipe.pipeline.plot import plot_result
from granpipe.pipeline.scale import scale_results
from granpipe.system.jsonfile import write_json
from granpipe.system.manifest import write_manifest

CASES = Path(__file__).parents[2] / "cases"
GRID = Box.within((-0.05, 0.05), (-0.02, 0.02), (0.0, 0.09), 0.005, flat=False, cut=True)
PACKING = 0.6


def plug(flux: float, noise: float = 0.0, seed: int = 0) -> Field:
    """Solids that sink everywhere at a flux [m/s], with noise of a standard error on all faces, and that error told."""
    shape, random = GRID.shape, np.random.default_rng(seed)
    x, y, z = (random.normal(0.0, noise, [n + (axis == k) for axis, n in enumerate(shape)]) for k in (2, 1, 0))
    area = GRID.ring_area.sum() * shape[1]
    told = {
        "flux_r_se": np.full_like(x, noise),
        "flux_y_se": np.full_like(y, noise),
        "flux_z_se": np.full_like(z, noise),
    }
    return Field(
        GRID, inside_fraction=np.ones(shape), packing_fraction=np.full(shape, PACKING), bulk=np.ones(shape, bool),
        flux_r=x, flux_y=y, flux_z=z - flux, bulk_flow=flux * area / PACKING, bulk_packing=PACKING, flow_scale=1.0,
        **(told if noise else {}),
    )  # fmt: skip


def test_the_difference_of_two_plug_flows_is_that_of_their_speeds() -> None:
    found = compare(plug(1.0), plug(1.1), thirds(GRID), 0.01)
    assert [one.name for one in found] == ["whole", "upper third", "middle third", "lower third"]
    for one in found:
        assert one.observed == pytest.approx(0.1)
        assert one.noise_free == pytest.approx(0.1)
        assert one.noise == 0
        assert one.verdict(0.05) == "differ"


def test_sidewise_flow_along_y_counts() -> None:
    moved = plug(1.0)
    assert moved.flux_y is not None
    aside = replace(moved, flux_y=moved.flux_y + 0.2)
    assert compare(plug(1.0), aside, {}, 0.01)[0].observed == pytest.approx(0.2)


def test_two_noisy_fields_of_one_flow_differ_by_their_noise_alone() -> None:
    """Noise that is not the same on two faces of a cell: half of its square is left in the middle of the cell."""
    (found,) = compare(plug(1.0, 0.2, 1), plug(1.0, 0.2, 2), {}, 0.01)
    assert found.observed == pytest.approx(found.noise / np.sqrt(2), rel=0.05)
    size = 1 + 3 * 0.2**2 / 2  # of the first field, noise included
    assert found.noise == pytest.approx(np.sqrt(2 * 3 * 0.2**2 / size), rel=0.01)
    assert found.noise_free == 0


def test_fields_that_do_not_lie_on_one_grid_are_refused() -> None:
    wider = replace(plug(1.0), grid=replace(GRID, y_edges=1.1 * GRID.y_edges))
    with pytest.raises(DataError, match="the grids differ"):
        compare(plug(1.0), wider, {}, 0.01)
    rings = Grid.covering(0.05, 0.0, 0.09, 0.005)
    shape = rings.shape
    flat = Field(
        rings, inside_fraction=np.ones(shape), packing_fraction=None, bulk=np.ones(shape, bool),
        flux_r=np.zeros((shape[0], shape[1] + 1)), flux_z=np.zeros((shape[0] + 1, shape[1])),
        bulk_flow=1.0, bulk_packing=PACKING, flow_scale=1.0,
    )  # fmt: skip
    with pytest.raises(DataError, match="one of the fields is in space"):
        compare(plug(1.0), flat, {}, 0.01)


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A results folder of a vessel in space."""
    folder = tmp_path / "two_outlets"
    folder.mkdir()
    plug(1e-3).save(folder / "field.npz")
    (folder / "case.yaml").write_text(read_case(CASES / "two_outlets.yaml").case.to_yaml())
    write_json(folder / "provenance.json", {"quality": []})
    write_manifest(folder)
    return folder


@pytest.mark.parametrize("cut", [None, ("y", 0.0), ("z", 0.089)])
def test_the_overview_and_cuts_are_drawn(results: Path, cut: tuple[str, float] | None) -> None:
    assert plot_result(results, "overview", None, results.parent / "picture.png", cut).stat().st_size > 10_000


def test_what_is_not_drawn_in_space_is_refused(results: Path) -> None:
    out = results.parent / "picture.png"
    with pytest.raises(DataError, match="or a cut: --cut"):
        plot_result(results, "packing", None, out)
    with pytest.raises(DataError, match="or a cut: --cut"):
        plot_result(results, "overview", 0.05, out)
    with pytest.raises(DataError, match=r"x = 0.06 m lies outside the field, -0.05 … 0.05 m"):
        cut_figure(plug(1.0), "x", 0.06, "")
    assert not out.exists()


def test_results_in_space_are_scaled_to_another_flow_rate(results: Path) -> None:
    case = read_case(results / "case.yaml", {"flow_rate": "50 kg/h"}).case
    assert not scale_results(results, case, results.parent / "half").failed
    made = Field.load(results.parent / "half" / "field.npz")
    assert made.bulk_flow * made.flow_scale == pytest.approx(50 / 3600 / 2500 / PACKING)
    lines = (results.parent / "half" / "comsol" / "w_grid.txt").read_text().splitlines()
    area = GRID.ring_area.sum() * GRID.shape[1]
    assert float(lines[5].split()[0]) == pytest.approx(-50 / 3600 / 2500 / PACKING / area, rel=1e-6)
    with pytest.raises(CaseError, match="free discharge through the outlet left"):
        scale_results(results, read_case(results / "case.yaml", {"flow_rate": "50 t/h"}).case, results.parent / "more")


def test_particles_have_one_velocity_in_whole_and_cut_cells_at_the_flow_rate_of_the_case(tmp_path: Path) -> None:
    """Sinking at 10 mm/s in the simulation, at 30 mm/s in the process: also where a wall leaves a quarter of the cell,
    and where solids are loose. A cell that no more than 1e-16 of solids was seen in has no speed beyond all bounds.
    """
    inside, packing = np.ones(GRID.shape), np.full(GRID.shape, PACKING)
    inside[:, 0], packing[:, -1] = 0.25, 0.2
    moving = 0.01 * inside * packing
    flux = np.concatenate([moving[:1], moving])
    packing[4, 3, 5] = 1e-16
    field = replace(plug(0.0), inside_fraction=inside, packing_fraction=packing, flux_z=-flux, flow_scale=3.0)
    mesh = vtr_mesh(field)
    shown = np.asarray(mesh.cell_data["particle_velocity"]).reshape(*GRID.shape, 3)
    write_text(field, tmp_path, name="plug", date=datetime(2026, 1, 1))
    table = np.loadtxt(tmp_path / "flow_spreadsheet.txt", comments="%")[:, 8].reshape(GRID.shape)
    seen = packing > 1e-3
    for velocity in (shown[..., 2], table):
        np.testing.assert_allclose(velocity[seen], -0.03, rtol=1e-12)
        assert velocity[~seen] == pytest.approx(-0.03 / SPARSE)
    solids = np.asarray(mesh.cell_data["solids_flux"]).reshape(*GRID.shape, 3)
    np.testing.assert_allclose(solids[..., 2], -3 * moving)
