"""Stress from contacts: pairs by hand, lattices whose stress is known, and the balance of forces."""

from typing import NamedTuple

import numpy as np
import pytest
from fakes.spheres import Spheres

from granpipe.dem import contacts as recorded
from granpipe.field import Box, Grid
from granpipe.homogenize.average import Collector
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.stress import contact_stress, stress_arrays, supported

GRID = Grid.covering(0.3, 0.0, 0.4, 0.005)
DIAMETER, DENSITY, GRAVITY = 0.02, 2500.0, 9.81
BINS = Bins.of(GRID, DIAMETER)
WEIGHT = DENSITY * np.pi / 6 * DIAMETER**3 * GRAVITY


class Contacts(NamedTuple):
    centre: np.ndarray
    end: np.ndarray
    force: np.ndarray


def contacts(*rows):
    return Contacts(*np.array(rows, dtype=float).reshape(-1, 3, 3).transpose(1, 0, 2))


NONE = contacts()
DOWN, ASIDE = np.array([[0, 0, DIAMETER], [0.001, 0, 0]])


def bed(position, velocity=(0.0, 0.0, 0.0)):
    position = np.atleast_2d(position)
    count = len(position)
    return Spheres(np.arange(count), position, np.tile(velocity, (count, 1)), np.full(count, DIAMETER / 2))


def virial(pairs, walls=NONE):
    found = contact_stress(BINS, pairs, walls, bed([[0.1, 0, 0.2]]), DENSITY)
    return found["stress"]


def segments_of(values):
    collector = Collector(GRID)
    collector.add(0.0, bed([[0.1, 0, 0.2]]))
    collector.observe(values)
    return [collector.take()]


def turned(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5, -1.9])
def test_a_pair_gives_its_force_times_its_branch_whichever_way_it_lies_about_the_axis(angle):
    radial = contacts([[0.12, 0, 0.2], [0.1, 0, 0.2], [3.0, 0, 0.5]])
    total = virial(Contacts(*(turned(one, angle) for one in radial))).sum(axis=(1, 2))
    assert total == pytest.approx([3.0 * 0.02, 0, 0, 0, 0.5 * 0.02], abs=1e-15)
    upright = contacts([[0.11, 0, 0.22], [0.11, 0, 0.2], [-0.4, 0, 3.0]])
    total = virial(Contacts(*(turned(one, angle) for one in upright))).sum(axis=(1, 2))
    assert total == pytest.approx([0, 0, 3.0 * 0.02, -0.4 * 0.02, 0], abs=1e-15)


def test_a_pair_side_by_side_presses_round_the_axis():
    pair = contacts([[0.2, 0.01, 0.2], [0.2, -0.01, 0.2], [0, 3.0, 0]])
    rr, tt, *rest = virial(pair).sum(axis=(1, 2))
    turn = np.arctan(0.05)  # half the angle that the branch covers
    assert rr + tt == pytest.approx(3.0 * 0.02, rel=1e-12)
    assert rr == pytest.approx(3.0 * 0.02 * turn**2 / 3, rel=0.01)  # ∫ sin² over the branch
    assert rest == pytest.approx([0, 0, 0], abs=1e-15)


def test_a_pair_across_the_axis_presses_along_the_radius_alone():
    total = virial(contacts([[0.013, 0, 0.2], [-0.007, 0, 0.2], [2.0, 0, 0]])).sum(axis=(1, 2))
    assert total == pytest.approx([0.04, 0, 0, 0, 0], abs=1e-12)


def test_every_bin_has_the_part_of_the_branch_that_lies_in_it():
    size = BINS.factor * GRID.cell
    foot = np.array([4.25, 0, 3.5]) * size  # 1.5 bins up, and to the right across one edge of the rings
    branch = np.array([1.5, 0, 1.5]) * size
    found = virial(contacts([foot + branch, foot, [0, 0, 1.0]]))[2]
    # z edges at 1/3; the next at 1: r edge at 0.5
    parts = {(3, 4): 1 / 3, (4, 4): 1 / 6, (4, 5): 1 / 2}
    for place, share in parts.items():
        assert found[place] == pytest.approx(share * 1.5 * size, rel=1e-12)
    assert found.sum() == pytest.approx(1.5 * size, rel=1e-12)


