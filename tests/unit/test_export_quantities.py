"""What a case asks for beside the flow, in the files of other programs and in pictures: process scale, no holes."""

from dataclasses import replace
from datetime import datetime

import meshio
import numpy as np
import pytest
from fakes.synthetic import SCALE, field_of, hopper, pipe
from scipy.io import netcdf_file

from granpipe.errors import DataError
from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported
from granpipe.export.netcdf import write_netcdf
from granpipe.export.pictures import PANELS, panel_figure, rz_figures
from granpipe.export.quantities import QUANTITIES, on_nodes
from granpipe.export.vtk import write_vtu
from granpipe.field import _EXTRA, FLOW_RATE_POWER
from granpipe.pipeline.extra_fields import with_derived

POWERS = {"pressure": 0, "shear_rate": 1, "granular_temperature": 2, "coordination": 0, "age": -1, "mixing_index": 0}


def made(vessel=None):
    """A field with 2 in every cell of what is asked for, but unknown in some; errors of 0.5."""
    field = field_of(vessel or pipe(), 0.1)
    values = np.where(np.arange(field.grid.shape[1]) < 2, np.nan, 2.0) * np.ones(field.grid.shape)
    extra = {name: values if name != "pressure" else np.nan_to_num(values, nan=2.0) for name in POWERS}
    return replace(field, extra=extra | {"shear_rate_se": 0.25 * values, "pressure_se": 0.25 * extra["pressure"]})


def exported(field):
    return Exported(field, "case", 1000.0, datetime(2026, 1, 1))


def test_every_quantity_has_a_place_in_the_field():
    assert set(QUANTITIES) < set(_EXTRA)
    assert set(FLOW_RATE_POWER) < set(QUANTITIES)


@pytest.mark.parametrize(("name", "power"), POWERS.items())
def test_columns_are_at_the_flow_rate_of_the_process_and_have_no_holes(name, power):
    columns = {column.name: column.values for column in exported(made()).columns}
    assert columns[name] == pytest.approx(2 * SCALE**power, rel=1e-12)


def test_columns_have_their_errors_and_nothing_that_nobody_asked_for():
    columns = {column.name: column for column in exported(made()).columns}
    assert columns["shear_rate_se"].values == pytest.approx(0.5 * SCALE, rel=1e-12)
    assert "age_se" not in columns
    assert "stress_rr" not in columns
    plain = {column.name for column in exported(field_of(pipe(), 0.1)).columns}
    assert plain.isdisjoint(QUANTITIES)


def test_comsol_gets_them_as_functions(tmp_path):
    write_comsol(exported(made()), tmp_path)
    lines = (tmp_path / "flow_spreadsheet.txt").read_text().splitlines()
    head = next(number for number, line in enumerate(lines) if line.startswith("% r "))
    titles = lines[head].removeprefix("%").replace(" (", "_(").split()
    row = dict(zip(titles, map(float, lines[head + 1].split()), strict=True))
    assert row["granular_temperature_(m^2/s^2)"] == pytest.approx(2 * SCALE**2)
    assert row["age_(s)"] == pytest.approx(2 / SCALE)
    assert "nan" not in (tmp_path / "flow_sectionwise.txt").read_text().lower()
    program = (tmp_path / "import_comsol.java").read_text()
    assert '"pressure"' in program
    assert '"Pa"' in program


def test_netcdf_knows_their_units(tmp_path):
    write_netcdf(exported(made()), tmp_path / "flow.nc")
    with netcdf_file(tmp_path / "flow.nc", mmap=False) as file:
        assert file.variables["granular_temperature"].units == b"m2 s-2"
        assert file.variables["shear_rate"].units == b"s-1"
        assert file.variables["pressure"][:].copy() == pytest.approx(2)


def test_vtk_has_them_in_the_cells_and_leaves_holes(tmp_path):
    write_vtu(made(), tmp_path / "field.vtu")
    data = meshio.read(tmp_path / "field.vtu").cell_data
    shear = data["shear_rate"][0]
    assert shear[np.isfinite(shear)] == pytest.approx(2 * SCALE)
    assert 0 < np.isnan(shear).sum() < len(shear)
    assert data["pressure"][0] == pytest.approx(2)


def test_nodes_take_the_mean_of_known_cells_and_the_nearest_elsewhere():
    nodes = exported(field_of(hopper(), 0.05)).nodes
    values = np.where(nodes.cells, np.arange(nodes.cells.shape[1], dtype=float), np.nan)
    found = on_nodes(values, nodes)
    assert found[4, 1] == pytest.approx(0.5)
    assert found[4, 0] == pytest.approx(0)
    assert not found[~nodes.solids].any()
    values[:, :2] = np.nan
    assert on_nodes(values, nodes)[4, :3] == pytest.approx([2, 2, 2])
    assert not on_nodes(np.full(nodes.cells.shape, np.nan), nodes).any()


def test_each_has_its_picture(tmp_path):
    files = {path.name for path in rz_figures(made(), [(0.5, 1.0), (0.5, 0.0)], {}, tmp_path)}
    assert {f"rz_{name}.png" for name in POWERS} < files
    plain = {path.name for path in rz_figures(field_of(pipe(), 0.1), [(0.5, 1.0), (0.5, 0.0)], {}, tmp_path)}
    assert plain.isdisjoint({f"rz_{name}.png" for name in POWERS})


def test_what_was_not_asked_for_is_not_drawn():
    assert set(POWERS) < set(PANELS)
    with pytest.raises(DataError, match=r"homogenize\.fields"):
        panel_figure(field_of(pipe(), 0.1), "pressure", [(0.5, 1.0), (0.5, 0.0)], {}, None)


def test_the_age_is_the_way_from_the_inlet_over_the_speed():
    field, _ = with_derived(field_of(pipe(), 0.05), ["age"])
    speed = 0.02 / (np.pi * 0.25)  # of the plug, at DEM scale
    exact = (1.0 - field.grid.z_centres) / speed
    assert field.extra["age"] == pytest.approx(exact[:, None] * np.ones(field.grid.shape), rel=1e-6)
    field.check()


def test_a_field_keeps_what_is_not_known(tmp_path):
    field = made()
    field.save(tmp_path / "field.npz")
    back = type(field).load(tmp_path / "field.npz")
    assert np.array_equal(back.extra["age"], field.extra["age"], equal_nan=True)
    with pytest.raises(DataError, match="pressure is not finite"):
        replace(field, extra={"pressure": field.extra["age"]}).save(tmp_path / "field.npz")
