"""The files for other programs, read by other readers than granpipe's: axes, units, voids, and the flow through levels.

The truth is the analytic flow of `fakes.synthetic`; VTK reads OpenFOAM, XDMF and NetCDF, xarray the CF attributes; for
the formats that no library reads, the parsers here follow the programs' own descriptions.
"""

import csv
import re
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import pyvista
import xarray
from fakes.synthetic import FLOW, PACKING, SCALE, Vessel, field_of, hopper, pipe, ring_vessel
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

from granpipe.analysis.residence_time import residence_time
from granpipe.analysis.streamlines import age, streamlines
from granpipe.export.exported import Exported
from granpipe.export.fluent import write_fluent
from granpipe.export.moose import write_moose
from granpipe.export.netcdf import write_netcdf
from granpipe.export.ngsolve import write_ngsolve
from granpipe.export.openfoam import WEDGE, write_openfoam
from granpipe.export.starccm import write_starccm
from granpipe.export.streamlines import write_streamlines
from granpipe.export.xdmf import write_xdmf

CELL = 0.025
LEVEL = 1.45  # between rows of the grid, in the widening above the ring
Q = FLOW * SCALE
VESSELS = {"ring": ring_vessel(), "hopper": hopper(), "pipe": pipe(1.0)}


def exported(vessel: Vessel, **kind: bool) -> Exported:
    return Exported(field_of(vessel, CELL, **kind), "ring-1", 1000.0, datetime(2026, 11, 28, 12, 0))


@pytest.fixture(params=VESSELS)
def vessel(request) -> Vessel:
    return VESSELS[request.param]


def flow_down(r: np.ndarray, w: np.ndarray, wall: float) -> float:
    """−∫ 2πr w dr over points of one level, w linear between them."""
    order = np.argsort(r)
    r, w = r[order], w[order]
    w = np.append(w[r < wall], np.interp(wall, r, w))  # up to the wall, which lies between points
    r = np.append(r[r < wall], wall)
    return -sum(
        np.pi / 3 * (b - a) * (v * (2 * a + b) + x * (a + 2 * b)) for (a, v), (b, x) in pairwise(zip(r, w, strict=True))
    )


def level(vessel: Vessel) -> float:
    """A level amid the vessel, on a row of nodes."""
    return round(0.6 * vessel.wall[0][1] / CELL) * CELL


def check_points(vessel: Vessel, r, z, u, w, tolerance: float) -> None:
    """Velocity in the flow, away from its edge, and the flow through one level."""
    amid = r < vessel.boundary(z) - 2 * CELL
    true_u, true_w = vessel.bulk_velocity(r[amid], z[amid])
    scale = np.abs(true_w).max()
    assert np.abs(w[amid] - true_w).max() < 0.02 * scale
    assert np.abs(u[amid] - true_u).max() < 0.02 * scale
    here = np.abs(z - level(vessel)) < 1e-9
    (top, z_top), (bottom, z_bottom) = vessel.wall
    wall = np.interp(level(vessel), [z_bottom, z_top], [bottom, top])
    assert flow_down(r[here], w[here], wall) == pytest.approx(Q, rel=tolerance)


# ---- OpenFOAM ----


def foam_list(text: str) -> list[str]:
    """Items of the first list in a file of OpenFOAM, by the rules of its file format."""
    body = text[text.index("}") + 1 :]
    count, rest = re.search(r"(\d+)\s*\(\s*\n(.*?)\n\)", body, re.DOTALL).groups()
    items = rest.splitlines()
    assert len(items) == int(count)
    return items


def vectors(items: list[str]) -> np.ndarray:
    return np.array([item.strip("()").split() for item in items], dtype=float)


def entry(text: str, name: str) -> str:
    """The block of a patch."""
    return re.search(rf"^{name} \{{(.*?)^\}}", text, re.DOTALL | re.MULTILINE).group(1)


@pytest.fixture
def foam(vessel, tmp_path) -> Path:
    write_openfoam(exported(vessel), tmp_path)
    return tmp_path