def test_what_leaves_the_grid_is_cut_and_what_overlaps_the_wall_is_not():
    below = virial(contacts([[0.1, 0, 0.005], [0.1, 0, -0.015], [0, 0, 1.0]]))
    assert below.sum() == pytest.approx(0.005, rel=1e-12)
    beyond = virial(NONE, contacts([[0.29, 0, 0.2], [0.301, 0, 0.2], [-1.0, 0, 0]]))
    assert beyond.sum() == pytest.approx(0.011, rel=1e-12)


def lattice(layers, reach):
    """Places of a simple cubic lattice in a cylinder, layers from below."""
    side = np.arange(-reach, reach + 1)
    x, y = np.array(np.meshgrid(side, side)).reshape(2, -1) + 0.37
    inside = np.hypot(x, y) < reach
    plane = np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])
    return DIAMETER * np.array([plane + np.array([0, 0, k + 0.5]) for k in range(layers)])


def test_columns_of_spheres_bear_what_stands_on_them():
    """σ_zz at depth h is ρ_b g h; contacts in a simple cubic lattice at rest have no other component."""
    layers = lattice(20, 13)
    columns = layers.shape[1]
    rows = []
    for k in range(20):
        below = layers[k - 1] if k else layers[0] - [0, 0, DIAMETER / 2]
        above = (20 - k) * WEIGHT
        rows += [[top, bottom, [0, 0, above]] for top, bottom in zip(layers[k], below, strict=True)]
    pairs, floor = contacts(*rows[columns:]), contacts(*rows[:columns])
    values = contact_stress(BINS, pairs, floor, bed(layers.reshape(-1, 3)), DENSITY)
    through = values["stress"][2].sum(axis=1) / np.diff(BINS.z_edges)
    height = 0.5 * (BINS.z_edges[1:] + BINS.z_edges[:-1])
    # between the centres of the layers k and k + 1, all layers above k are borne
    expected = columns * WEIGHT * np.round(20 - height / DIAMETER)
    lower = height < 0.38
    assert through[lower] == pytest.approx(expected[lower], rel=0.6 / 2)  # a row holds the ends of two contacts
    found = stress_arrays(segments_of(values), BINS, np.ones(GRID.shape))
    bulk = DENSITY * np.pi / 6
    deep = (GRID.z_centres > 0.05) & (GRID.z_centres < 0.3)
    exact = bulk * GRAVITY * (0.4 - GRID.z_centres)[deep]
    disc = GRID.r_centres < 0.2
    mean = found["stress_zz"][deep][:, disc] @ GRID.ring_area[disc] / GRID.ring_area[disc].sum()
    assert mean == pytest.approx(exact, abs=0.02 * exact.max())
    for name in ("stress_rr", "stress_tt", "stress_rz"):
        assert np.abs(found[name]).max() < 1e-9 * exact.max()
    assert found["pressure"] == pytest.approx(found["stress_zz"] / 3, rel=1e-12)


def test_an_isotropic_lattice_has_one_pressure():
    """Six contacts of force F at a distance d: σ = F/d² along every direction."""
    layers = lattice(20, 13)
    places, force = layers.reshape(-1, 3), 2.0
    steps = DIAMETER * np.eye(3)
    rows = [[place + step, place, force * step / DIAMETER] for step in steps for place in places]
    values = contact_stress(BINS, contacts(*rows), NONE, bed(places), DENSITY)
    found = stress_arrays(segments_of(values), BINS, np.ones(GRID.shape))
    deep = (GRID.z_centres > 0.05) & (GRID.z_centres < 0.35)
    disc = GRID.r_centres < 0.2
    for name in ("stress_rr", "stress_tt", "stress_zz", "pressure"):
        mean = found[name][deep][:, disc].mean(axis=0) @ GRID.ring_area[disc] / GRID.ring_area[disc].sum()
        assert mean == pytest.approx(force / DIAMETER**2, rel=0.03), name
    assert np.abs(found["stress_rz"]).max() < 0.3 * force / DIAMETER**2


