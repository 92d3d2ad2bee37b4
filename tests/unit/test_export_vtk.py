"""field.vtu, read back by pyvista: cells, balance of the faces, velocities on the points."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from fakes.synthetic import PACKING, SCALE, field_of, pipe, ring_vessel

from granpipe.export.vtk import write_fluid_vtu, write_vtu


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    import pyvista

    path = tmp_path_factory.mktemp("vtk") / "field.vtu"
    write_vtu(field_of(ring_vessel(), 0.05), path)
    return pyvista.read(path)


def test_cells_fill_the_outline_in_the_plane_of_r_and_z(mesh) -> None:
    assert mesh.bounds == pytest.approx((0, 0.5, 0, 0, 0, 2))
    area = mesh.compute_cell_sizes()["Area"]
    assert area.sum() == pytest.approx(0.5 * 2 - 0.2 * 0.1)  # without the ring
    vessel, centres = ring_vessel(), mesh.cell_centers().points
    assert vessel.inside(centres[:, 0], centres[:, 2]).all()


def test_the_four_faces_of_every_cell_balance(mesh) -> None:
    corners = mesh.points[mesh.cell_connectivity.reshape(-1, 4)]
    (low_r, _, low_z), (high_r, _, high_z) = corners.min(axis=1).T, corners.max(axis=1).T
    out = 2 * np.pi * (high_z - low_z) * (high_r * mesh["solids_flux_outer"] - low_r * mesh["solids_flux_inner"])
    up = np.pi * (high_r**2 - low_r**2) * (mesh["solids_flux_upper"] - mesh["solids_flux_lower"])
    through = np.pi * (high_r**2 - low_r**2) * np.abs(mesh["solids_flux_lower"])
    assert np.abs(out + up).max() < 1e-12 * through.max()


def test_points_carry_the_analytic_velocity(mesh) -> None:
    on_axis = mesh.points[:, 0] == 0
    w = ring_vessel().bulk_velocity(0.0, mesh.points[on_axis, 2])[1]
    np.testing.assert_allclose(mesh["bulk_velocity"][on_axis, 2], w, rtol=0.04)
    assert (mesh["bulk_velocity"][:, 1] == 0).all()
    dense = mesh.points[:, 0] < 0.2  # away from the cavity φ = φ_ref everywhere
    np.testing.assert_allclose(mesh["particle_velocity"][dense], mesh["bulk_velocity"][dense], atol=1e-12)


def test_masks_and_packing_are_those_of_the_field(mesh) -> None:
    vessel, centres = ring_vessel(), mesh.cell_centers().points
    void = vessel.void(centres[:, 0], centres[:, 2])
    np.testing.assert_array_equal(mesh["bulk"], ~void)
    np.testing.assert_allclose(mesh["packing_fraction"], np.where(void, 0, PACKING))


def test_what_the_field_does_not_know_is_absent(tmp_path: Path) -> None:
    import pyvista

    field = field_of(pipe(), 0.1, with_psi=False, with_packing=False)
    write_vtu(field, tmp_path / "field.vtu")
    mesh = pyvista.read(tmp_path / "field.vtu")
    assert set(mesh.point_data) == {"bulk_velocity", "solids"}
    assert "packing_fraction" not in mesh.cell_data
    np.testing.assert_allclose(mesh["solids_flux_lower"], field.flux_z[0, 0] * SCALE, rtol=1e-12)


def test_a_fluid_keeps_its_mesh_and_velocity(tmp_path):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    u, w, psi = np.array([0.0, 0.1, 0.2]), np.array([-1.0, -2.0, -3.0]), np.array([0.0, -0.5, 0.0])
    write_fluid_vtu(points, np.array([[0, 1, 2]]), u, w, psi, tmp_path / "fluid.vtu")
    mesh = meshio.read(tmp_path / "fluid.vtu")
    np.testing.assert_allclose(mesh.points[:, [0, 2]], points)
    np.testing.assert_allclose(mesh.point_data["bulk_velocity"], np.column_stack([u, np.zeros(3), w]))
    assert mesh.cells_dict["triangle"].tolist() == [[0, 1, 2]]
