"""The packed bed that a filling begins with: dense, at random, without overlap, in the sizes asked for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from granpipe.dem import packing
from granpipe.dem.contact import filling_angle
from granpipe.dem.packing import LOOSE, Bed, Packing, pack, packed_bed
from granpipe.dem.sizes import SizeClasses
from granpipe.errors import RunError
from granpipe.field import Array, Boxes, Frustum, Measure

DOCS = Path(__file__).parents[2] / "docs"
EQUAL = SizeClasses(np.array([0.01]), np.array([1.0]))
WIDE = SizeClasses(np.array([0.005, 0.01, 0.015]), np.array([0.6, 0.3, 0.1]))


@pytest.fixture(scope="module")
def block() -> Packing:
    return pack(WIDE, LOOSE, 1)


def filled(block: Packing, high: Array) -> tuple[Array, Array]:
    """Centres and classes in a box from 0 to its upper corner."""
    positions, numbers = zip(*block.layers(np.zeros(3), high), strict=True)
    return np.concatenate(positions), np.concatenate(numbers)


def solids(classes: SizeClasses, bed: Bed) -> Array:
    """Volume of each class [m³]."""
    return np.bincount(bed.number, 4 / 3 * np.pi * classes.radius[bed.number] ** 3, len(classes.radius))


def worst_overlap(position: Array, radius: Array) -> float:
    """Of all pairs, over the sum of radii."""
    i, j = cKDTree(position).query_pairs(2 * radius.max(), output_type="ndarray").T
    apart = np.linalg.norm(position[i] - position[j], axis=1)
    return float((1 - apart / (radius[i] + radius[j])).max())


def test_a_block_is_as_dense_as_asked_and_has_the_shares_of_the_sizes(block: Packing) -> None:
    radius = WIDE.radius[block.number]
    assert 4 / 3 * np.pi * (radius**3).sum() / block.edges.prod() == pytest.approx(LOOSE)
    assert np.bincount(block.number) / len(radius) == pytest.approx(WIDE.number_share, abs=1 / len(radius))


def test_repeated_blocks_do_not_overlap_inside_or_where_they_meet(block: Packing) -> None:
    position, number = filled(block, 2 * block.edges)
    assert len(number) == 8 * len(block.number)
    assert worst_overlap(position, WIDE.radius[number]) <= packing.LARGEST_OVERLAP + 1e-9


def test_a_block_has_no_rows(block: Packing) -> None:
    """Of a lattice many centres share a height; of a random packing every height holds as many."""
    layers = np.histogram(block.position[:, 2], 100, (0, block.edges[2]))[0]
    assert layers.max() < 2 * layers.mean()


def test_equal_spheres_can_be_packed_and_the_seed_decides_how() -> None:
    first, again, other = pack(EQUAL, LOOSE, 1), pack(EQUAL, LOOSE, 1), pack(EQUAL, LOOSE, 2)
    assert np.array_equal(first.position, again.position)
    assert not np.array_equal(first.position, other.position)


def test_a_block_divides_the_depth_of_a_periodic_slab() -> None:
    block = pack(EQUAL, LOOSE, 1, depth=0.13)
    assert 0.13 / block.edges[1] == pytest.approx(round(0.13 / block.edges[1]))
    position, number = filled(block, np.array([0.2, 0.13, 0.2]))
    both = np.concatenate([position, position + np.array([0, 0.13, 0])])
    assert worst_overlap(both, EQUAL.radius[np.tile(number, 2)]) <= packing.LARGEST_OVERLAP + 1e-9


def test_the_rarest_size_is_there() -> None:
    rare = SizeClasses(np.array([0.01, 0.02]), np.array([0.999, 0.001]))
    assert np.bincount(packing._numbers(rare))[1] == 8


def test_what_cannot_be_packed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_ROUNDS", 20)
    with pytest.raises(RunError, match=r"could not be packed to 0\.8: some overlap by"):
        pack(EQUAL, 0.8, 1)


def test_a_bed_lies_in_its_pieces_and_fills_them() -> None:
    cone = Frustum(0.0, 0.5, 0.05, 0.1, 0.2, 0.3)
    bed = packed_bed(WIDE, LOOSE, 1, [[cone]] * 3, (np.full(3, -0.4), np.full(3, 0.6)))
    r, z = np.hypot(*bed.position[:, :2].T), bed.position[:, 2]
    assert ((z >= 0) & (z <= 0.5)).all()
    assert ((r >= 0.05 + 0.1 * z - 1e-12) & (r <= 0.2 + 0.2 * z + 1e-12)).all()
    assert solids(WIDE, bed).sum() == pytest.approx(LOOSE * cone.volume, rel=0.02)
    assert worst_overlap(bed.position, WIDE.radius[bed.number]) <= packing.LARGEST_OVERLAP + 1e-9


def test_sizes_have_their_shares_though_large_ones_keep_farther_from_walls() -> None:
    pieces = [[Frustum(0.0, 0.5, 0.0, 0.0, 0.15 - radius, 0.15 - radius)] for radius in WIDE.radius]
    bed = packed_bed(WIDE, LOOSE, 1, pieces, (np.array([-0.15, -0.15, 0.0]), np.array([0.15, 0.15, 0.5])))
    for one, radius in enumerate(WIDE.radius):
        assert np.hypot(*bed.position[bed.number == one, :2].T).max() <= 0.15 - radius
    shares = solids(WIDE, bed) / solids(WIDE, bed).sum()
    assert shares == pytest.approx(WIDE.mass_share, abs=0.01)


def test_the_lowest_particles_of_a_bed_are_kept_in_their_order() -> None:
    bed = Bed(np.array([[0, 0, 3], [0, 0, 1], [0, 0, 4], [0, 0, 2.0]]), np.array([0, 1, 2, 3]))
    assert bed.lowest(2).number.tolist() == [1, 3]
    assert bed.lowest(2).position[:, 2].tolist() == [1, 2]
    assert bed.lowest(4) is bed
    assert len(bed.lowest(0)) == 0


def test_a_slab_is_filled_between_its_ends_and_its_depth() -> None:
    slab = Frustum(0.0, 0.2, 0.05, 0.05, 0.2, 0.1, Measure(0.1, axial=False), 0.02)
    bed = packed_bed(WIDE, LOOSE, 1, [[slab]] * 3, (np.zeros(3), np.full(3, 0.3)))
    x, y, z = bed.position.T
    assert len(bed) > 0
    assert ((x >= 0.05) & (x <= 0.2 - 0.5 * z + 1e-12)).all()
    assert ((y >= 0.02) & (y <= 0.12)).all()


def test_blocks_in_space_are_filled() -> None:
    boxes = Boxes(((0.0, 0.2, 0.0, 0.2, 0.0, 0.1), (0.2, 0.3, 0.0, 0.1, 0.05, 0.2)))
    bed = packed_bed(EQUAL, LOOSE, 1, [[boxes]], (np.zeros(3), np.full(3, 0.3)))
    inside = np.zeros(len(bed), dtype=bool)
    for a, b, c, d, e, f in boxes.blocks:
        inside |= ((bed.position >= [a, c, e]) & (bed.position <= [b, d, f])).all(axis=1)
    assert inside.all()
    assert solids(EQUAL, bed).sum() == pytest.approx(LOOSE * boxes.volume, rel=0.1)


def test_sizes_that_are_too_far_apart_are_dropped_in() -> None:
    far = SizeClasses(np.array([0.01, 0.05]), np.array([0.9, 0.1]))
    pieces = [[Frustum(0.0, 1.0, 0.0, 0.0, 1.0, 1.0)]] * 2
    assert len(packed_bed(far, LOOSE, 1, pieces, (np.full(3, -1.0), np.ones(3)))) == 0


@pytest.mark.parametrize("share", [1e-4, 1e-320])
def test_sizes_that_are_all_but_absent_do_no_harm(share: float) -> None:
    rare = SizeClasses(np.array([0.01, 0.03]), np.array([1 - share, share]))
    pieces = [[Frustum(0.0, 0.3, 0.0, 0.0, 0.3, 0.3)]] * 2
    bed = packed_bed(rare, LOOSE, 1, pieces, (np.full(3, -0.3), np.full(3, 0.3)))
    shares = solids(rare, bed) / solids(rare, bed).sum()
    assert shares == pytest.approx(rare.mass_share, abs=0.005)


def test_a_vessel_without_room_for_a_size_has_no_packed_bed() -> None:
    pieces: list[list[Frustum]] = [[Frustum(0.0, 0.1, 0.0, 0.0, 0.1, 0.1)], [], []]
    assert len(packed_bed(WIDE, LOOSE, 1, pieces, (np.full(3, -0.1), np.full(3, 0.1)))) == 0


def test_vessels_are_filled_ten_degrees_steeper_than_heaps_are() -> None:
    """The heaps that docs/validation/repose.md tells of."""
    rows = re.findall(
        r"^\| ([\d.]+) \| ([\d.]+)(?:, 6 diameters wide)? \| .*° \| ([\d.]+)° \|$",
        (DOCS / "validation" / "repose.md").read_text(),
        re.MULTILINE,
    )
    assert len(rows) == 7
    for friction, rolling, angle in (map(float, row) for row in rows):
        assert np.degrees(filling_angle(friction, rolling)) == pytest.approx(angle + 10, abs=2)
