"""How nodal values converge to an analytic flow when the grid is refined."""

import numpy as np
import pytest
from fakes.synthetic import field_of, hopper, ring_vessel

from granpipe.export.nodes import nodal_values


def error(vessel, cell: float, within=lambda r, z: True) -> float:
    """Largest error of bulk velocity on nodes inside the vessel, divided by the largest speed."""
    nodes = nodal_values(field_of(vessel, cell))
    r, z = np.meshgrid(nodes.r, nodes.z)
    u, w = vessel.bulk_velocity(r, z)
    inside = nodes.solids & (r <= vessel.boundary(z) + 1e-12) & within(r, z)
    wrong = np.maximum(np.abs(nodes.bulk_u - u), np.abs(nodes.bulk_w - w))[inside]
    return wrong.max() / np.hypot(u, w)[inside].max()


@pytest.mark.parametrize(("curvature", "limit"), [(0.0, 0.002), (1 / 3, 0.01), (1.0, 0.02)])
def test_second_order_out_to_a_wall_that_cuts_every_row(curvature: float, limit: float) -> None:
    coarse, fine = (error(hopper(curvature), cell) for cell in (0.02, 0.01))
    assert coarse < limit
    assert coarse / fine > 3


def test_second_order_where_the_flow_widens_beside_a_cavity() -> None:
    def inner(r, z):  # the boundary is smooth for z in (0.3, 0.9)
        return (r < 0.2) & (np.abs(z - 0.6) < 0.25)

    coarse, fine = (error(ring_vessel(), cell, inner) for cell in (0.02, 0.01))
    assert coarse / fine > 3.5
