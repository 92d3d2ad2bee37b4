"""OBJ as programs write it: faces of many corners, normals, groups, corners counted backwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.drawings.surface import read_triangles
from granpipe.errors import CaseError

CUBE = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
SIDES = [(1, 2, 4, 3), (5, 6, 8, 7), (1, 2, 6, 5), (3, 4, 8, 7), (1, 3, 7, 5), (2, 4, 8, 6)]


def read(tmp_path: Path, faces: list[str], corners: list[tuple[float, ...]] | None = None) -> np.ndarray:
    """(n, 3, 3) the triangles that are read."""
    lines = ["# made by a program", "o vessel", *("v {} {} {}".format(*one) for one in corners or CUBE), "vn 0 0 1"]
    (tmp_path / "walls.obj").write_text("\n".join([*lines, "g first", "s off", *faces, ""]))
    points, triangles = read_triangles(tmp_path / "walls.obj")
    return points[triangles]


def area(triangles: np.ndarray) -> float:
    first, second, third = triangles.swapaxes(0, 1)
    return float(0.5 * np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())


@pytest.mark.parametrize("form", ["{}", "{}//1", "{}/3/1", "{}/2"])
def test_no_face_is_lost_whatever_else_stands_in_the_file(tmp_path: Path, form: str) -> None:
    """A cube of which some sides are quadrilaterals and some are triangles has an area of 6."""
    faces = []
    for k, (a, b, c, d) in enumerate(SIDES):
        parts = [(a, b, c, d)] if k % 2 else [(a, b, c), (a, c, d)]
        faces += ["f " + " ".join(form.format(one) for one in part) for part in parts]
        faces.append("usemtl steel" if k == 2 else "g next")
    triangles = read(tmp_path, faces)
    assert len(triangles) == 12
    assert area(triangles) == pytest.approx(6.0)


def test_corners_may_be_counted_backwards(tmp_path: Path) -> None:
    faces = ["f " + " ".join(str(one - 9) for one in side) for side in SIDES]
    assert area(read(tmp_path, faces)) == pytest.approx(6.0)


def test_a_hexagon_is_cut_and_a_face_with_a_notch_refused(tmp_path: Path) -> None:
    angle = np.arange(6) * np.pi / 3
    hexagon = [(float(np.cos(a)), 0.0, float(np.sin(a))) for a in angle]
    assert area(read(tmp_path, ["f 1 2 3 4 5 6"], hexagon)) == pytest.approx(1.5 * np.sqrt(3))
    notched = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 2.0, 0.0), (1.0, 0.5, 0.0), (0.0, 2.0, 0.0)]
    with pytest.raises(CaseError, match="line 11: a face of 5 corners is not convex"):
        read(tmp_path, ["f 1 2 3 4 5"], notched)


@pytest.mark.parametrize(
    ("face", "says"),
    [
        ("f 1 2 99", "corners that are not there"),
        ("f 1 2 0", "line 14: a face with corners that are not there"),
        (f"f 1 2 {10**20}", "line 14: a face with corners that are not there"),
        ("f 1 2", "line 14 is damaged"),
        ("f 1 2 x", "line 14 is damaged"),
        ("f 1 2 -9", "corners that are not there"),
        ("v 1 2\nf 1 2 3", "line 14 is damaged: 'v 1 2'"),
        ("v 1 2 nan\nf 1 2 9", "no numbers"),
        ("", "no triangles"),
    ],
)
def test_damaged_lines_are_refused_with_their_number(tmp_path: Path, face: str, says: str) -> None:
    with pytest.raises(CaseError, match=says):
        read(tmp_path, [face])


@pytest.mark.parametrize("name", ["walls.obj", "walls.stl"])
def test_a_file_that_would_fill_the_memory_is_refused_unread(tmp_path: Path, name: str) -> None:
    with (tmp_path / name).open("wb") as file:
        file.truncate(10**10)  # takes no room on the disk
    with pytest.raises(CaseError, match="10000 MB are more than 500 MB; make the mesh coarser"):
        read_triangles(tmp_path / name)
