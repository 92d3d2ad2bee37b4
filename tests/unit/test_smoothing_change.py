"""What smoothing does to a field beyond noise: nothing in the paper's two passes, much in a hundred."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.field import Array, Grid, flux_from_psi, level_flow
from granpipe.homogenize.assemble import gaussian_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import measure_plug
from granpipe.homogenize.psi_field import psi_field
from granpipe.pipeline.averages import smoothing_change
from granpipe.pipeline.gates import SMOOTHING

GRID = Grid.covering(1.0, 0.0, 2.0, 0.05)
INSIDE = np.ones(GRID.shape)
DIAMETER = 0.2  # four cells, as granpipe has them; the pipe is ten diameters wide
PSI = np.tile(-0.6 / (2 * np.pi) * (2 * GRID.r_edges**2 - GRID.r_edges**4), (len(GRID.z_edges), 1))  # Poiseuille's


def segments(noise: float, count: int = 40, layers: float = 0.0) -> list[Sums]:
    """Segments of the flow with independent noise, and with layers of particles of which every second one is faster."""
    rng, (_, flux_z) = np.random.default_rng(3), flux_from_psi(PSI, GRID)
    wave = 1 + layers * np.cos(2 * np.pi * GRID.r_centres / DIAMETER)
    across = (GRID.shape[0], GRID.shape[1] + 1)
    return [
        segment(number, noise * rng.normal(size=across), flux_z * (wave + noise * rng.normal(size=flux_z.shape)))
        for number in range(count)
    ]


def segment(number: int, flux_r: Array, flux_z: Array) -> Sums:
    zero, none = np.zeros(GRID.shape), np.zeros(1)
    return Sums(
        grid=GRID, sampling="displacement", start=float(number), stop=number + 1.0, duration=1.0, weight=1.0,
        volume=0.6 * INSIDE * GRID.cell_volume, flow_r=flux_r * GRID.side_area,
        flow_z=flux_z * GRID.ring_area, gain=zero, time=none, level_flow=level_flow(flux_z, GRID)[None],
        solids=none, kinetic=none, count=none,
    )  # fmt: skip


def change(parts: list[Sums], passes: int) -> float:
    plug = measure_plug(merge(parts), INSIDE, (0.0, 0.5), DIAMETER)
    field = gaussian_field(merge(parts), INSIDE, plug, DIAMETER, passes)
    found = smoothing_change(field, parts, DIAMETER)
    assert found is not None
    return found


@pytest.mark.parametrize(("noise", "layers"), [(0.01, 0.0), (0.5, 0.0), (0.01, 0.3)])
@pytest.mark.parametrize("passes", [0, 2])
def test_what_smoothing_takes_from_noise_and_layers_does_not_count(passes: int, noise: float, layers: float) -> None:
    assert change(segments(noise, layers=layers), passes) < 0.04


def test_a_hundred_passes_flatten_the_field() -> None:
    """σ of 100 passes is 10 cells, half the radius; if the parabola 2(1 − r²) became its mean, E would be 1/√3."""
    found = change(segments(0.01), 100)
    assert not SMOOTHING.gate(found).passed
    assert 0.3 < found < 3**-0.5


def test_the_psi_fit_smoothes_no_more_than_noise() -> None:
    parts = segments(0.1)
    plug = measure_plug(merge(parts), INSIDE, (0.0, 0.5), DIAMETER)
    found = smoothing_change(psi_field(parts, INSIDE, plug, DIAMETER).field, parts, DIAMETER)
    assert found is not None
    assert found < 0.02


def test_few_segments_do_not_tell() -> None:
    parts = segments(0.01, count=3)
    plug = measure_plug(merge(parts), INSIDE, (0.0, 0.5), DIAMETER)
    assert smoothing_change(gaussian_field(merge(parts), INSIDE, plug, DIAMETER, 2), parts, DIAMETER) is None
