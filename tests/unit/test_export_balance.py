"""The balance of what linear interpolation gives: against flows and divergences known by formula."""

from dataclasses import replace

import numpy as np
import pytest
from fakes.synthetic import FLOW, SCALE, field_of, pipe, ring_vessel

from granpipe.export.balance import balance_of, interpolated_divergence
from granpipe.export.nodes import Nodes, nodal_values


def test_divergence_of_a_linear_velocity_is_exact() -> None:
    r, z = np.linspace(0, 1, 6), np.linspace(0, 2, 9)
    u, w = 3 * r[None, :] + 0 * z[:, None], -4 * z[:, None] + 0 * r[None, :]
    everywhere = np.ones(u.shape, bool)
    nodes = Nodes(r=r, z=z, bulk_u=u, bulk_w=w, solids=everywhere, cells=everywhere[1:, 1:])
    np.testing.assert_allclose(interpolated_divergence(nodes), 2 * 3 - 4, rtol=1e-12)


def test_a_plug_balances_at_every_level() -> None:
    field = field_of(pipe(), 0.05)
    balance = balance_of(field, nodal_values(field))
    assert balance.flow_rate == pytest.approx(FLOW * SCALE)
    for flow in (balance.field, balance.grid, balance.sectionwise):
        np.testing.assert_allclose(flow, FLOW * SCALE, rtol=1e-12)
    assert balance.divergence_max < 1e-15
    assert balance.false_source < 1e-12


def test_linear_interpolation_of_a_parabola_loses_what_chords_lose() -> None:
    # Between nodes h apart, the chord of w = −2W(1 − r²/R²) lies 2W (r − a)(b − r)/R² towards rest: with r ≈ the middle
    # of each ring, the flow lost is Σ 2πr · 2W h³/(6R²) = πWh²/3, which is h²/(3R²) of the flow πR²W.
    cell, radius = 0.05, 0.5
    field = field_of(pipe(1.0, radius), cell)
    balance = balance_of(field, nodal_values(field))
    np.testing.assert_allclose(1 - balance.grid / balance.flow_rate, cell**2 / (3 * radius**2), rtol=1e-9)


def test_what_interpolation_does_shrinks_with_the_cell() -> None:
    coarse, fine = (
        balance_of(field, nodal_values(field)) for field in (field_of(ring_vessel(), h) for h in (0.04, 0.02))
    )
    for balance in (coarse, fine):
        np.testing.assert_allclose(balance.field, balance.flow_rate, rtol=1e-12)
    assert 0 < fine.false_source < 0.7 * coarse.false_source
    worst_coarse, worst_fine = (np.abs(b.sectionwise / b.flow_rate - 1).max() for b in (coarse, fine))
    assert 0 < worst_fine < 0.35 * worst_coarse


def test_the_grid_carries_flow_into_voids_and_the_triangles_do_not() -> None:
    # In a cylinder that flows in r < 0.3 alone, beside a void, the last node at speed W and the next at rest make a
    # skirt of one cell with ∫2πr w dr = πhW(r₁ + h/3) beyond r₁ = 0.3.
    field = field_of(pipe(), 0.05)
    keep = np.arange(10) < 6
    moving = {"flux_z": field.flux_z * keep, "bulk": field.bulk & keep, "psi": None}
    half = replace(field, **moving)
    balance = balance_of(half, nodal_values(half))
    speed = FLOW * SCALE / (np.pi * 0.5**2)
    np.testing.assert_allclose(balance.sectionwise, np.pi * 0.3**2 * speed, rtol=1e-12)
    skirt = np.pi * 0.05 * speed * (0.3 + 0.05 / 3)
    np.testing.assert_allclose(balance.grid - balance.sectionwise, skirt, rtol=1e-12)
