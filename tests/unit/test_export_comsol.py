"""The COMSOL text files: their layout against COMSOL's own, their numbers against what they were made of."""

import os
import re
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from fakes.comsol_text import read_sections, read_spreadsheet
from fakes.synthetic import FLOW, PACKING, SCALE, field_of, pipe, ring_vessel

from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported
from granpipe.export.nodes import nodal_values

DATE = datetime(2026, 9, 2, 8, 5)

# Two by two points in the layout of COMSOL's own exports of an r–z grid.
OWN_EXPORT = """\
% Model:              furnace.mph
% Version:            COMSOL 5.3.0.260
% Date:               Sep 2 2026, 08:05
% Dimension:          2
% Nodes:              4
% Expressions:        1
% Description:        heat source
% Length unit:        m
% r                       z                        Q (W/m^3) @ t=0
0.1                       0.1                      0
0.30000000000000004       0.1                      1.5
0.1                       0.2                      -2.0000000000000004
0.30000000000000004       0.2                      1200
"""


@pytest.fixture(scope="module")
def field():
    return field_of(ring_vessel(), 0.05)


@pytest.fixture(scope="module")
def folder(field, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("comsol")
    write_comsol(Exported(field, "ring", 1000.0, DATE), folder)
    return folder


@pytest.fixture(params=["own layout", "real export"])
def comsol_export(request, tmp_path) -> Path:
    if request.param == "own layout":
        path = tmp_path / "export.txt"
        path.write_text(OWN_EXPORT)
        return path
    if "GRANPIPE_REFERENCE_DATA" not in os.environ:
        pytest.skip("GRANPIPE_REFERENCE_DATA does not say where COMSOL's own files are")
    return Path(os.environ["GRANPIPE_REFERENCE_DATA"]) / "comsol" / "tmsr_axisym_rz_grid_spreadsheet_v5.3.txt"


def test_spreadsheet_has_the_layout_of_a_comsol_export(comsol_export, field, tmp_path) -> None:
    theirs = read_spreadsheet(comsol_export)
    write_comsol(Exported(field, "ring", 1000.0, DATE), tmp_path)
    ours = read_spreadsheet(tmp_path / "flow_spreadsheet.txt")
    assert list(ours.entries) == list(theirs.entries)
    assert ours.heads[:2] == theirs.heads[:2] == ["r", "z"]
    assert ours.starts[1:3] == theirs.starts[1:3]
    assert all(re.fullmatch(r"\w+ \(\S+\)", head) for head in ours.heads[2:])
    assert re.fullmatch(r"\w+ \(\S+\) @ t=0", theirs.heads[2])
    for sheet, path in ((theirs, comsol_export), (ours, tmp_path / "flow_spreadsheet.txt")):
        lines = path.read_text().splitlines()
        row = lines[len(sheet.entries) + 2]  # the second point
        assert [match.start() for match in re.finditer(r"\S+", row)][:3] == [0, 26, 51]
        entry = {line.index(sheet.entries[key]) for key, line in zip(sheet.entries, lines, strict=False)}
        assert entry == {22}
        assert all(line == line.rstrip() for line in lines)
        assert sheet.rows[1, 1] == sheet.rows[0, 1]  # r varies fastest
        assert sheet.rows[1, 0] > sheet.rows[0, 0]
        assert len(sheet.rows) == int(sheet.entries["Nodes"])
        assert sheet.rows.shape[1] == 2 + int(sheet.entries["Expressions"])


def test_header_states_case_version_and_date(folder) -> None:
    entries = read_spreadsheet(folder / "flow_spreadsheet.txt").entries
    assert entries["Model"] == "ring"
    assert entries["Version"].startswith("granpipe ")
    assert entries["Date"] == "Sep 2 2026, 08:05"
    assert entries["Length unit"] == "m"


def test_spreadsheet_reads_back_bit_for_bit(field, folder) -> None:
    nodes, sheet = nodal_values(field), read_spreadsheet(folder / "flow_spreadsheet.txt")
    columns = dict(zip(sheet.heads, sheet.rows.T, strict=True))
    r, z = np.meshgrid(nodes.r, nodes.z)
    expected = {
        "r": r,
        "z": z,
        "u_bulk (m/s)": nodes.bulk_u,
        "w_bulk (m/s)": nodes.bulk_w,
        "u_particle (m/s)": nodes.particle_u,
        "w_particle (m/s)": nodes.particle_w,
        "packing (1)": nodes.packing,
        "solids (1)": nodes.solids,
        "psi (m^3/s)": nodes.psi,
    }
    assert list(columns) == list(expected)
    for head, values in expected.items():
        np.testing.assert_array_equal(columns[head], values.ravel(), err_msg=head)


def test_grids_read_back_bit_for_bit(field, folder) -> None:
    nodes = nodal_values(field)
    files = {"u": nodes.bulk_u, "w": nodes.bulk_w, "phi": nodes.packing}
    for name, values in files.items():
        blocks = read_sections(folder / f"{name}_grid.txt")
        assert list(blocks) == ["Grid", "Data"]
        np.testing.assert_array_equal(blocks["Grid"][0], nodes.r)
        np.testing.assert_array_equal(blocks["Grid"][1], nodes.z)
        np.testing.assert_array_equal(blocks["Data"], values)


def test_psi_interpolated_in_r_squared_conserves_exactly_and_is_the_flow(folder) -> None:
    vessel = ring_vessel()
    blocks = read_sections(folder / "psi_grid.txt")
    square, z, psi = np.array(blocks["Grid"][0]), np.array(blocks["Grid"][1]), blocks["Data"]
    assert (psi[:, 0] == 0).all()
    np.testing.assert_allclose(-2 * np.pi * psi[:, -1], FLOW * SCALE, rtol=1e-12)
    # inside a cell ψ is bilinear in (r², z): w = 2 ∂ψ/∂(r²), u = −(1/r) ∂ψ/∂z at the middle of each cell
    s = 0.5 * (square[1:] + square[:-1])
    w = (np.diff(psi, axis=1) / np.diff(square))[1:] + (np.diff(psi, axis=1) / np.diff(square))[:-1]
    slope = np.diff(psi, axis=0) / np.diff(z)[:, None]
    u = -0.5 * (slope[:, 1:] + slope[:, :-1]) / np.sqrt(s)
    true_u, true_w = vessel.bulk_velocity(np.sqrt(s)[None, :], 0.5 * (z[1:] + z[:-1])[:, None])
    scale = np.abs(true_w).max()
    assert np.abs(w - true_w).max() < 0.05 * scale
    assert np.abs(u - true_u).max() < 0.05 * scale


def test_sectionwise_holds_triangles_of_the_solids_alone(field, folder) -> None:
    nodes, vessel = nodal_values(field), ring_vessel()
    blocks = read_sections(folder / "flow_sectionwise.txt")
    points, corners = blocks["Coordinates"], blocks["Elements (triangles)"].astype(int)
    assert corners.min() == 1
    assert corners.max() == len(points) == nodes.solids.sum()
    r, z = points[corners - 1].mean(axis=1).T
    assert vessel.inside(r, z).all()
    centre = [(np.floor(x / 0.05) + 0.5) * 0.05 for x in (r, z)]
    assert not vessel.void(*centre).any()
    for head, values in {
        "u_bulk (m/s)": nodes.bulk_u,
        "w_bulk (m/s)": nodes.bulk_w,
        "packing (1)": nodes.packing,
    }.items():
        np.testing.assert_array_equal(blocks[f"Data ({head})"].ravel(), values[nodes.solids])


def test_levels_table_states_flow_and_divergence(field, tmp_path) -> None:
    balance = write_comsol(Exported(field, "ring", 1000.0, DATE), tmp_path)
    text = (tmp_path / "flow_levels.txt").read_text()
    table = np.loadtxt(tmp_path / "flow_levels.txt", comments="%")
    np.testing.assert_array_equal(table[:, 0], field.grid.z_edges)
    np.testing.assert_allclose(table[:, 1], FLOW * SCALE, rtol=1e-12)
    np.testing.assert_array_equal(table[:, 3], balance.sectionwise)
    for label, value in {
        "flow rate (m^3/s)": balance.flow_rate,
        "divergence, maximum (1/s)": balance.divergence_max,
        "divergence, RMS (1/s)": balance.divergence_rms,
        "false source (1)": balance.false_source,
    }.items():
        assert float(re.search(rf"% {re.escape(label)}: +(\S+)", text)[1]) == value


def test_every_file_is_ascii_with_unix_line_ends_and_without_nan(folder) -> None:
    files = sorted(folder.iterdir())
    assert [file.name for file in files] == [
        "flow_levels.txt",
        "flow_sectionwise.txt",
        "flow_spreadsheet.txt",
        "import_comsol.java",
        "import_comsol.py",
        "phi_grid.txt",
        "psi_grid.txt",
        "u_grid.txt",
        "w_grid.txt",
    ]
    for file in files:
        data = file.read_bytes()
        assert data.isascii()
        assert b"\r" not in data
        assert data.endswith(b"\n")
        assert not data.endswith(b"\n\n")
        if file.suffix == ".txt":
            assert not re.search(rb"nan|inf(?!o)|-0(?![.\d])", data, re.IGNORECASE)


def test_what_the_model_does_not_know_has_no_file_and_no_column(tmp_path) -> None:
    field = field_of(pipe(), 0.1, with_psi=False, with_packing=False)
    write_comsol(Exported(field, "pipe", 1000.0, DATE), tmp_path)
    assert not (tmp_path / "psi_grid.txt").exists()
    assert not (tmp_path / "phi_grid.txt").exists()
    heads = read_spreadsheet(tmp_path / "flow_spreadsheet.txt").heads
    assert heads == ["r", "z", "u_bulk (m/s)", "w_bulk (m/s)", "solids (1)"]
    java = (tmp_path / "import_comsol.java").read_text()
    assert "psi_r2" not in java
    assert "particle" not in java
    assert '"u_solids", "flow_rate/flow_ref*u_bulk(r,z)"' in java


def test_reference_density_times_bulk_velocity_is_the_mass_flux(field, folder) -> None:
    java = (folder / "import_comsol.java").read_text()
    density = float(re.search(r'"rho_solids", "([\d.]+)\[kg/m\^3\]"', java)[1])
    packing = float(re.search(r'"packing_ref", "([\d.]+)"', java)[1])
    assert '"rho_ref", "rho_solids*packing_ref"' in java
    assert (density, packing) == (1000.0, PACKING)
    speed = -read_spreadsheet(folder / "flow_spreadsheet.txt").rows[0, 3]  # on the axis of the outlet
    mass_flux = 1000.0 * -ring_vessel().psi(1e-6, 0.0) * SCALE * 2 / 1e-12  # ρ_s φ w = ρ_s (1/r) ∂ψ/∂r there
    assert density * packing * speed == pytest.approx(mass_flux, rel=1e-3)
