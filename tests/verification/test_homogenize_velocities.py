"""Solids flux, bulk velocity and particle velocity on rings: each follows from the others, whatever the packing."""

import numpy as np
import pytest
from fakes.spheres import Spheres
from scipy.stats import qmc

from granpipe.field import Grid
from granpipe.homogenize.assemble import raw_field, unguided_plug
from granpipe.homogenize.average import Collector
from granpipe.pipeline.extra_fields import particle_velocity

RADIUS, HEIGHT = 0.3, 0.4
GRID = Grid.covering(RADIUS, 0.0, HEIGHT, 0.025)


def packing(r):
    """From 0.4 on the axis to 0.62 at the wall."""
    return 0.4 + 0.22 * r / RADIUS


MOTIONS = {
    "shear": lambda r, z: (0 * r, -0.1 - 0.5 * r),
    "converging": lambda r, z: (-0.3 * r, -0.4 + 0.6 * z),
}


def moving(motion):
    """Small spheres of the packing above that move as told, beyond the ends of the grid too."""
    beyond, tall = 1.1 * RADIUS, (-0.02, HEIGHT + 0.02)
    draws = qmc.Sobol(3, rng=1).random(2**17)
    at = np.linspace(0, beyond, 2000)
    total = np.cumsum(packing(at) * at)
    r = np.interp(draws[:, 0], (total - total[0]) / (total[-1] - total[0]), at)
    angle, z = 2 * np.pi * draws[:, 1], tall[0] + draws[:, 2] * np.ptp(tall)
    u, w = MOTIONS[motion](r, z)
    solids = 2 * np.pi * np.trapezoid(packing(at) * at, at) * np.ptp(tall)
    radius = np.full(len(r), (solids / len(r) * 3 / 4 / np.pi) ** (1 / 3))
    place = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    velocity = np.column_stack([u * np.cos(angle), u * np.sin(angle), w])
    return Spheres(np.arange(len(r)), place, velocity, radius)


@pytest.mark.parametrize("motion", MOTIONS)
def test_flux_to_bulk_velocity_to_particle_velocity_and_back(motion):
    collector = Collector(GRID)
    collector.add(0.0, moving(motion))
    sums = collector.take()
    field = raw_field(sums, np.ones(GRID.shape), unguided_plug(sums), 0.01)
    r, z = np.meshgrid(GRID.r_centres, GRID.z_centres)
    inner = np.s_[:, :-1]  # what reaches across the outermost edge counts in the outermost ring
    assert np.abs(field.packing_fraction - packing(r))[inner].max() < 0.03
    exact = MOTIONS[motion](r, z)
    size = np.hypot(*exact).max()
    flux = 0.5 * (field.flux_r[:, 1:] + field.flux_r[:, :-1]), 0.5 * (field.flux_z[1:] + field.flux_z[:-1])
    for component, particle, known in zip(flux, particle_velocity(field), exact, strict=True):
        bulk = component * field.velocity_scale
        assert np.sqrt(np.mean((particle - known)[inner] ** 2)) < 0.02 * size
        assert np.allclose(particle * field.packing_fraction, bulk * field.bulk_packing, rtol=1e-12, atol=1e-15)
