"""The r–z mesh by gmsh: it fills the section, names its boundary and is fine where it must be."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from granpipe.errors import MeshError
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

HOPPER = np.array([[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4]])
SECTIONS = {"a": (5.9, 4.9), "b": (4.9, 3.9), "c": (3.9, 3.4)}
PIPE = np.array([[1.0, 2.0], [1.0, 0.0]])


def box(r0: float, r1: float, z0: float, z1: float) -> np.ndarray:
    return np.array([[r0, z0], [r1, z0], [r1, z1], [r0, z1]])


def areas(mesh: RZMesh) -> np.ndarray:
    a, b, c = mesh.points[mesh.triangles].transpose(1, 2, 0)
    return 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))


def lengths(mesh: RZMesh, prefix: str) -> float:
    return float(np.linalg.norm(np.diff(mesh.ends()[mesh.named(prefix)], axis=1), axis=2).sum())


def test_triangles_run_counter_clockwise_and_fill_the_section():
    mesh = mesh_section(HOPPER, {}, SECTIONS)
    assert areas(mesh).min() > 0
    assert areas(mesh).sum() == pytest.approx(1.0 + 0.75 + 0.25, rel=1e-12)


def test_every_boundary_edge_has_the_name_of_what_it_lies_on():
    mesh = mesh_section(HOPPER, {}, SECTIONS)
    expected = {"axis": 2.5, "inlet": 1, "outlet": 0.5, "wall:a": 1, "wall:b": 1.25**0.5, "wall:c": 0.5}
    assert set(mesh.names) == set(expected)
    for name, length in expected.items():
        assert lengths(mesh, name) == pytest.approx(length, rel=1e-12)


def test_walls_without_sections_are_named_by_piece():
    names = set(mesh_section(HOPPER, {}, {}).names)
    assert names == {"axis", "inlet", "outlet", "wall:1", "wall:2", "wall:3"}


def test_the_inside_is_on_the_left_of_every_boundary_edge():
    mesh = mesh_section(PIPE, {"o": box(0.4, 0.6, 0.8, 1.2)}, {})
    middle = mesh.ends().mean(axis=1) - 1e-3 * mesh.normals()
    in_pipe = (middle > [0, 0]).all(axis=1) & (middle < [1, 2]).all(axis=1)
    in_obstacle = (middle > [0.4, 0.8]).all(axis=1) & (middle < [0.6, 1.2]).all(axis=1)
    assert (in_pipe & ~in_obstacle).all()


def test_free_area_of_the_mesh_is_that_of_the_outline():
    mesh = mesh_section(HOPPER, {}, SECTIONS)
    z = np.array([5.0, 4.4, 3.5])
    np.testing.assert_allclose(mesh.free_area(z), np.pi * np.array([1, 0.75, 0.5]) ** 2, rtol=1e-12)


@pytest.mark.parametrize("corner", [(1.0, 4.9), (0.5, 3.9)])
def test_elements_at_wall_corners_are_ten_times_finer(corner):
    def size(mesh: RZMesh) -> float:
        at = np.flatnonzero(np.hypot(*(mesh.points - corner).T) < 1e-9)[0]
        ends = mesh.ends()[(mesh.edges == at).any(axis=1)]
        return float(np.linalg.norm(np.diff(ends, axis=1), axis=2).mean())

    graded, even = mesh_section(HOPPER, {}, SECTIONS), mesh_section(HOPPER, {}, SECTIONS, corner_refinement=1)
    assert 6 < size(even) / size(graded) < 14


@pytest.mark.parametrize(
    ("obstacle", "taken", "touching"),
    [
        (box(0.7, 1.0, 0.8, 1.2), 0.12, "wall"),
        (box(0.0, 0.3, 0.8, 1.2), 0.12, "axis"),
        (box(0.4, 0.6, 0.8, 1.2), 0.08, ""),
        (np.array([[0.8, 1.2], [1.0, 1.0], [0.8, 0.8], [0.6, 1.0]]), 0.08, ""),  # touches the wall in one point
    ],
)
def test_obstacles_are_cut_out(obstacle, taken, touching):
    mesh = mesh_section(PIPE, {"thing": obstacle}, {})
    assert areas(mesh).sum() == pytest.approx(2 - taken, rel=1e-12)
    assert lengths(mesh, "wall") == pytest.approx(2 - 0.4 * (touching == "wall"), rel=1e-12)
    assert lengths(mesh, "axis") == pytest.approx(2 - 0.4 * (touching == "axis"), rel=1e-12)
    assert mesh.named("obstacle:thing").any()


def test_axis_points_lie_on_the_axis_exactly():
    mesh = mesh_section(HOPPER / 3, {}, {})
    assert not mesh.ends()[mesh.named("axis")][..., 0].any()


def test_a_gap_gets_several_elements_across():
    mesh = mesh_section(PIPE, {"o": box(0.8, 0.99, 0.9, 1.1)}, {})
    inside = (mesh.points > [0.9901, 0.95]).all(axis=1) & (mesh.points < [0.9999, 1.05]).all(axis=1)
    assert inside.sum() > 3 * 0.1 / 0.01 * 3  # three rows, elements no longer than a third of the gap


def test_a_band_is_as_fine_as_asked_and_the_rest_is_not():
    coarse, banded = mesh_section(PIPE, {}, {}), mesh_section(PIPE, {}, {}, bands=[(0.4, 0.8, 0.02)])

    def largest(mesh: RZMesh, low: float, high: float) -> float:
        z = mesh.points[mesh.triangles, 1].mean(axis=1)
        return float(np.sqrt(4 / np.sqrt(3) * areas(mesh)[(z > low) & (z < high)].max()))

    assert largest(coarse, 0.4, 0.8) > 0.08
    assert largest(banded, 0.4, 0.8) < 0.03
    assert largest(banded, 1.4, 2.0) > 0.08


def test_outlet_has_fine_points_where_its_flow_jumps():
    mesh = mesh_section(PIPE, {}, {}, outlet_radii=(0.3, 0.6))
    r = np.sort(mesh.points[mesh.points[:, 1] == 0, 0])
    for radius in (0.3, 0.6):
        assert np.abs(r - radius).min() < 1e-12
        assert np.diff(r)[np.abs(r[1:] - radius).argmin()] < 0.03


def test_pockets_that_obstacles_close_off_are_left_out():
    c_shape = [[0.8, 1.5], [1, 1.5], [1, 1.4], [0.9, 1.4], [0.9, 1.2], [1, 1.2], [1, 1.1], [0.8, 1.1]]
    mesh = mesh_section(PIPE, {"c": np.array(c_shape)}, {})
    assert areas(mesh).sum() == pytest.approx(2 - 0.2 * 0.4, rel=1e-12)


def test_a_closed_way_is_refused():
    with pytest.raises(MeshError, match="no way from the inlet to the outlet"):
        mesh_section(PIPE, {"lid": box(0.0, 1.0, 0.9, 1.1)}, {})


def test_a_long_hairline_gap_is_refused_with_the_reason():
    with pytest.raises(MeshError, match="too long and narrow"):
        mesh_section(PIPE, {"tube": box(0.8, 0.9999, 0.1, 1.9)}, {})


def test_the_size_of_the_vessel_changes_nothing():
    small, large = (mesh_section(HOPPER * size, {}, {}) for size in (2.0**-10, 2.0**10))
    np.testing.assert_array_equal(small.triangles, large.triangles)
    np.testing.assert_array_equal(small.points * 2.0**20, large.points)


def test_gmsh_prints_nothing():
    code = (
        "import numpy as np; from granpipe.geometry.section import mesh_section; "
        f"mesh_section(np.array({HOPPER.tolist()}), {{}}, {{}})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=True)
    assert done.stdout == done.stderr == b""
