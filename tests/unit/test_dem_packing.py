"""The packed bed that a filling begins with: dense, at random, without overlap, in the sizes asked for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from granpipe.dem import packing
from granpipe.dem.contact import filling_angle
from granpipe.dem.packing import Packing, pack, packed_bed
from granpipe.dem.sizes import SizeClasses
from granpipe.errors import RunError
from granpipe.field import Array, Boxes, Frustum, Measure

DOCS = Path(__file__).parents[2] / "docs"
EQUAL = SizeClasses(np.array([0.01]), np.array([1.0]))
WIDE = SizeClasses(np.array([0.005, 0.01, 0.015]), np.array([0.6, 0.3, 0.1]))


@pytest.fixture(scope="module")
def block() -> Packing:
    return pack(WIDE, 0.58, 1)


def worst_overlap(position: Array, radius: Array) -> float:
    """Of all pairs, over the sum of radii."""
    i, j = cKDTree(position).query_pairs(2 * radius.max(), output_type="ndarray").T
    apart = np.linalg.norm(position[i] - position[j], axis=1)
    return float((1 - apart / (radius[i] + radius[j])).max())


def test_a_block_is_as_dense_as_asked_and_has_the_shares_of_the_sizes(block: Packing) -> None:
    radius = WIDE.radius[block.number]
    assert 4 / 3 * np.pi * (radius**3).sum() / block.edges.prod() == pytest.approx(0.58)
    assert np.bincount(block.number) / len(radius) == pytest.approx(WIDE.number_share, abs=1 / len(radius))


def test_repeated_blocks_do_not_overlap_inside_or_where_they_meet(block: Packing) -> None:
    position, number = block.within(np.zeros(3), 2 * block.edges)
    assert len(number) == 8 * len(block.number)
    assert worst_overlap(position, WIDE.radius[number]) <= packing.LARGEST_OVERLAP + 1e-9


def test_a_block_has_no_rows(block: Packing) -> None:
    """Of a lattice many centres share a height; of a random packing every height holds as many."""
    layers = np.histogram(block.position[:, 2], 100, (0, block.edges[2]))[0]
    assert layers.max() < 2 * layers.mean()


def test_equal_spheres_can_be_packed_and_the_seed_decides_how() -> None:
    first, again, other = pack(EQUAL, 0.58, 1), pack(EQUAL, 0.58, 1), pack(EQUAL, 0.58, 2)
    assert np.array_equal(first.position, again.position)
    assert not np.array_equal(first.position, other.position)


def test_a_block_divides_the_depth_of_a_periodic_slab() -> None:
    block = pack(EQUAL, 0.58, 1, depth=0.13)
    assert 0.13 / block.edges[1] == pytest.approx(round(0.13 / block.edges[1]))
    position, number = block.within(np.zeros(3), np.array([0.2, 0.13, 0.2]))
    both = np.concatenate([position, position + np.array([0, 0.13, 0])])
    assert worst_overlap(both, EQUAL.radius[np.tile(number, 2)]) <= packing.LARGEST_OVERLAP + 1e-9


def test_the_rarest_size_is_there() -> None:
    rare = SizeClasses(np.array([0.01, 0.02]), np.array([0.999, 0.001]))
    assert np.bincount(packing._numbers(rare))[1] == 8


def test_what_cannot_be_packed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_ROUNDS", 20)
    with pytest.raises(RunError, match=r"could not be packed to 0\.8: some overlap by"):
        pack(EQUAL, 0.8, 1)


def test_a_bed_lies_in_its_pieces_and_fills_them(block: Packing) -> None:
    cone = Frustum(0.0, 0.5, 0.05, 0.1, 0.2, 0.3)
    bed = packed_bed(block, [[cone]] * 3, np.full(3, -0.4), np.full(3, 0.6))
    r, z = np.hypot(*bed.position[:, :2].T), bed.position[:, 2]
    assert ((z >= 0) & (z <= 0.5)).all()
    assert ((r >= 0.05 + 0.1 * z - 1e-12) & (r <= 0.2 + 0.2 * z + 1e-12)).all()
    solids = float((4 / 3 * np.pi * WIDE.radius[bed.number] ** 3).sum())
    assert solids == pytest.approx(0.58 * cone.volume, rel=0.02)


def test_each_size_keeps_to_its_own_pieces(block: Packing) -> None:
    low, high = (Boxes(((0.0, 0.2, 0.0, 0.2, a, b),)) for a, b in ((0.0, 0.1), (0.1, 0.2)))
    bed = packed_bed(block, [[low], [high], []], np.zeros(3), np.full(3, 0.2))
    assert set(bed.number.tolist()) == {0, 1}
    assert (bed.position[bed.number == 0, 2] < 0.1).all()
    assert (bed.position[bed.number == 1, 2] >= 0.1).all()


def test_a_slab_is_filled_between_its_ends_and_its_depth(block: Packing) -> None:
    slab = Frustum(0.0, 0.2, 0.05, 0.05, 0.2, 0.1, Measure(0.1, axial=False), 0.02)
    bed = packed_bed(block, [[slab]] * 3, np.zeros(3), np.full(3, 0.3))
    x, y, z = bed.position.T
    assert len(bed) > 0
    assert ((x >= 0.05) & (x <= 0.2 - 0.5 * z + 1e-12)).all()
    assert ((y >= 0.02) & (y <= 0.12)).all()


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
