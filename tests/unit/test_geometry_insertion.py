"""Insertion slabs: clear of walls, reachable by a fall from above, and not much smaller than what could be used."""

from itertools import pairwise

import numpy as np
import pytest

from granpipe.geometry.insertion import insertion_frusta
from granpipe.geometry.outline import Outline

REACTOR = [[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]
RING = [[0.75, 1.85], [1.156, 1.85], [1.156, 2.10], [0.75, 2.10]]
REPOSE = np.radians(30)
TOP, BOTTOM, MARGIN = 0.8, 0.5, 0.06  # above the inlet, below the outlet [m]; clearance [m]


def box(r0, r1, z0, z1):
    return [[r0, z0], [r1, z0], [r1, z1], [r0, z1]]


VESSELS = {
    "test reactor": (REACTOR, {"ring": RING}),
    "hopper with insert": ([[2, 4], [1, 3], [1, 0]], {"insert": [[0.6, 3], [1.1, 3.5], [0, 3.5], [0, 3]]}),
    "disc": ([[1, 2], [1, 0]], {"disc": box(0, 0.5, 1, 1.2)}),
    "free ring": ([[1, 2], [1, 0]], {"ring": box(0.4, 0.6, 1, 1.2)}),
    "hook on the wall": (
        [[1, 3], [1, 0]],
        {"hook": [[0.5, 1], [0.6, 1], [0.6, 1.6], [1, 1.6], [1, 1.75], [0.5, 1.75]]},
    ),
    "diamond on the axis": ([[1, 3], [1, 0]], {"diamond": [[0, 2], [0.5, 1.5], [0, 1.4]]}),
    "flat bottom": ([[0.4, 2], [1, 2], [1, 0.3], [0.4, 0.3], [0.4, 0]], {}),
    "round ring": (
        [[1, 3], [1, 0]],
        {"ring": [[0.5 + 0.2 * np.cos(t), 1.5 + 0.2 * np.sin(t)] for t in np.linspace(0.1, 6.2, 24)]},
    ),
    "two baffles": ([[1, 3], [1, 0]], {"ring": box(0.4, 1, 1.7, 1.8), "disc": box(0, 0.7, 1.2, 1.4)}),
}


def vessel(name):
    return Outline.of(*VESSELS[name])


def slabs(outline, min_size=0.0):
    return insertion_frusta(outline, outline.z_top + TOP, outline.z_bottom - BOTTOM, MARGIN, REPOSE, min_size)


def points_in(frusta, rng, count=1000):
    each = [max(4, int(count * f.volume / sum(g.volume for g in frusta))) for f in frusta]
    for frustum, n in zip(frusta, each, strict=True):
        part = rng.uniform(0, 1, n)
        inner = frustum.inner_low + part * (frustum.inner_high - frustum.inner_low)
        outer = frustum.outer_low + part * (frustum.outer_high - frustum.outer_low)
        z = frustum.z_low + part * (frustum.z_high - frustum.z_low)
        yield np.stack([inner + rng.uniform(0, 1, n) * (outer - inner), z])


def solid_edges(outline):
    """Edges of wall and obstacles, those on the axis left out."""
    wall = [
        (outline.inlet_radius, outline.z_top + TOP),
        *outline.wall,
        (outline.outlet_radius, outline.z_bottom - BOTTOM),
    ]
    pairs = [*pairwise(wall)]
    for polygon in outline.obstacles.values():
        pairs += zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    return [(np.array(a), np.array(b)) for a, b in pairs if a[0] > 0 or b[0] > 0]


def clearance(r, z, outline):
    """Distance of points from the nearest edge."""
    nearest = np.full(np.shape(r), np.inf)
    for a, b in solid_edges(outline):
        along = b - a
        part = np.clip(((r - a[0]) * along[0] + (z - a[1]) * along[1]) / max(along @ along, 1e-30), 0, 1)
        nearest = np.minimum(nearest, np.hypot(r - a[0] - part * along[0], z - a[1] - part * along[1]))
    return nearest


@pytest.mark.parametrize("name", VESSELS)
def test_every_place_keeps_its_distance_from_walls_and_obstacles(name):
    outline = vessel(name)
    r, z = np.concatenate([*points_in(slabs(outline), np.random.default_rng(1))], axis=1)
    assert clearance(r, z, outline).min() >= MARGIN - 1e-9


STEP = 0.004


def raster(outline, distance):
    """Free points of a raster at this distance from edges: levels from the top, radii, and the mask."""
    z = np.arange(outline.z_top + TOP - STEP / 2, outline.z_bottom - BOTTOM, -STEP)
    r = np.arange(STEP / 2, outline.r_max, STEP)
    zz, rr = np.meshgrid(z, r, indexing="ij")
    free = (rr < outline.wall_radius(zz)) & (clearance(rr, zz, outline) >= distance)
    for polygon in outline.obstacles.values():
        crossings = np.zeros(rr.shape, dtype=int)
        for (r0, z0), (r1, z1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            if z0 != z1:
                crossings += ((z0 > zz) != (z1 > zz)) & (rr < r0 + (zz - z0) / (z1 - z0) * (r1 - r0))
        free &= crossings % 2 == 0
    return z, r, free


def rained_on(free, spread):
    """Free points that lie under a reached one, sideways by at most `spread` per step down."""
    reached = np.zeros_like(free)
    reached[0] = free[0]
    drift = 0.0
    for i in range(1, len(free)):
        drift += spread
        cells, drift = int(drift), drift - int(drift)
        wide = reached[i - 1].copy()
        for shift in range(1, cells + 1):
            wide[shift:] |= reached[i - 1, :-shift]
            wide[:-shift] |= reached[i - 1, shift:]
        reached[i] = wide & free[i]
    return reached


@pytest.mark.parametrize("name", VESSELS)
def test_particles_that_fall_from_above_reach_every_place_and_most_of_what_they_reach_is_used(name):
    outline = vessel(name)
    z, r, free = raster(outline, MARGIN - 1.5 * STEP)
    reached = rained_on(free, 1 / np.tan(REPOSE) * 1.02)
    used = np.zeros_like(free)
    for f in slabs(outline):
        part = (z - f.z_low) / f.height
        inner = f.inner_low + part * (f.inner_high - f.inner_low)
        outer = f.outer_low + part * (f.outer_high - f.outer_low)
        used |= ((part >= 0) & (part <= 1))[:, None] & (r >= inner[:, None]) & (r <= outer[:, None])
    volume = np.broadcast_to(r, free.shape)
    assert volume[used & ~reached].sum() <= 1e-3 * volume[used].sum()
    z, r, free = raster(outline, MARGIN)
    reached = rained_on(free, 1 / np.tan(REPOSE))
    assert volume[used & reached].sum() >= 0.93 * volume[reached].sum()


def test_slabs_of_the_test_reactor_are_few_and_follow_lip_and_ring():
    found = slabs(vessel("test reactor"), min_size=0.1)
    assert len(found) <= 9
    below_lip = next(f for f in found if f.z_high < 3.4)
    assert below_lip.outer_high == pytest.approx(0.5 - MARGIN)
    fall = below_lip.z_high - below_lip.z_low
    assert below_lip.outer_low - below_lip.outer_high == pytest.approx(fall / np.tan(REPOSE))


def test_below_an_axis_obstacle_the_inner_bound_closes_at_the_repose():
    closing = next(f for f in slabs(vessel("disc")) if f.inner_high > 0 and f.inner_low == 0)
    assert closing.inner_high == pytest.approx(0.5 + MARGIN)
    assert closing.height == pytest.approx((0.5 + MARGIN) * np.tan(REPOSE))


def curved_vessel():
    z = np.linspace(5, 0, 200)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([0.3 + 0.15 * np.cos(turn), 2.5 + 0.15 * np.sin(turn)], axis=1)
    return Outline.of(np.stack([1 + 0.4 * np.sin(3 * z), z], axis=1), {"ring": ring})


def test_a_curved_wall_leaves_few_large_slabs_that_still_keep_their_distance():
    outline = curved_vessel()
    fine, coarse = slabs(outline), slabs(outline, min_size=0.1)
    assert len(coarse) < 0.2 * len(fine)
    assert sum(f.volume for f in coarse) >= 0.85 * sum(f.volume for f in fine)
    r, z = np.concatenate([*points_in(coarse, np.random.default_rng(1))], axis=1)
    assert clearance(r, z, outline).min() >= MARGIN - 1e-9


def test_slabs_do_not_overlap():
    for name in VESSELS:
        found = slabs(vessel(name))
        for i, a in enumerate(found):
            for b in found[i + 1 :]:
                shared = min(a.z_high, b.z_high) - max(a.z_low, b.z_low)
                if shared > 1e-9:
                    assert a.outer_low <= b.inner_low + 1e-9 or b.outer_low <= a.inner_low + 1e-9


def test_small_slabs_are_left_out():
    outline = vessel("test reactor")
    assert all(min(f.height, f.width) >= 0.3 for f in slabs(outline, min_size=0.3))
    assert len(slabs(outline, min_size=0.3)) < len(slabs(outline))


def test_volume_of_a_slab_is_that_of_its_cones():
    for f in slabs(vessel("free ring")):
        z = np.linspace(0, 1, 20001)
        inner = f.inner_low + z * (f.inner_high - f.inner_low)
        outer = f.outer_low + z * (f.outer_high - f.outer_low)
        assert f.volume == pytest.approx(np.trapezoid(np.pi * (outer**2 - inner**2), z * f.height), rel=1e-7)
