"""Revolved walls: areas, seams, angles, and the same bytes every time."""

import resource
import subprocess
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from granpipe.errors import MeshError
from granpipe.geometry.outline import Outline
from granpipe.geometry.walls import build_walls

REACTOR = [[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]
RING = [[0.75, 1.85], [1.156, 1.85], [1.156, 2.10], [0.75, 2.10]]


def cone(half_angle, r0, r1):
    height = (r0 - r1) / np.tan(np.radians(half_angle))
    return [[r0, height + 0.5], [r0, height], [r1, 0]]


@dataclass(frozen=True)
class Scene:
    wall: list
    obstacles: dict
    diameter: float = 0.06


SCENES = {
    "test reactor": Scene(REACTOR, {"ring": RING}, 0.12),
    "fine particles": Scene([[1, 2], [1, 0]], {}, 0.005),
    "hopper of 1°": Scene(cone(1, 0.5, 0.4), {}),
    "hopper of 85°": Scene(cone(85, 1.0, 0.05), {}),
    "outlet of a ten-thousandth of the inlet": Scene(cone(30, 1.0, 0.01), {}, 0.005),
    "tall pipe": Scene([[0.1, 20], [0.1, 0]], {}, 0.02),
    "twenty sections": Scene([[1 - 0.5 * (k % 2), 5 - 0.25 * k] for k in range(21)], {}),
    "cone on the axis": Scene([[1, 2], [1, 0]], {"cone": [[0, 1.5], [0.4, 1], [0, 1]]}),
    "needle on the axis": Scene([[1, 4], [1, 0]], {"needle": [[0, 3.5], [0.05, 1], [0, 0.5]]}),
    "rod on the axis": Scene([[1, 4], [1, 0]], {"rod": [[0, 3], [0.03, 3], [0.03, 1], [0, 1]]}),
    "free ring": Scene([[1, 2], [1, 0]], {"ring": [[0.4, 1], [0.6, 1], [0.5, 1.3]]}),
    "ring that touches the wall in a point": Scene([[1, 2], [1, 0]], {"ring": [[0.6, 1], [1, 1.1], [0.6, 1.2]]}),
    "gap of 1 mm": Scene([[1, 2], [1, 0]], {"disc": [[0, 1], [0.999, 1], [0.999, 1.2], [0, 1.2]]}),
    "step of 2 mm": Scene([[1, 2], [1, 1], [1.002, 1], [1.002, 0]], {}),
}


@pytest.fixture(scope="module", params=SCENES)
def scene(request, tmp_path_factory):
    chosen = SCENES[request.param]
    outline = Outline.of(chosen.wall, chosen.obstacles)
    folder = tmp_path_factory.mktemp("walls")
    walls = build_walls(
        outline,
        top=outline.z_top + 0.7,
        bottom=extension(outline),
        plate_z=outline.z_bottom - 4 * outline.outlet_radius,
        particle_diameter=chosen.diameter,
        folder=folder,
    )
    return request.param, outline, walls


def extension(outline):
    """Lower end of the wall mesh [m]."""
    return outline.z_bottom - 9 * outline.outlet_radius


def read_stl(path: Path):
    """(n, corner, xyz) as LIGGGHTS reads it."""
    words = [line.split()[1:] for line in path.read_text().splitlines() if line.split()[0] == "vertex"]
    return np.array(words, dtype=float).reshape(-1, 3, 3)


def section_area(corners, z):
    """Area inside the cut at height z by Green's theorem on the pieces that it cuts from the triangles."""
    area = 0.0
    for triangle in corners:
        height = triangle[:, 2] - z
        if height.min() >= 0 or height.max() <= 0:
            continue
        ends = []
        for i in range(3):
            a, b = i, (i + 1) % 3
            if height[a] * height[b] < 0:
                part = height[a] / (height[a] - height[b])
                ends.append(triangle[a] + part * (triangle[b] - triangle[a]))
            elif height[a] == 0:
                ends.append(triangle[a])
        (x0, y0, _), (x1, y1, _) = ends
        area += abs(x0 * y1 - x1 * y0) / 2
    return area


def test_every_horizontal_cut_has_the_area_of_its_circle(scene):
    name, outline, walls = scene
    off = 2 * 0.002 if name == "step of 2 mm" else 1e-9  # the step is left out, and the radius is off by as much
    corners = read_stl(walls.files["vessel"])
    rng = np.random.default_rng(1)
    for z in rng.uniform(extension(outline), outline.z_top + 0.7, 12):
        circle = np.pi * float(outline.wall_radius(z)) ** 2
        assert section_area(corners, z) == pytest.approx(circle, rel=off)


def test_plate_has_the_area_of_the_outlet_and_fills_it(scene):
    _, outline, walls = scene
    plate = read_stl(walls.files["plate"])
    sides = np.cross(plate[:, 1] - plate[:, 0], plate[:, 2] - plate[:, 0])
    area = np.linalg.norm(sides, axis=1).sum() / 2
    assert area == pytest.approx(np.pi * outline.outlet_radius**2, rel=1e-12)
    assert walls.plate_area == pytest.approx(area, rel=1e-12)
    assert np.ptp(plate[..., 2]) == 0
    assert section_area(
        read_stl(walls.files["vessel"]), outline.z_bottom - 3.937 * outline.outlet_radius
    ) == pytest.approx(area, rel=1e-9)


def edge_counts(corners):
    edges = Counter()
    for triangle in corners:
        points = [tuple(p) for p in triangle]
        edges.update(frozenset((points[i], points[(i + 1) % 3])) for i in range(3))
    return edges


def test_surfaces_are_closed_along_all_seams(scene):
    """No coordinate differs in its last digit where triangles meet; only true rims are open."""
    _, outline, walls = scene
    for name, path in walls.files.items():
        corners = read_stl(path)
        assert len(corners) == walls.triangles[name]
        counts = edge_counts(corners)
        assert max(counts.values()) == 2
        rim = [np.array([*edge]) for edge, n in counts.items() if n == 1]
        if name == "vessel":
            assert len(rim) == 2 * walls.facets
            assert levels(rim) == pytest.approx([extension(outline), outline.z_top + 0.7])
        elif name == "plate":
            assert len(rim) == walls.facets
        else:
            polygon = outline.obstacles[name.removeprefix("obstacle_")]
            on_wall = sorted(z for r, z in polygon if abs(r - outline.wall_radius(z, "above")) < 1e-9)
            assert levels(rim) == pytest.approx(on_wall if len(on_wall) > 1 else [])


def levels(edges):
    return sorted({edge[0, 2] for edge in edges})


def test_triangles_are_well_within_what_liggghts_takes(scene):
    _, _, walls = scene
    for path in walls.files.values():
        corners = read_stl(path)
        sides = corners - np.roll(corners, 1, axis=1)
        unit = sides / np.linalg.norm(sides, axis=2, keepdims=True)
        angles = np.arccos(-(unit * np.roll(unit, -1, axis=1)).sum(axis=2))
        assert angles.sum(axis=1) == pytest.approx(np.pi)
        assert np.degrees(angles.min()) >= 1.0
        assert angles.min() >= walls.smallest_angle * (1 - 1e-6)
        assert len({tuple(sorted(map(tuple, t))) for t in corners}) == len(corners)


def test_facets_stay_within_the_chord_error_and_are_no_more_than_needed(scene):
    name, outline, walls = scene
    allowed = 0.1 * SCENES[name].diameter
    chord = outline.r_max * (1 - np.cos(np.pi / walls.facets))
    assert chord <= allowed or walls.facets == 12
    if walls.facets > 12:
        assert outline.r_max * (1 - np.cos(np.pi / (walls.facets - 4))) > allowed
    corners = read_stl(walls.files["vessel"])
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)
    dent = outline.wall_radius(middles[:, 2]) - np.hypot(middles[:, 0], middles[:, 1])
    at_ledge = np.isin(middles[:, 2], outline.wall[:, 1])
    assert dent[~at_ledge].max() <= walls.inward + 1e-9 + (0.002 if "step" in name else 0)