def test_stress_is_per_volume_of_the_vessel():
    pair = contacts([[0.11, 0, 0.22], [0.11, 0, 0.2], [0, 0, 3.0]])
    inside = np.ones(GRID.shape)
    inside[:, GRID.r_centres > 0.11] = 0
    values = segments_of(contact_stress(BINS, pair, NONE, bed([[0.1, 0, 0.2]]), DENSITY))
    narrow, wide = (stress_arrays(values, BINS, one)["stress_zz"] for one in (inside, np.ones(GRID.shape)))
    assert (narrow[:, GRID.r_centres > 0.11] == 0).all()
    assert narrow.max() > 1.2 * wide.max()


def held_column(friction_share, missing=False):
    """A column at rest: each layer hands a part of its weight to the wall."""
    layers = lattice(20, 10)
    pairs, walls, borne = [], [], 0.0
    for k in range(19, -1, -1):
        borne += WEIGHT * (1 - friction_share)
        for place in layers[k]:
            pairs.append([place, place - DOWN, [0, 0, borne]])
            walls.append([place, place + ASIDE, [0, 0, WEIGHT * friction_share]])
    if missing:
        pairs = pairs[::2]
    values = contact_stress(BINS, contacts(*pairs), contacts(*walls), bed(layers.reshape(-1, 3)), DENSITY)
    return supported(segments_of(values), BINS, GRAVITY)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_contacts_and_walls_together_bear_the_weight(share):
    found = held_column(share)
    assert found.imbalance == pytest.approx(0, abs=1e-9)
    assert found.by_walls == pytest.approx(share, abs=1e-9)
    assert found.agitation == (0 if share < 1 else np.inf)


def test_missing_contacts_are_seen():
    assert held_column(0.3, missing=True).imbalance < -0.3


def test_without_any_contact_the_forces_do_not_balance():
    values = contact_stress(BINS, NONE, NONE, bed([[0.1, 0, 0.2]], (0, 0, 1.0)), DENSITY)
    assert supported(segments_of(values), BINS, GRAVITY).imbalance == -1


def test_agitation_is_the_energy_of_motion_over_the_stress():
    pair = contacts([[0.11, 0, 0.22], [0.11, 0, 0.2], [0, 0, 3.0]])
    values = contact_stress(BINS, pair, NONE, bed([[0.11, 0, 0.22], [0.11, 0, 0.2]], (0, 0, 0.5)), DENSITY)
    assert supported(segments_of(values), BINS, GRAVITY).agitation == pytest.approx(
        2 * WEIGHT / GRAVITY * 0.25 / (3.0 * 0.02), rel=1e-9
    )


# --- slabs ------------------------------------------------------------------------------------------------------------

DEEP = 8 * DIAMETER
SLAB = Bins.of(Box.within((-0.1, 0.2), (0.0, DEEP), (0.0, 0.4), 0.005, flat=True, cut=False), DIAMETER)


def in_slab(pairs, walls=NONE, particles=None):
    return contact_stress(SLAB, pairs, walls, bed([[0.1, 0, 0.2]]) if particles is None else particles, DENSITY)


def test_in_a_slab_components_are_those_along_x_y_and_z():
    pair = contacts([[-0.03, 0.08, 0.22], [-0.042, 0.064, 0.2], [3.0, 2.0, -0.5]])
    total = in_slab(pair)["stress"].sum(axis=(1, 2))
    assert total == pytest.approx([3.0 * 0.012, 2.0 * 0.016, -0.5 * 0.02, 3.0 * 0.02, -0.5 * 0.012], abs=1e-15)