def test_openfoam_mesh_is_what_checkmesh_asks_for(foam: Path) -> None:
    mesh = {path.name: path.read_text() for path in (foam / "constant/polyMesh").iterdir()}
    points = vectors(foam_list(mesh["points"]))
    faces = [list(map(int, re.search(r"\((.*)\)", item).group(1).split())) for item in foam_list(mesh["faces"])]
    owner, neighbour = (np.array(foam_list(mesh[name]), dtype=int) for name in ("owner", "neighbour"))
    count = owner.max() + 1
    inside = len(neighbour)
    assert (owner[:inside] < neighbour).all()
    assert (np.diff(owner[:inside] * count + neighbour) > 0).all()  # upper triangular order
    patches = re.findall(r"(\w+) \{ type (\w+); nFaces (\d+); startFace (\d+); \}", mesh["boundary"])
    assert [int(start) for *_, start in patches] == list(np.cumsum([inside, *(int(n) for *_, n, _ in patches)])[:-1])
    area, centre = np.zeros((len(faces), 3)), np.zeros((len(faces), 3))
    for number, face in enumerate(faces):
        corner = points[face]
        area[number] = 0.5 * np.cross(corner[1:-1] - corner[0], corner[2:] - corner[0]).sum(axis=0)
        centre[number] = corner.mean(axis=0)
    closed = np.zeros((count, 3))
    np.add.at(closed, owner, area)
    np.subtract.at(closed, neighbour, area[:inside])
    assert np.abs(closed).max() < 1e-15  # every cell is closed
    volume = np.zeros(count)
    np.add.at(volume, owner, (centre * area).sum(axis=1) / 3)
    np.subtract.at(volume, neighbour, (centre * area)[:inside].sum(axis=1) / 3)
    assert (volume > 0).all()  # and its faces look outwards
    for name, kind, size, start in patches:
        normal = area[int(start) : int(start) + int(size)]
        if kind == "wedge":
            assert np.allclose(normal / np.linalg.norm(normal, axis=1)[:, None], normal[0] / np.linalg.norm(normal[0]))
        if name in ("inlet", "outlet"):
            assert (normal[:, 2] * (1 if name == "inlet" else -1) > 0).all()


def test_openfoam_flux_is_that_of_the_field_and_balances_in_every_cell(foam: Path) -> None:
    mesh = {path.name: path.read_text() for path in (foam / "constant/polyMesh").iterdir()}
    owner, neighbour = (np.array(foam_list(mesh[name]), dtype=int) for name in ("owner", "neighbour"))
    text = (foam / "0/phi").read_text()
    flux = np.array(foam_list(text[: text.index("boundaryField")]), dtype=float)
    balance = np.zeros(owner.max() + 1)
    np.add.at(balance, owner[: len(neighbour)], flux)
    np.subtract.at(balance, neighbour, flux)
    start = len(neighbour)
    through = {}
    for name in ("inlet", "outlet", "walls"):
        values = np.array(foam_list("}" + entry(text, name)), dtype=float)
        np.add.at(balance, owner[start : start + len(values)], values)
        start += len(values)
        through[name] = values
    sector = Q * np.sin(WEDGE) / (2 * np.pi)
    assert through["inlet"].sum() == pytest.approx(-sector, rel=1e-9)
    assert through["outlet"].sum() == pytest.approx(sector, rel=1e-9)
    assert abs(through["walls"].sum()) < 1e-9 * sector
    assert np.abs(balance).max() < 1e-9 * sector


def test_openfoam_flux_has_the_value_on_every_patch_without_which_it_is_not_read(foam: Path) -> None:
    text = (foam / "0/phi").read_text()
    for name in ("inlet", "outlet", "walls", "front", "back"):
        assert re.search(r"^value (nonuniform List<scalar>|uniform 0;)$", entry(text, name), re.MULTILINE)


