"""Residence times against flows whose streamlines are known."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.synthetic import FLOW, PACKING, SCALE, field_of, hopper, pipe, ring_vessel

from granpipe.analysis.residence_time import residence_time
from granpipe.errors import DataError

RATE = FLOW * SCALE  # bulk flow at the flow rate of the case [m³/s]


def test_in_a_plug_everything_stays_equally_long():
    found = residence_time(field_of(pipe(), 0.02))
    expected = np.pi * 0.5**2 * 1.0 / RATE
    assert np.allclose(found.time, expected, rtol=1e-6)
    assert found.quantile(0.1) == pytest.approx(found.quantile(0.9), rel=1e-6)


def test_under_a_parabola_the_axis_is_fastest_and_the_wall_hardly_moves():
    # w = 2U(1 − x), x = (r/R)²; within x flows q = 2x − x², so that T = H / 2U√(1 − q)
    found = residence_time(field_of(pipe(1.0), 0.005))
    mean = np.pi * 0.5**2 * 1.0 / RATE
    assert np.allclose(found.time[:95], (mean / (2 * np.sqrt(1 - found.within)))[:95], rtol=0.02)
    for part in (0.1, 0.5, 0.9):
        assert found.quantile(part) == pytest.approx(mean / (2 * np.sqrt(1 - part)), rel=0.01)
    assert found.time.mean() == pytest.approx(mean, rel=1e-6)  # volume over flow


def test_in_a_hopper_the_mean_is_volume_over_flow():
    found = residence_time(field_of(hopper(), 0.01))
    volume = np.pi / 3 * (0.5**2 + 0.5 * 0.2 + 0.2**2)
    assert found.time.mean() == pytest.approx(volume / RATE, rel=0.01)
    assert np.allclose(found.time, volume / RATE, rtol=0.06)  # ∫ dz/w is the same on every streamline


def test_what_is_at_rest_does_not_count():
    field = field_of(ring_vessel(), 0.01)
    found = residence_time(field)
    # solids within the boundary of the flow, of all solids that are not void
    z = np.linspace(0, 2, 4001)
    moving = np.pi * np.trapezoid(ring_vessel().boundary(z) ** 2, z)
    assert found.time.mean() == pytest.approx(moving / RATE, rel=0.02)
    filled = (field.bulk * field.inside_fraction * field.grid.cell_volume).sum()
    assert found.outside == pytest.approx(1 - moving / filled, abs=0.02)


def test_packing_does_not_matter_for_times_unless_it_varies():
    field = field_of(pipe(), 0.02)
    fluid = replace(field, packing_fraction=None)
    assert np.allclose(residence_time(fluid).time, residence_time(field).time, rtol=1e-12)
    denser = replace(field, packing_fraction=np.full(field.grid.shape, 1.05 * PACKING))
    assert np.allclose(residence_time(denser).time, 1.05 * residence_time(field).time, rtol=1e-12)


def test_a_field_without_stream_function_is_refused():
    with pytest.raises(DataError, match=r"homogenize\.method: psi"):
        residence_time(field_of(pipe(), 0.05, with_psi=False))