def test_in_a_slab_every_bin_has_the_part_of_the_branch_in_it_and_the_end_ones_what_overlaps_the_walls():
    pair = contacts([[-0.085, 0, 0.2025], [-0.105, 0, 0.2025], [1.0, 0, 0]])
    found = in_slab(pair)["stress"][0]
    row = found.sum(axis=1).argmax()
    assert found[row, :2] == pytest.approx([0.015, 0.005])
    assert found.sum() == pytest.approx(0.02)


def test_a_pair_through_the_periodic_faces_has_a_short_branch():
    """Its distance is that to the image, and its normal too, by which friction is limited."""
    pair = recorded.Contacts(
        *contacts(
            [[0, 0.005, 0.2], [0, DEEP - 0.011, 0.2], [0, 3.0, 0]], [[0, 0.05, 0.2], [0, 0.034, 0.2], [0, 3.0, 0]]
        )
    )
    joined = pair.through_faces(SLAB.grid.period).within_friction(0.1)
    np.testing.assert_allclose(joined.force, pair.force)
    total = in_slab(joined)["stress"].sum(axis=(1, 2))
    assert total == pytest.approx([0, 2 * 3.0 * 0.016, 0, 0, 0], abs=1e-15)
    assert pair.through_faces(0.0) is pair


def test_columns_of_spheres_between_two_walls_bear_their_weight_and_what_they_are_pressed_with():
    """A simple cubic lattice that fills a slab: σ_zz = ρ_b g h, σ_xx and σ_yy those of given forces across."""
    count, layers, deep, force = 15, 20, 8, 7.0
    x, y, z = np.array(np.meshgrid(np.arange(count), np.arange(deep), np.arange(layers), indexing="ij")).reshape(3, -1)
    centre = DIAMETER * (np.column_stack([x, y, z]) + 0.5) - [0.1, 0, 0]
    step = DIAMETER * np.eye(3)
    down = np.column_stack([0 * z, 0 * z, (layers - z) * WEIGHT])

    def pushed(axis, some):
        forces = down if axis == 2 else np.tile(force * np.eye(3)[axis], (len(centre), 1))
        return np.stack([centre, centre - step[axis], forces], axis=1)[some]

    pairs = [pushed(0, x > 0), pushed(1, y >= 0), pushed(2, z > 0)]
    pairs[1][y == 0, 1, 1] += DEEP  # the other one of the pair, beyond the face
    left, right, floor = pushed(0, x == 0), pushed(0, x == count - 1), pushed(2, z == 0)
    left[:, 1] += 0.5 * step[0]
    right[:, 1], right[:, 2] = right[:, 0] + 0.5 * step[0], -right[:, 2]
    floor[:, 1] += 0.5 * step[2]
    joined = recorded.Contacts(*contacts(*np.concatenate(pairs))).through_faces(SLAB.grid.period)
    values = in_slab(joined, contacts(*np.concatenate([left, right, floor])), bed(centre))
    collector = Collector(SLAB.grid)
    collector.add(0.0, bed(centre))
    collector.observe(values)
    segments = [collector.take()]
    found = stress_arrays(segments, SLAB, np.ones(SLAB.grid.shape))
    heights = SLAB.grid.z_centres
    deep_rows = (heights > 0.06) & (heights < 0.3)  # twelve layers
    exact = DENSITY * np.pi / 6 * GRAVITY * (0.4 - heights)[deep_rows, None]
    assert np.abs(found["stress_zz"][deep_rows].mean(axis=1) / exact[:, 0] - 1).max() < 0.1
    np.testing.assert_allclose(found["stress_rr"][deep_rows].mean(), force / DIAMETER**2, rtol=0.01)
    np.testing.assert_allclose(found["stress_tt"][deep_rows].mean(), force / DIAMETER**2, rtol=0.01)
    balance = supported(segments, SLAB, GRAVITY)
    assert balance.imbalance == pytest.approx(0, abs=0.03)
    assert balance.by_walls == pytest.approx(0, abs=0.03)