def test_openfoam_velocity_as_vtk_reads_it_is_that_of_the_flow(vessel, foam: Path) -> None:
    (foam / "case.foam").touch()
    reader = pyvista.OpenFOAMReader(foam / "case.foam")
    reader.set_active_time_value(0.0)
    mesh = reader.read()["internalMesh"]
    x, _, z = mesh.cell_centers().points.T
    velocity = np.asarray(mesh.cell_data["U"])
    amid = x < vessel.boundary(z) - 2 * CELL
    true_u, true_w = vessel.bulk_velocity(x[amid], z[amid])
    assert np.abs(velocity[amid, 2] - true_w).max() < 0.02 * np.abs(true_w).max()
    assert np.abs(velocity[amid, 0] - true_u).max() < 0.02 * np.abs(true_w).max()
    at = level(vessel) + CELL / 2
    here = np.abs(z - at) < 1e-3 * CELL
    ring = np.round(x[here] / CELL - 0.5)  # the cell's number from the axis
    outer = np.minimum(CELL * (ring + 1), vessel.boundary(np.array([at]))[0])  # of a cell that the wall cuts, its part
    area = np.pi * np.maximum(0, outer**2 - (CELL * ring) ** 2)
    assert -(velocity[here, 2] @ area) == pytest.approx(Q, rel=0.03)


# ---- Tables of points ----


def fluent_profile(path: Path) -> tuple[str, dict[str, np.ndarray]]:
    """A point profile, read as nested lists."""
    words = re.findall(r"[()]|[^\s()]+", path.read_text())

    def parsed(at: int):
        items = []
        while words[at] != ")":
            if words[at] == "(":
                item, at = parsed(at + 1)
                items.append(item)
            else:
                items.append(words[at])
                at += 1
        return items, at + 1

    (head, *fields), end = parsed(1)
    assert end == len(words)
    assert head[1] == "point"
    assert all(len(field) == 1 + int(head[2]) for field in fields)
    return head[0], {field[0]: np.array(field[1:], dtype=float) for field in fields}


def test_fluent_takes_x_as_the_axis(vessel, tmp_path) -> None:
    write_fluent(exported(vessel), tmp_path)
    name, found = fluent_profile(tmp_path / "flow.prof")
    assert float(re.search(r"solids-(.*)-m3-per-s", name).group(1)) == pytest.approx(Q, rel=1e-12)
    check_points(vessel, found["y"], found["x"], found["radial-velocity"], found["axial-velocity"], 0.02)
    lines = [line for line in (tmp_path / "flow.csv").read_text().splitlines() if not line.startswith("#")]
    assert lines[:4] == ["[Name]", "solids", "", "[Data]"]
    rows = list(csv.reader(lines[4:]))
    table = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    assert table.keys() == found.keys()
    assert all((table[key] == found[key]).all() for key in found)
    void = found["solids"] == 0
    assert (found["axial-velocity"][void] == 0).all()