def test_numbers_in_the_report_are_those_of_the_files(scene):
    _, _, walls = scene
    corners = np.concatenate([read_stl(path) for path in walls.files.values()])
    assert walls.sides[0][1] == pytest.approx(np.hypot(corners[..., 0], corners[..., 1]).max())
    assert walls.box == pytest.approx(np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))], axis=1))


def test_the_same_case_gives_the_same_bytes(tmp_path):
    outline = Outline.of(REACTOR, {"ring": RING})
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        build_walls(outline, top=6.9, bottom=-1, plate_z=-0.5, particle_diameter=0.12, folder=folder)
    names = [path.name for path in sorted((tmp_path / "a").iterdir())]
    assert names == ["obstacle_ring.stl", "plate.stl", "vessel.stl"]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_faces_on_wall_and_axis_are_left_out_and_an_open_outlet_has_no_plate(tmp_path):
    outline = Outline.of(REACTOR, {"ring": RING, "rod": [[0, 3], [0.2, 3], [0.2, 2.8], [0, 2.8]]})
    walls = build_walls(outline, top=6.9, bottom=0, plate_z=None, particle_diameter=0.12, folder=tmp_path)
    assert set(walls.files) == {"vessel", "obstacle_ring", "obstacle_rod"}
    radii = np.hypot(*np.moveaxis(read_stl(walls.files["obstacle_ring"])[..., :2], -1, 0))
    assert radii.min(axis=1).max() < 1.0  # no triangle has all its corners on the wall
    rod = read_stl(walls.files["obstacle_rod"])
    assert not (np.hypot(rod[..., 0], rod[..., 1]) < 1e-6).all(axis=1).any()


def test_an_edge_too_short_for_facets_is_refused_with_the_length_it_needs(tmp_path):
    outline = Outline.of([[3, 2], [3, 1], [3.0055, 1], [3.0055, 0]])
    with pytest.raises(MeshError, match=r"vessel: the edge from \[3, 1\] to \[3.005\d+, 1\].*make it at least"):
        build_walls(outline, top=2, bottom=0, plate_z=None, particle_diameter=0.05, folder=tmp_path)


