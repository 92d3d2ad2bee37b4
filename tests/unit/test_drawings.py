"""Drawings of one vessel in every format give its free area; what is no vessel is refused with its coordinates."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.drawings import revolved_stl, write_csv, write_dxf, write_mphtxt, write_step

from granpipe.case.reader import read_case
from granpipe.drawings.read import Drawing, read_drawing
from granpipe.errors import CaseError
from granpipe.geometry.outline import Outline
from granpipe.geometry.section import mesh_section
from granpipe.system.gmsh_session import gmsh_session

WALL = [(1.0, 5.9), (1.0, 4.9), (0.5, 3.9), (0.5, 3.4), (1.156, 3.4), (1.156, 0.0)]
RING = [(0.75, 1.85), (1.156, 1.85), (1.156, 2.10), (0.75, 2.10)]
INSIDE = [*WALL[:-1], (1.156, 2.10), (0.75, 2.10), (0.75, 1.85), (1.156, 1.85), WALL[-1]]

HEIGHTS = np.linspace(0.003, 5.897, 983)


def free_area(z: float) -> float:
    """Of the reactor, by hand [m²]."""
    if z > 4.9:
        radius = 1.0
    elif z > 3.9:
        radius = 0.5 + 0.5 * (z - 3.9)
    elif z > 3.4:
        radius = 0.5
    else:
        radius = 0.75 if 1.85 < z < 2.1 else 1.156
    return math.pi * radius**2


def areas(drawing: Drawing, unit: float = 1.0) -> np.ndarray:
    section = drawing.section
    outline = Outline.of(section.wall * unit, {name: points * unit for name, points in section.obstacles.items()})
    return outline.area(HEIGHTS)


def scaled(points: list[tuple[float, float]], factor: float = 1.0, by: tuple[float, float] = (0.0, 0.0)):
    return [(factor * r + by[0], abs(factor) * z + by[1]) for r, z in points]


def layers(path: Path) -> Drawing:
    lines = [("wall", scaled(WALL, 1e3), False), ("obstacle_ring", scaled(RING, 1e3), True),
             ("dimensions", [(0, 0), (3e3, 7e3)], False), ("axis", [(0, -100), (0, 6000)], False)]  # fmt: skip
    return read_drawing(write_dxf(path / "layers.dxf", lines, insunits=4))


def by_shape(path: Path) -> Drawing:
    return read_drawing(write_dxf(path / "shape.dxf", [("0", WALL, False), ("0", RING, True)]), unit="m")


def both_halves(path: Path) -> Drawing:
    lines = [("0", scaled(points, side, (3.0, 0.0)), closed)
             for side in (1, -1) for points, closed in ((WALL, False), (RING, True))]  # fmt: skip
    return read_drawing(write_dxf(path / "halves.dxf", [*lines, ("0", [(2.0, 5.9), (4.0, 5.9)], False)], insunits=6))


def lying(path: Path) -> Drawing:
    lines = [("0", [(z, r) for r, z in points], closed) for points, closed in ((WALL, False), (RING, True))]
    return read_drawing(write_dxf(path / "lying.dxf", lines, insunits=6), up="x")


def table(path: Path) -> Drawing:
    return read_drawing(write_csv(path / "silo.csv", [WALL, [*RING, RING[0]]]), unit="m")


def decimal_commas(path: Path) -> Drawing:
    file = write_csv(path / "silo.csv", [WALL, [*RING, RING[0]]], ";")
    file.write_text(file.read_text().replace(".", ","))
    return read_drawing(file, unit="m")


def comsol_mesh(path: Path) -> Drawing:
    mesh = mesh_section(np.array(WALL), {"ring": np.array(RING)}, {})
    return read_drawing(write_mphtxt(path / "mesh.mphtxt", mesh.points.tolist(), mesh.triangles.tolist()), unit="m")


def cad_face(path: Path) -> Drawing:
    return read_drawing(write_step(path / "face.step", WALL, {"ring": RING}, turned=False))


def cad_body(path: Path) -> Drawing:
    return read_drawing(write_step(path / "body.step", WALL, {"ring": RING}, turned=True))


def surface(path: Path) -> Drawing:
    return read_drawing(revolved_stl(path / "wall.stl", INSIDE), unit="m")


@pytest.mark.parametrize(
    ("draw", "unit"),
    [(layers, 1e-3), (by_shape, 1), (both_halves, 1), (lying, 1), (table, 1), (decimal_commas, 1), (comsol_mesh, 1),
     (cad_face, 1), (cad_body, 1), (surface, 1)],
)  # fmt: skip
def test_every_format_gives_the_free_area_of_the_reactor(
    draw: Callable[[Path], Drawing], unit: float, tmp_path: Path
) -> None:
    expected = [free_area(z) for z in HEIGHTS]
    np.testing.assert_allclose(areas(draw(tmp_path), unit), expected, rtol=1e-6)


def test_obstacles_of_a_drawing_keep_the_names_of_their_layers(tmp_path: Path) -> None:
    assert list(layers(tmp_path).section.obstacles) == ["ring"]
    assert layers(tmp_path).unit == "mm"


def dxf_with(path: Path, draw: Callable[[Any], None]) -> Drawing:
    """The wall with what `draw` adds to the document."""
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 6
    document.modelspace().add_lwpolyline(WALL)
    draw(document)
    document.saveas(path / "made.dxf")
    return read_drawing(path / "made.dxf")


PLATE = [(0.2, 5.5), (0.4, 5.5), (0.3, 5.4)]


def test_every_copy_in_an_array_of_blocks_is_an_obstacle(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.blocks.new("plate").add_lwpolyline(PLATE, close=True)
        document.modelspace().add_blockref("plate", (0, 0), dxfattribs={"row_count": 3, "row_spacing": -0.2})

    found = dxf_with(tmp_path, draw).section.obstacles
    assert sorted(round(float(polygon[:, 1].max()), 6) for polygon in found.values()) == [5.1, 5.3, 5.5]


def test_what_a_drawing_hides_is_no_obstacle(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.layers.add("off").off()
        document.layers.add("frozen").freeze()
        for attributes in ({"layer": "OFF"}, {"layer": "frozen"}, {"invisible": 1}):
            document.modelspace().add_lwpolyline(PLATE, close=True, dxfattribs=attributes)

    assert not dxf_with(tmp_path, draw).section.obstacles


def test_what_is_drawn_is_read_or_refused_by_its_name(tmp_path: Path) -> None:
    narrow = {"scale_factor": 0.001}
    multiline = dxf_with(
        tmp_path, lambda document: document.modelspace().add_mline(PLATE, close=True, dxfattribs=narrow)
    )
    assert multiline.section.obstacles
    with pytest.raises(CaseError, match="layer 0: 3DFACE cannot be read"):
        dxf_with(tmp_path, lambda document: document.modelspace().add_3dface([(*point, 0) for point in PLATE]))
    dxf_with(tmp_path, lambda document: document.modelspace().add_text("a silo"))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0.5,3m\n0.5,1\n0.2,0.5\n0.2,0\n", "line 1: '0.5,3m' is not two numbers"),
        ("0.5,3.O\n0.5,1\n0.2,0\n", "line 1"),
        ("r,z\n0.5,3\n0.5,1\n0.2,0.5\n\n0.2,0\n", "line 6: a point alone"),
        ("r,z\n0.5,3\n\n0.5,1\n0.2,0.5\n0.2,0\n", "line 2: a point alone"),
    ],
)
def test_no_point_of_a_table_is_lost_without_a_word(tmp_path: Path, rows: str, message: str) -> None:
    (tmp_path / "wall.csv").write_text(rows)
    with pytest.raises(CaseError, match=message):
        read_drawing(tmp_path / "wall.csv", unit="m")


def test_an_arc_is_flattened_to_the_tolerance(tmp_path: Path) -> None:
    # a hemispherical bottom of radius 1 about (0, 1) that ends in an outlet of radius 0.6 at z = 0.2
    angles = (math.degrees(math.atan2(-0.8, 0.6)), 0.0)
    text = "0\nSECTION\n2\nENTITIES\n"
    text += "0\nLINE\n8\n0\n10\n1\n20\n3\n11\n1\n21\n1\n"
    text += f"0\nARC\n8\n0\n10\n0\n20\n1\n40\n1\n50\n{angles[0]!r}\n51\n{angles[1]!r}\n0\nENDSEC\n0\nEOF\n"
    (tmp_path / "arc.dxf").write_text(text)
    wall = read_drawing(tmp_path / "arc.dxf", unit="m", tolerance=1e-4).section.wall
    z = np.linspace(0.21, 0.99, 200)
    radius = np.interp(z, wall[::-1, 1], wall[::-1, 0])
    np.testing.assert_allclose(radius, np.sqrt(1 - (1 - z) ** 2), atol=2e-4)
    assert wall[-1] == pytest.approx((0.6, 0.2), abs=1e-9)


def test_a_sphere_on_the_axis_of_a_whole_section_has_one_edge_along_the_axis(tmp_path: Path) -> None:
    """Drawn as a circle, with both halves of the wall, away from x = 0."""
    angle = np.linspace(0, 2 * np.pi, 97)
    circle = np.column_stack([50 + 12 * np.cos(angle), 130 + 12 * np.sin(angle)])
    sides = [[(50 + s * 45, 200), (50 + s * 45, 90), (50 + s * 22, 40), (50 + s * 22, 0)] for s in (1, -1)]
    lines = [("0", side, False) for side in sides] + [("0", [tuple(point) for point in circle], True)]
    section = read_drawing(write_dxf(tmp_path / "kiln.dxf", lines, insunits=4)).section
    (sphere,) = section.obstacles.values()
    on_axis = sphere[sphere[:, 0] == 0]
    assert sorted(on_axis[:, 1].tolist()) == pytest.approx([118, 142])
    assert not [note for note in section.notes if "edge" in note]
    outline = Outline.of(section.wall, section.obstacles)
    assert outline.area(130) == pytest.approx(math.pi * (45**2 - 12**2), rel=1e-3)


def test_what_overhangs_becomes_an_obstacle_below_an_upright_wall(tmp_path: Path) -> None:
    wall = [(1.0, 4.0), (1.0, 2.0), (0.6, 2.3), (0.5, 1.0), (0.5, 0.0)]
    section = read_drawing(write_csv(tmp_path / "a.csv", [wall]), unit="m").section
    outline = Outline.of(section.wall, section.obstacles)
    assert (np.diff(section.wall[:, 1]) <= 0).all()
    # at z = 2.15 the lip reaches from r = 0.8, on its upper face, in to 0.6 − 0.1 · 0.15/1.3, on its lower face
    lip = 0.5 + 0.1 * 1.15 / 1.3
    assert outline.area(2.15) == pytest.approx(math.pi * (1.0 - 0.8**2 + lip**2), rel=1e-9)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([[(1, 4), (1, 2)], [(1, 1.99), (0.5, 1), (0.5, 0)]], r"a gap of 0\.01: a line ends at \(1, 1\.99\)"),
        ([[(0, 5), (1, 4), (0.5, 0)]], "no inlet: at z = 5 it ends in a point"),
        ([[(1, 4), (1, 2), (0, 0)]], "no outlet: at z = 0 it ends in a point"),
        ([[(1, 4), (0.5, 1), (0.5, 0), (0.6, 0), (0.6, 0.9), (1.1, 4), (1, 4)]], "the wall with its thickness"),
        ([[(1, 4), (1, 2), (0.5, 0)], [(0, 2), (1, 2)]], "a line crosses the vessel"),
        ([[(-1, 4), (1, 2), (0.5, 0)]], r"a negative radius at \(-1, 4\)"),
        ([[(1, 1), (1, 1)]], "all points are the same"),
        ([[(1, 4), (0.5, 1), (1.2, 2), (0.4, 3), (0.5, 0)]], r"a line crosses itself at \(0\.75862069, 2\.55172414\)"),
        ([[(1, 4), (1, 2), (0.5, 0)], [(0.3, 3), (0.6, 2.8)]], r"a loose line inside the vessel near \(0\.45, 2\.9\)"),
    ],
)
def test_what_is_no_vessel_is_refused_with_its_coordinates(lines, message: str, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=message):
        read_drawing(write_csv(tmp_path / "a.csv", lines), unit="m")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.dwg", b"AC1032", "save it as DXF"),
        ("a.mph", b"PK", "export its 2-D mesh as text"),
        ("a.xyz", b"", "not a format that is read"),
        ("a.csv", b"1,2\nx,3\n", "line 2: 'x,3' is not two numbers"),
        ("a.csv", "r,z\n1,2\n".encode("utf-16"), "no text in UTF-8"),
        ("a.dxf", b"0\nSECTION\n2\nENTITIES\n0\nLI", "not a DXF file that can be read"),
        ("a.stl", b"solid\nfacet", "no triangles can be read"),
        ("a.step", b"ISO-10303-21;", "not a STEP or BREP file"),
        ("a.mphtxt", b"0 1\n1\n5 mesh1\n1\n3 obj\n0 0 1\n4 Mesh\n4\n2\n9\n0\n1 2", "cut short"),
    ],
)
def test_a_file_that_is_no_drawing_is_refused_with_the_reason(
    name: str, content: bytes, message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CaseError, match=message):
        read_drawing(tmp_path / name, unit="m")


def test_a_vertex_number_beyond_every_integer_is_refused(tmp_path: Path) -> None:
    path = write_mphtxt(tmp_path / "mesh.mphtxt", [(0, 0), (1, 0), (1, 2)], [(0, 1, 2)])
    path.write_text(path.read_text().replace("0 1 2", f"0 1 {10**20}", 1))
    with pytest.raises(CaseError):
        read_drawing(path, unit="m")


def test_a_surface_of_points_with_one_coordinate_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 1\nv 2\nv 3\nf 1 2 3\n")
    with pytest.raises(CaseError):
        read_drawing(tmp_path / "a.obj", unit="m")


def test_a_square_vessel_is_not_turned_into_a_round_one(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="not a surface of revolution with 8 facets"):
        read_drawing(revolved_stl(tmp_path / "box.stl", [(1, 2), (1, 1), (0.5, 0)], facets=4), unit="m")


def test_a_box_in_a_step_file_is_said_to_be_no_body_of_revolution(tmp_path: Path) -> None:
    with gmsh_session("box") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 3)
        gmsh.model.occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.write(str(tmp_path / "box.step"))
    with pytest.raises(CaseError, match="its body of 3 m³ is not one of revolution"):
        read_drawing(tmp_path / "box.step", unit="m")


@pytest.mark.parametrize("corners", ["0 1 2", "-1 -2 -4"])
def test_corners_of_an_obj_file_that_are_not_there_are_refused(corners: str, tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf {corners}\n")
    with pytest.raises(CaseError, match="corners that are not there"):
        read_drawing(path, unit="m")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tolerance": 0.0}, "a tolerance of 0: it must be above 0"),
        ({"tolerance": float("nan")}, "a tolerance of nan"),
        ({"axis": float("nan")}, "an axis at nan"),
        ({"axis": 0.3}, "axis at r = 0: leave axis out"),
        ({"up": "z"}, "z points up: leave up out"),
    ],
)
def test_what_a_half_section_does_not_need_is_refused_and_not_passed_over(
    given: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(CaseError, match=message):
        read_drawing(write_csv(tmp_path / "a.csv", [WALL]), unit="m", **given)


def test_a_drawing_of_too_many_points_is_refused_at_once(tmp_path: Path) -> None:
    rows = [(1.0, 4 - k / 20_000) for k in range(60_001)]
    with pytest.raises(CaseError, match="holds 60001 points, 50000 at the most"):
        read_drawing(write_csv(tmp_path / "a.csv", [rows]), unit="m")


def test_a_device_is_no_drawing() -> None:
    with pytest.raises(CaseError, match="not a file"):
        read_drawing(Path(os.devnull))


CASE = """
name: drawn
outline: {{file: silo.dxf{more}}}
material: {{density: 1000, size: {{diameter: 3 cm}}}}
flow_rate: 1 m^3/h
"""


def test_a_case_takes_its_outline_from_a_drawing_beside_it(tmp_path: Path) -> None:
    write_dxf(tmp_path / "silo.dxf", [("wall", scaled(WALL, 1e3), False)], insunits=4)
    (tmp_path / "case.yaml").write_text(CASE.format(more=", sections: {top: [5900, 3900], rest: [3900, 0]}"))
    case = read_case(tmp_path / "case.yaml").case
    np.testing.assert_allclose(case.outline.wall, WALL, atol=1e-12)
    assert case.outline.sections["top"].z == (5.9, 3.9)
    assert "silo.dxf" not in case.to_yaml()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (", wall: [[1, 1], [1, 0]]", r"case\.yaml:3 outline\.wall: stands beside file: silo\.dxf"),
        (", up: down", r"case\.yaml:3 outline\.up: down; must be x"),
        (", axis: left", r"case\.yaml:3 outline\.axis: left"),
        (", unit: furlongs per week", "outline.unit"),
    ],
)
def test_a_wrong_key_beside_a_drawing_is_refused_at_its_line(more: str, message: str, tmp_path: Path) -> None:
    write_dxf(tmp_path / "silo.dxf", [("wall", WALL, False)], insunits=6)
    (tmp_path / "case.yaml").write_text(CASE.format(more=more))
    with pytest.raises(CaseError, match=message):
        read_case(tmp_path / "case.yaml")


def test_a_drawing_that_is_missing_is_told_at_its_line(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(CASE.format(more=""))
    with pytest.raises(CaseError, match=r"case\.yaml:3 outline\.file: .*silo\.dxf: No such file"):
        read_case(tmp_path / "case.yaml")
