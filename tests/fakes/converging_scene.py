"""A small converging flow with its truth, runs of it, and the errors of a field against it."""

import numpy as np
from fakes.analytic_flow import ConvergingFlow, snapshots
from fakes.spheres import Spheres

from granpipe.field import Grid
from granpipe.homogenize.average import Collector

RADIUS = 0.03
DIAMETER = 2 * RADIUS
FLOW = ConvergingFlow(
    height=0.5, upper_radius=0.25, lower_radius=0.2, cone_top=0.4, cone_bottom=0.1, solids_flow=0.01, peak=0.5
)
GRID = Grid.covering(FLOW.upper_radius + RADIUS, 0.0, FLOW.height, RADIUS / 2)
PLUG = (0.0, 0.1)  # levels of the straight part at the bottom [m]
INTERVAL = 0.6 * DIAMETER / (FLOW.solids_flow / (np.pi * FLOW.lower_radius**2 * FLOW.packing))
TRUTH = FLOW.smeared_flux(GRID.r_edges, GRID.z_edges, RADIUS, 1024)


def wall(z):
    """Radius that the spheres' surfaces reach: their centres' wall and a sphere radius along its normal."""
    radius, slope = FLOW.wall(z)
    return radius + RADIUS * np.sqrt(1 + slope**2)


INSIDE = (GRID.r_edges[None, :-1] < wall(GRID.z_centres)[:, None] - 1e-9).astype(float)


def averaged(seed, count, segments, interval=INTERVAL, sampling="displacement"):
    """Segment sums of one independent run."""
    collector, parts = Collector(GRID, sampling), []
    for number, spheres in enumerate(snapshots(FLOW, np.array([RADIUS]), interval, count + 1, seed)):
        collector.add(number * interval, Spheres(*spheres))
        if number and number % (count // segments) == 0:
            parts.append(collector.take())
    return parts


def relative(error, truth, where):
    area = np.broadcast_to(GRID.ring_area, truth.shape)
    return np.sqrt((area * error**2)[where].sum() / (area * truth**2)[where].sum())


def errors_of(flux_r, flux_z):
    """Relative error of w in the whole, within a diameter of the wall, of the axis, elsewhere; and of u."""
    edge, r = wall(GRID.z_edges)[:, None], np.broadcast_to(GRID.r_centres, TRUTH[1].shape)
    zones = {
        "whole": r >= 0,
        "wall": (r < edge) & (r > edge - DIAMETER),
        "axis": r < DIAMETER,
        "interior": (r > DIAMETER) & (r < edge - DIAMETER),
    }
    side = GRID.side_area * np.ones_like(flux_r)
    u = np.sqrt((side * (flux_r - TRUTH[0]) ** 2).sum() / (side * TRUTH[0] ** 2).sum())
    return {name: relative(flux_z - TRUTH[1], TRUTH[1], zone) for name, zone in zones.items()} | {"u": u}
