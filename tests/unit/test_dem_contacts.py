"""Contacts: in the deck only where they are asked for, and read back whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from granpipe.dem.contacts import Contacts, read_pair_contacts, read_wall_contacts
from granpipe.errors import DataError

TEXT = """ITEM: TIMESTEP
250
ITEM: NUMBER OF ENTRIES
2
ITEM: BOX BOUNDS ff ff ff
-0.1 0.1
-0.1 0.1
-0.2 0.7
ITEM: ENTRIES c_contacts[1] c_contacts[2] c_contacts[3] c_contacts[4] and so on
0.079 0.0098 0.62 0.07 0.0098 0.62 -0.169 -0.0373 0.0064
0.078 0.0128 0.65 0.07 0.0128 0.65 -1.28e-1 -0.0370 0.0092
"""


def test_points_and_forces_are_read(tmp_path: Path) -> None:
    path = tmp_path / "contacts.250.txt"
    path.write_text(TEXT)
    centre, point, force = read_wall_contacts(path)
    assert np.array_equal(centre, [[0.07, 0.0098, 0.62], [0.07, 0.0128, 0.65]])
    assert np.array_equal(point, [[0.079, 0.0098, 0.62], [0.078, 0.0128, 0.65]])
    assert np.array_equal(force, [[-0.169, -0.0373, 0.0064], [-0.128, -0.037, 0.0092]])


def test_a_snapshot_without_contacts_is_empty(tmp_path: Path) -> None:
    path = tmp_path / "contacts.0.txt"
    path.write_text("\n".join(TEXT.replace("\n2\n", "\n0\n").splitlines()[:9]) + "\n")
    assert [values.shape for values in read_wall_contacts(path)] == 3 * [(0, 3)]


@pytest.mark.parametrize("keep", [0, 30, 200, len(TEXT) - 8, len(TEXT) - 1])
def test_a_file_cut_short_is_refused(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "contacts.0.txt"
    path.write_text(TEXT[:keep])
    with pytest.raises(DataError, match=r"contacts\.0\.txt"):
        read_wall_contacts(path)


@pytest.mark.parametrize("damage", ["nan", "x", "1 2"])
def test_damaged_numbers_are_refused(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "contacts.0.txt"
    path.write_text(TEXT.replace("0.079 0.0098", f"0.079 {damage}"))
    with pytest.raises(DataError, match=r"contacts\.0\.txt"):
        read_wall_contacts(path)


PAIRS = """ITEM: TIMESTEP
250
ITEM: NUMBER OF ENTRIES
3
ITEM: BOX BOUNDS ff ff ff
-0.1 0.1
-0.1 0.1
-0.2 0.7
ITEM: ENTRIES c_pairs[1] c_pairs[2] c_pairs[4] c_pairs[5] c_pairs[6]
7 3 1 0 -2
3 12 0 0 5
12 3 0 0 -5
"""
IDS = np.array([12, 3, 7])
PLACES = np.array([[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]])


def test_a_pair_that_two_ranks_have_written_counts_once(tmp_path: Path) -> None:
    (tmp_path / "pairs").write_text(PAIRS)
    found = read_pair_contacts(tmp_path / "pairs", IDS, PLACES)
    rows = sorted(zip(found.centre[:, 0], found.end[:, 0], found.force[:, 2], strict=True))
    assert rows == [(0.2, 0.1, 5), (0.3, 0.2, -2)]


@pytest.mark.parametrize("damage", ["8 3 1", "3 3 1", "7.5 3 1", "7 3"])
def test_contacts_of_particles_that_are_not_there_are_refused(tmp_path: Path, damage: str) -> None:
    (tmp_path / "pairs").write_text(PAIRS.replace("7 3 1", damage))
    with pytest.raises(DataError, match="pairs"):
        read_pair_contacts(tmp_path / "pairs", IDS, PLACES)
    (tmp_path / "pairs").write_text(PAIRS)
    with pytest.raises(DataError, match="does not hold"):
        read_pair_contacts(tmp_path / "pairs", IDS[:0], PLACES[:0])


def test_friction_cuts_what_is_along_the_surface_alone() -> None:
    """Along x presses 10 N, friction 0.3: of 5 N sideways 3 remain, 2 N stay; so do 3 of 5 where the contact pulls."""
    centre, end = np.array([[0.02, 0, 0]] * 3), np.zeros((3, 3))
    force = np.array([[10.0, 3, -4], [10, 0, 2], [-10, 5, 0]])
    found = Contacts(centre, end, force).within_friction(0.3).force
    assert found == pytest.approx(np.array([[10, 1.8, -2.4], [10, 0, 2], [-10, 3, 0]]))
    assert not Contacts(centre, end, force).within_friction(0.0).force[:, 1:].any()
