"""A vessel in space: its openings, what lies inside it, where particles are put in, its walls for LIGGGHTS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fakes.space_walls import between, circle, rectangle, square_hopper, two_outlets, write_stl

from granpipe.case.vessel import OutletSpec
from granpipe.drawings.surface import read_triangles
from granpipe.errors import CaseError, MeshError
from granpipe.geometry.revolve import triangle_angles
from granpipe.geometry.space_vessel import SpaceVessel, sampled
from granpipe.geometry.space_walls import build_space_walls
from granpipe.geometry.wall_mesh import WallMesh

SIXTY_FORTY = {"left": OutletSpec(at=(-25, 0, 0), share=0.6), "right": OutletSpec(at=(25, 0, 0), share=0.4)}
CASES = Path(__file__).parents[2] / "cases"


def vessel(triangles: np.ndarray, outlets: dict[str, OutletSpec] | None = None, unit: float = 1e-3) -> SpaceVessel:
    """Made of triangles whose unit is a millimetre unless given."""
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    return SpaceVessel.of(unit * triangles.reshape(-1, 3), corners, outlets or {}, unit)


def test_the_shipped_walls_are_those_of_the_script() -> None:
    points, triangles = read_triangles(CASES / "two_outlets.stl")
    np.testing.assert_allclose(points[triangles], two_outlets())


def test_areas_and_volume_are_those_of_the_drawing() -> None:
    made = vessel(two_outlets(), SIXTY_FORTY)
    assert made.inlet.area == pytest.approx(100e-3 * 40e-3)
    assert [one.opening.area for one in made.outlets] == pytest.approx([32e-3**2] * 2)
    assert [one.gap for one in made.outlets] == pytest.approx([32e-3] * 2, rel=1e-3)
    hopper = 40e-9 * (32 * 32 + 50 * 40 + 4 * 41 * 36) / 6  # Simpson's rule is exact for a prismatoid
    assert made.outline.volume() == pytest.approx(100e-3 * 40e-3 * 50e-3 + 2 * hopper, rel=2e-3)
    assert made.plate_speeds == pytest.approx((1.2, 0.8))


def test_points_inside_a_hopper_and_its_straight_ends_are_told_from_those_outside() -> None:
    points = np.random.default_rng(1).uniform((-0.04, -0.04, -0.03), (0.04, 0.04, 0.11), (20000, 3))
    z = np.clip(points[:, 2], 0, 0.055)
    half = 0.5 * (0.035 + z / 0.055 * (0.06 - 0.035))
    inside = (np.abs(points[:, :2]) < half[:, None]).all(axis=1)
    np.testing.assert_array_equal(vessel(square_hopper()).contains(points), inside)


def test_an_obstacle_is_outside() -> None:
    block = between([rectangle(10, 10, 40), rectangle(10, 10, 50)])
    ends = [np.array([ring[[0, 1, 2]], ring[[0, 2, 3]]]) for ring in (rectangle(10, 10, 40), rectangle(10, 10, 50))]
    made = vessel(np.concatenate([square_hopper(), block, *ends]))
    points = np.array([[0, 0, 0.045], [0, 0, 0.035], [0, 0, 0.055], [0.0049, 0, 0.041], [0.0051, 0, 0.041]])
    assert made.contains(points).tolist() == [False, True, True, False, True]


@pytest.mark.parametrize(
    ("outlets", "says"),
    [
        ({}, "2 openings below the top"),
        ({"left": OutletSpec(at=(-25, 0, 0), share=1)}, "no outlet is named for the opening at (0.025, 0, 0) m"),
        (SIXTY_FORTY | {"right": OutletSpec(at=(-20, 0, 0), share=0.4)}, "is the same opening as that of left"),
        (SIXTY_FORTY | {"right": OutletSpec(at=(25, 0, 9), share=0.4)}, "lies 0.009 m from the nearest opening"),
    ],
)
def test_outlets_that_are_not_those_of_the_walls_are_refused(outlets: dict[str, OutletSpec], says: str) -> None:
    with pytest.raises(CaseError) as error:
        vessel(two_outlets(), outlets)
    assert says in str(error.value)
    assert error.value.key[:2] == ("vessel", "outlets")


@pytest.mark.parametrize(
    ("triangles", "says"),
    [
        (np.concatenate([square_hopper(), [rectangle(60, 60, 80)[[0, 1, 2]], rectangle(60, 60, 80)[[0, 2, 3]]]]),
         "no level opening at the top"),
        (square_hopper()[1:], "is not flat"),
        (np.concatenate([square_hopper(), square_hopper() + np.array([100, 0, 0])]), "2 pieces"),
        (two_outlets() * [1, 1, -1], "2 openings at the top"),
    ],
)  # fmt: skip
def test_walls_that_are_no_vessel_are_refused(triangles: np.ndarray, says: str) -> None:
    with pytest.raises(CaseError, match=says):
        vessel(triangles)


def test_a_second_piece_outside_is_refused() -> None:
    cube = between([rectangle(5, 5, 40, x=60), rectangle(5, 5, 45, x=60)])
    ends = [np.array([r[[0, 1, 2]], r[[0, 2, 3]]]) for r in (rectangle(5, 5, 40, x=60), rectangle(5, 5, 45, x=60))]
    with pytest.raises(CaseError, match="not one piece"):
        vessel(np.concatenate([square_hopper(), cube, *ends]))


def test_the_passage_to_an_outlet_is_the_narrowest_of_the_way() -> None:
    throat = vessel(between([rectangle(60, 60, 80), rectangle(20, 20, 40), rectangle(40, 40, 0)]))
    assert throat.outlets[0].gap == pytest.approx(0.04, rel=1e-3)
    narrow = throat.with_passages(1e-3).outlets[0].gap
    assert 0.020 <= narrow < 0.020 + 5e-3
    wide = vessel(square_hopper())
    assert wide.with_passages(2e-3).outlets[0].gap == pytest.approx(0.035, rel=1e-3)


def test_an_outlet_that_no_way_leads_to_is_refused() -> None:
    floor = np.array([rectangle(40, 40, 40)[[0, 1, 2]], rectangle(40, 40, 40)[[0, 2, 3]]])
    closed = between([rectangle(40, 40, 80), rectangle(40, 40, 0)])
    plate = np.concatenate(
        [floor, floor + np.array([0, 0, 5]), between([rectangle(40, 40, 40), rectangle(40, 40, 45)])]
    )
    with pytest.raises(CaseError):
        vessel(np.concatenate([closed, plate])).with_passages(2e-3)


def test_samples_of_a_triangle_are_nowhere_farther_apart_than_asked() -> None:
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0.1, 0.7, 0.2]]])
    weights = np.random.default_rng(2).dirichlet((1, 1, 1), 2000)
    away = np.linalg.norm((weights @ triangle[0])[:, None] - sampled(triangle, 0.1)[None], axis=2).min(axis=1)
    assert away.max() <= 0.112


def test_nothing_is_put_in_near_walls_or_below_the_plate() -> None:
    margin, bottom, top = 4e-3, -30e-3, 110e-3
    boxes = vessel(square_hopper()).insertion(top, bottom, margin, 3e-3, 40e-3)
    corners = np.array([[b[i], b[2 + j], b[4 + k]] for one in boxes for b in one.blocks
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
    z = np.clip(corners[:, 2], 0, 0.055)
    half = 0.5 * (0.035 + z / 0.055 * (0.06 - 0.035))
    lean = np.where((corners[:, 2] > 0) & (corners[:, 2] < 0.055), np.cos(np.arctan(12.5 / 55)), 1.0)
    assert ((half[:, None] - np.abs(corners[:, :2])) * lean[:, None] >= margin - 1e-9).all()
    assert corners[:, 2].min() >= bottom
    volume = sum(one.volume for one in boxes)
    assert volume > 0.2 * (0.06**2 * 0.055 + 0.035**2 * 0.03 + 0.055 * 0.0023)


def test_below_a_roof_nothing_is_put_in_that_could_not_lie_there() -> None:
    """A disc of 40 mm in a tube of 100 mm: its shadow ends 35 mm below it, where slopes of 60° meet."""
    ring = [rectangle(40, 40, 120), rectangle(40, 40, 124)]
    caps = [np.array([one[[0, 1, 2]], one[[0, 2, 3]]]) for one in ring]
    made = vessel(np.concatenate([between([rectangle(100, 100, 200), rectangle(100, 100, 0)]), between(ring), *caps]))
    boxes = made.insertion(0.2, 0.0, 2e-3, 2e-3, 30e-3)

    def filled(z: float) -> bool:
        blocks = [block for one in boxes for block in one.blocks]
        return any(b[0] < 0 < b[1] and b[2] < 0 < b[3] and b[4] < z < b[5] for b in blocks)

    assert not filled(0.118)
    assert not filled(0.085)
    assert filled(0.040)
    assert filled(0.180)


def test_the_walls_of_a_run_close_round_the_vessel_with_a_plate_in_each_outlet(tmp_path: Path) -> None:
    made = vessel(two_outlets(), SIXTY_FORTY)
    walls = build_space_walls(made, top=0.14, bottom=-0.2, plate_z=-0.03, particle_diameter=6e-3, folder=tmp_path)
    assert set(walls.triangles) == {"vessel", "plate_left", "plate_right"}
    points, triangles = read_triangles(walls.files["vessel"])
    again = WallMesh.of(points, triangles)
    assert again.ends[2] == pytest.approx([-0.2, 0.14])
    assert len(again.outlets) == 2
    for name, x in (("plate_left", -0.025), ("plate_right", 0.025)):
        points, triangles = read_triangles(walls.files[name])
        first, second, third = points[triangles].swapaxes(0, 1)
        assert 0.5 * np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() == pytest.approx(32e-3**2)
        assert points.mean(axis=0) == pytest.approx([x, 0, -0.03], abs=1e-3)


def test_triangles_that_are_too_thin_are_made_anew(tmp_path: Path) -> None:
    """A round hopper of 120 facets, each of them a triangle of 0.4°: the walls stay where they were."""
    thin = between([circle(60, 300, 120), circle(20, 0, 120)])
    made = vessel(thin)
    assert np.degrees(triangle_angles(made.surface(0.35, -0.1)).min()) < 1
    walls = build_space_walls(made, top=0.35, bottom=-0.1, plate_z=-0.05, particle_diameter=8e-3, folder=tmp_path)
    assert np.degrees(walls.smallest_angle) > 3
    again = WallMesh.of(*read_triangles(walls.files["vessel"]))
    points = np.random.default_rng(3).uniform((-0.05, -0.05, 0.01), (0.05, 0.05, 0.29), (5000, 3))
    radius = 0.02 + points[:, 2] / 0.3 * 0.04
    clear = np.abs(np.hypot(points[:, 0], points[:, 1]) - radius) > 0.8e-3  # a tenth of a diameter
    np.testing.assert_array_equal(again.contains(points)[clear], made.contains(points)[clear])


def test_walls_that_gmsh_cannot_mend_are_refused(tmp_path: Path) -> None:
    """Two sheets 1e-4 of the vessel apart have triangles that no mesh makes fat."""
    sliver = between([rectangle(60, 0.02, 80), rectangle(60, 0.02, 0)])
    with pytest.raises((MeshError, CaseError)):
        build_space_walls(vessel(sliver), top=0.1, bottom=-0.1, plate_z=-0.05, particle_diameter=6e-3, folder=tmp_path)


def test_walls_in_the_wrong_unit_are_still_a_vessel_a_thousand_times_larger(tmp_path: Path) -> None:
    assert vessel(square_hopper(), unit=1.0).outline.volume() == pytest.approx(
        1e9 * vessel(square_hopper()).outline.volume()
    )
    write_stl(tmp_path / "walls.stl", square_hopper())
    assert len(read_triangles(tmp_path / "walls.stl")[1]) == 16