def test_nothing_is_printed(tmp_path, capfd):
    build_walls(Outline.of(REACTOR), top=6, bottom=0, plate_z=-0.1, particle_diameter=0.2, folder=tmp_path)
    assert capfd.readouterr() == ("", "")


DECK = """
units si
atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes
soft_particles yes
region box block {box} units box
create_box 1 box
neighbor {skin:.3g} bin
neigh_modify delay 0
fix youngs all property/global youngsModulus peratomtype 1e6
fix poisson all property/global poissonsRatio peratomtype 0.35
fix restitution all property/global coefficientRestitution peratomtypepair 1 0.43
fix friction all property/global coefficientFriction peratomtypepair 1 0.73
pair_style gran model hertz tangential history
pair_coeff * *
timestep 1e-6
{meshes}
fix walls all wall/gran model hertz tangential history mesh n_meshes {count} meshes {names}
create_atoms 1 single 0 {y} {z}
set group all density 1000 diameter 0.002
fix integrate all nve/sphere
run 1
"""


def load_in_liggghts(files, box, folder, y=0.0):
    """What LIGGGHTS prints when it loads these meshes as walls round one particle and runs a step, and its status."""
    bounds = box + 0.1 * np.ptp(box, axis=1).max() * np.array([-1, 1])
    deck = DECK.format(
        box=" ".join(f"{x:.6g}" for x in bounds.ravel()),
        meshes="\n".join(f"fix {name} all mesh/surface file {path} type 1" for name, path in files.items()),
        count=len(files),
        names=" ".join(files),
        skin=0.02 * np.ptp(box, axis=1).max(),  # bins shrink with it, and there is but one particle
        y=y,
        z=box[2, 1] - 0.3,
    )
    (folder / "in.load").write_text(deck)
    command = ["timeout", "60", "liggghts", "-in", "in.load", "-log", "log.load"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr, done.returncode


@pytest.mark.liggghts
def test_liggghts_loads_the_walls_without_a_warning(scene, tmp_path):
    _, _, walls = scene
    said, status = load_in_liggghts(walls.files, walls.box, tmp_path)
    assert status == 0, said[-2000:]
    for name, count in walls.triangles.items():
        assert f"mesh {name} containing {count} triangle(s) successful" in said
    assert "WARNING" not in said
    assert "ERROR" not in said


SLAB = [[[-0.05, 0.2], [-0.05, 0.08], [-0.02, 0.03], [-0.02, 0.0]], [[0.03, 0.2], [0.03, 0.1], [0.02, 0.05], [0.02, 0]]]
BARS = {
    "none": {},
    "bar": {"bar": [[-0.01, 0.14], [0.01, 0.14], [0.0, 0.15]]},
    "bar and lip": {
        "bar": [[-0.01, 0.14], [0.01, 0.14], [0.0, 0.15]], "lip": [[-0.05, 0.15], [-0.05, 0.13], [-0.04, 0.135]],
    },
    "bar that touches the wall in an edge": {"bar": [[-0.05, 0.11], [-0.03, 0.10], [-0.03, 0.12]]},
}  # fmt: skip


@pytest.mark.liggghts
@pytest.mark.parametrize("depth", [0.02, 1.0])
@pytest.mark.parametrize("bars", BARS)
def test_liggghts_loads_a_slab_between_a_front_and_a_back_wall_without_a_warning(bars, depth, tmp_path):
    outline = Outline.of(SLAB[1], BARS[bars], {}, SLAB[0], depth, walled=True)
    walls = build_walls(outline, top=0.25, bottom=-0.2, plate_z=-0.1, particle_diameter=0.004, folder=tmp_path)
    said, status = load_in_liggghts(walls.files, walls.box, tmp_path, 0.5 * depth)
    assert status == 0, said[-2000:]
    for name, count in walls.triangles.items():
        assert f"mesh {name} containing {count} triangle(s) successful" in said
    assert "WARNING" not in said
    assert "ERROR" not in said


@pytest.mark.liggghts
def test_liggghts_does_warn_of_a_thin_triangle(tmp_path):
    corners = [(0, 0, 0), (1, 0, 0), (1, 0.007, 0)]  # 0.4°
    lines = [f"vertex {x} {y} {z}" for x, y, z in corners]
    (tmp_path / "thin.stl").write_text(
        "\n".join(["solid a", "facet normal 0 0 1", "outer loop", *lines, "endloop", "endfacet", "endsolid a", ""])
    )
    said, _ = load_in_liggghts({"thin": tmp_path / "thin.stl"}, np.array([[0, 1], [0, 1], [-1, 1]]), tmp_path)
    assert "WARNING" in said
    assert "skewed" in said


def test_a_file_that_does_not_fit_on_the_disk_is_found(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        with pytest.raises(MeshError, match="disk full"):
            build_walls(Outline.of(REACTOR), top=6, bottom=0, plate_z=None, particle_diameter=0.2, folder=tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