def test_starccm_table_has_the_axis_at_y_0_and_carries_its_flow_rate(vessel, tmp_path) -> None:
    write_starccm(exported(vessel), tmp_path / "flow.csv")
    with (tmp_path / "flow.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    table = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    assert rows[0][:4] == ["X", "Y", "Axial Velocity (m/s)", "Radial Velocity (m/s)"]
    check_points(vessel, table["Y"], table["X"], table["Radial Velocity (m/s)"], table["Axial Velocity (m/s)"], 0.02)
    assert table["Bulk Flow Rate (m^3/s)"] == pytest.approx(Q, rel=1e-12)
    assert table["Reference Density (kg/m^3)"] == pytest.approx(1000 * PACKING, rel=1e-12)


# ---- Grids ----


def moose_grid(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y and values [iy, ix]: comments off, AXIS lines, then DATA whose first axis varies fastest."""
    parts: dict[str, list[float]] = {}
    for line in path.read_text().splitlines():
        if line.startswith(("AXIS", "DATA")):
            parts[line] = values = []
        elif not line.startswith("#"):
            values.extend(map(float, line.split()))
    x, y = np.array(parts["AXIS X"]), np.array(parts["AXIS Y"])
    return x, y, np.array(parts["DATA"]).reshape(len(y), len(x))


def test_moose_grid_has_the_radius_along_x(vessel, tmp_path) -> None:
    write_moose(exported(vessel), tmp_path)
    x, y, w = moose_grid(tmp_path / "w_bulk.txt")
    *_, u = moose_grid(tmp_path / "u_bulk.txt")
    r, z = np.meshgrid(x, y)
    check_points(vessel, r.ravel(), z.ravel(), u.ravel(), w.ravel(), 0.03)
    files = re.findall(r"data_file = (\S+)", (tmp_path / "functions.i").read_text())
    assert sorted(files) == sorted(path.name for path in tmp_path.glob("*.txt"))
    assert repr(Q)[:8] in (tmp_path / "w_bulk.txt").read_text().split("AXIS")[0]


def test_ngsolve_voxels_are_indexed_z_first(vessel, tmp_path) -> None:
    write_ngsolve(exported(vessel), tmp_path)
    with np.load(tmp_path / "flow.npz", allow_pickle=False) as file:
        r, z = np.meshgrid(file["r"], file["z"])
        check_points(vessel, r.ravel(), z.ravel(), file["u_bulk"].ravel(), file["w_bulk"].ravel(), 0.03)
        assert float(file["flow_rate"]) == pytest.approx(Q, rel=1e-12)
    compile((tmp_path / "flow.py").read_text(), "flow.py", "exec")


def test_netcdf_follows_cf_and_is_missing_in_voids(vessel, tmp_path) -> None:
    write_netcdf(exported(vessel), tmp_path / "flow.nc")
    with xarray.open_dataset(tmp_path / "flow.nc") as data:
        assert data.attrs["Conventions"] == "CF-1.11"
        assert {data[name].attrs["units"] for name in ("r", "z")} == {"m"}
        assert data["z"].attrs["positive"] == "up"
        assert all({"units", "long_name"} <= one.attrs.keys() for one in data.data_vars.values())
        assert data["w_bulk"].attrs["units"] == "m s-1"
        assert data["flow_rate"].item() == pytest.approx(Q, rel=1e-12)
        solids = data["solids"].values == 1
        assert (np.isnan(data["w_bulk"].values) == ~solids).all()
    from vtkmodules.vtkIONetCDF import vtkNetCDFCFReader

    read = vtkNetCDFCFReader()
    read.SetFileName(str(tmp_path / "flow.nc"))
    read.SphericalCoordinatesOff()
    read.SetDimensions("(z, r)")
    read.Update()
    grid = pyvista.wrap(read.GetOutput())
    r, z, _ = grid.points.T.astype(float)
    check_points(vessel, r, z, *(np.nan_to_num(grid.point_data[name]) for name in ("u_bulk", "w_bulk")), 0.03)


def test_xdmf_holds_the_solids_alone(vessel, tmp_path) -> None:
    write_xdmf(exported(vessel), tmp_path / "flow.xdmf")
    reader = vtkXdmfReader()  # pyvista's own wants times
    reader.SetFileName(str(tmp_path / "flow.xdmf"))
    reader.Update()
    mesh = pyvista.wrap(reader.GetOutputDataObject(0))
    mesh = mesh[0] if isinstance(mesh, pyvista.MultiBlock) else mesh
    r, z, _ = np.asarray(mesh.points, dtype=float).T
    velocity = np.asarray(mesh.point_data["bulk_velocity"])
    check_points(vessel, r, z, velocity[:, 0], velocity[:, 1], 0.02)
    area = mesh.compute_cell_sizes(length=False, volume=False).cell_data["Area"]
    assert area == pytest.approx(CELL**2 / 2, rel=1e-5)
    assert "m^3/s of bulk" in (tmp_path / "flow.xdmf").read_text().split("<Xdmf")[0]


def test_standard_errors_go_with_the_velocities(tmp_path) -> None:
    from dataclasses import replace

    field = field_of(pipe(), 0.1)
    field = replace(field, flux_r_se=np.full_like(field.flux_r, 0.001), flux_z_se=np.full_like(field.flux_z, 0.002))
    given = Exported(field, "pipe", 1000.0, datetime(2026, 11, 28))
    write_starccm(given, tmp_path / "flow.csv")
    with (tmp_path / "flow.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = {float(row["Axial Velocity Error (m/s)"]) for row in rows if row["Solids"] == "1"}
    assert list(found) == pytest.approx([0.002 * SCALE / PACKING] * len(found))
    write_moose(given, tmp_path)
    assert moose_grid(tmp_path / "w_bulk_se.txt")[2].max() == pytest.approx(0.002 * SCALE / PACKING)


@pytest.mark.parametrize("kind", [{"with_psi": False}, {"with_packing": False}], ids=["no psi", "no packing"])
def test_what_a_field_does_not_know_is_not_written(kind, tmp_path) -> None:
    given = exported(hopper(), **kind)
    for write, target in ((write_fluent, tmp_path), (write_moose, tmp_path), (write_netcdf, tmp_path / "flow.nc"),
                          (write_xdmf, tmp_path / "flow.xdmf"), (write_ngsolve, tmp_path)):  # fmt: skip
        write(given, target)
    (tmp_path / "foam").mkdir()
    write_openfoam(given, tmp_path / "foam")
    missing = "psi" if "with_psi" in kind else "packing"
    assert not (tmp_path / f"{missing}.txt").exists()
    assert not (tmp_path / "foam/0" / missing).exists()
    with xarray.open_dataset(tmp_path / "flow.nc") as data:
        assert missing not in data


# ---- Streamlines ----


def test_streamlines_of_a_parabola_take_the_times_of_its_speeds(tmp_path) -> None:
    vessel, height = pipe(1.0), 1.0
    given = Exported(field_of(vessel, CELL / 4), "pipe", 1000.0, datetime(2026, 11, 28))
    write_streamlines(given, streamlines(given.field, 10), tmp_path / "streamlines.csv")
    lines = [line for line in (tmp_path / "streamlines.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    for number in range(1, 11):
        r, z, t = np.array([[float(row[key]) for key in ("r_m", "z_m", "t_s")] for row in rows
                            if row["streamline"] == str(number)]).T  # fmt: skip
        share = (number - 0.5) / 10
        within = 1 - np.sqrt(1 - share)  # t with 2t − t² = share
        assert r[0] == pytest.approx(0.5 * np.sqrt(within), abs=2e-3)
        assert np.ptp(r) < 1e-9
        assert (z[0], z[-1]) == (1.0, 0.0)
        _, w = vessel.bulk_velocity(r[:1], z[:1])
        assert t[-1] == pytest.approx(height / abs(w[0]), rel=0.03)  # w is constant across a cell
        assert (np.diff(t) > 0).all()


def test_streamlines_in_a_cone_are_straight_and_together_hold_all_solids() -> None:
    field = field_of(hopper(), 0.0125)
    found = streamlines(field, 40)
    for line in found[:-1]:
        assert line.leaves
        steepness = line.r / (0.2 + 0.3 * line.z)
        assert np.ptp(steepness) < 0.02
        # w = −Q / (π b²): t = π/Q ∫ b² dz
        true = np.pi / Q * (0.5**3 - 0.2**3) / 0.9
        assert line.time[-1] == pytest.approx(true, rel=0.03)
    stays = residence_time(field)
    assert np.mean([line.time[-1] for line in found]) == pytest.approx(stays.time.mean(), rel=0.03)


def test_age_in_a_pipe_is_the_way_over_the_speed_and_unknown_at_rest() -> None:
    vessel = pipe(0.0)
    field = field_of(vessel, 0.1)
    w = Q / (np.pi * 0.5**2)
    assert age(field) == pytest.approx(np.broadcast_to((1 - field.grid.z_centres)[:, None] / w, (10, 5)), rel=1e-9)
    ring = field_of(ring_vessel(), 0.05)
    ages = age(ring)
    r, z = np.meshgrid(ring.grid.r_centres, ring.grid.z_centres)
    at_rest = ring.bulk & (r > ring_vessel().boundary(z) + 0.08)
    assert at_rest.any()
    assert np.isnan(ages[at_rest]).all()
    assert np.isnan(ages[~ring.bulk]).all()
