"""Mask- and wall-aware smoothing, and the bulk mask."""

import numpy as np
import pytest

from granpipe.field import Grid
from granpipe.homogenize.smooth import bulk_mask, flowing_faces, smooth

GRID = Grid.covering(0.4, 0.0, 0.6, 0.02)
ROWS, COLUMNS = GRID.shape


def everywhere():
    return np.ones(GRID.shape, dtype=bool)


def test_plug_flow_stays_plug_flow_up_to_walls_axis_void_and_ends():
    bulk = everywhere()
    bulk[10:15, 8:] = False  # a void
    inside = np.ones(GRID.shape)
    inside[20:, 12:] = 0  # a wall
    faces = flowing_faces(bulk & (inside > 0), inside)
    flux_r, flux_z = smooth(np.zeros((ROWS, COLUMNS + 1)), np.where(faces[1], -0.3, 0), faces, 5)
    assert np.allclose(flux_z[faces[1]], -0.3, rtol=1e-13)
    assert not flux_z[~faces[1]].any()
    assert not flux_r.any()


def test_nothing_enters_void_or_wall():
    bulk = everywhere()
    bulk[10:20, 5:] = False
    faces = flowing_faces(bulk, np.ones(GRID.shape))
    rng = np.random.default_rng(0)
    flux_r, flux_z = smooth(rng.normal(size=(ROWS, COLUMNS + 1)), rng.normal(size=(ROWS + 1, COLUMNS)), faces, 3)
    assert not flux_r[11:19, 7:].any()
    assert not flux_z[11:20, 6:].any()
    assert not flux_r[:, 0].any()  # the axis
    assert not flux_r[:, -1].any()  # the wall


def test_no_face_between_a_cell_and_a_wall_carries_flow():
    inside = np.ones(GRID.shape)
    inside[:12, 10:] = 0
    face_r, face_z = flowing_faces(inside > 0, inside)
    assert not face_r[:12, 10].any()
    assert face_r[12:, 10].all()
    assert not face_z[12, 10:].any()
    assert face_z[12, :10].all()
    assert face_z[0, :10].all()
    assert not face_z[0, 10:].any()
    assert face_z[-1].all()


def test_linear_radial_flow_keeps_its_slope_at_the_axis():
    # u = c r is odd across the axis: its mirror image makes the Gaussian exact there
    faces = flowing_faces(everywhere(), np.ones(GRID.shape))
    flux_r, _ = smooth(np.tile(GRID.r_edges, (ROWS, 1)), np.zeros((ROWS + 1, COLUMNS)), faces, 1)
    assert np.allclose(flux_r[:, :-3], GRID.r_edges[:-3], rtol=1e-12)


def test_vertical_flow_is_even_across_the_axis():
    # w = 1 + r²: the binomial kernel of variance 1 cell² adds h² wherever its window is whole
    faces = flowing_faces(everywhere(), np.ones(GRID.shape))
    profile = 1 + GRID.r_centres**2
    _, flux_z = smooth(np.zeros((ROWS, COLUMNS + 1)), np.tile(profile, (ROWS + 1, 1)), faces, 1)
    assert np.allclose(flux_z[:, :-3], (profile + GRID.cell**2)[:-3], rtol=1e-12)


def test_an_impulse_becomes_the_five_by_five_gaussian():
    faces = flowing_faces(everywhere(), np.ones(GRID.shape))
    impulse = np.zeros((ROWS + 1, COLUMNS))
    impulse[15, 10] = 256
    _, flux_z = smooth(np.zeros((ROWS, COLUMNS + 1)), impulse, faces, 1)
    row = np.array([1, 4, 6, 4, 1])
    assert np.allclose(flux_z[13:18, 8:13], np.outer(row, row))
    assert np.count_nonzero(flux_z) == 25


def packed(inside, packing):
    return packing * inside * GRID.cell_volume


@pytest.mark.parametrize("diameter", [0.04, 0.08, 0.16])
def test_bulk_ends_within_half_a_particle_of_the_surface(diameter):
    inside = np.ones(GRID.shape)
    packing = np.where(GRID.z_centres[:, None] < 0.3, 0.6, 0.0)
    bulk = bulk_mask(packed(inside, packing), inside, GRID, 0.6, diameter)
    assert bulk[GRID.z_centres < 0.3].all()
    assert not bulk[GRID.z_centres > 0.3 + diameter / 2].any()


def test_a_dilute_stream_is_bulk_and_a_few_strays_are_not():
    inside = np.ones(GRID.shape)
    packing = np.full(GRID.shape, 0.01)
    packing[:, 5:8] = 0.025
    bulk = bulk_mask(packed(inside, packing), inside, GRID, 0.6, 0.08)
    assert bulk[:, 5:8].all()
    assert not bulk[:, 10:].any()


def test_the_thin_layer_at_a_wall_is_bulk_although_spheres_leave_gaps_there():
    inside = np.ones(GRID.shape)
    packing = np.full(GRID.shape, 0.6)
    packing[:, 14] = 0.05
    inside[:, 15:] = 0
    bulk = bulk_mask(packed(inside, packing), inside, GRID, 0.6, 0.08)
    assert np.array_equal(bulk, inside > 0)


def test_islands_and_holes_smaller_than_a_particle_are_cleared_away():
    inside = np.ones(GRID.shape)
    packing = np.where(GRID.z_centres[:, None] < 0.3, 0.6, 0.0) * np.ones(GRID.shape)
    plain = bulk_mask(packed(inside, packing), inside, GRID, 0.6, 0.08)
    packing[24, 10] = 0.6  # with its window 9 cells, less than the 16 of a particle
    packing[4:9, 4:9] = 0.0  # its window is empty in 9 cells
    assert np.array_equal(bulk_mask(packed(inside, packing), inside, GRID, 0.6, 0.08), plain)
    packing[22:27, 8:13] = 0.6
    assert bulk_mask(packed(inside, packing), inside, GRID, 0.6, 0.08)[24, 10]
