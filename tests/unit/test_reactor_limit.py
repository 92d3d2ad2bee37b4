"""The benchmark of the limit: packing loses nothing that counts, and combinations give what was put in."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import reactor_limit
from fakes.earlier_runs import results
from fakes.study_points import CASE
from fakes.synthetic import field_of, hopper
from set_back import told

from granpipe.analysis.compare import compare
from granpipe.field import Field, flux_from_psi
from granpipe.pipeline.averages import statistical_errors
from granpipe.study.reference import read_run


def test_a_packed_run_is_a_small_results_folder_of_the_same_field(tmp_path: Path) -> None:
    folder, packed = results(tmp_path / "run"), tmp_path / "packed"
    reactor_limit.pack([folder], packed)
    whole, small = read_run(folder), read_run(packed)
    found = compare(whole.field, small.field, {}, 0.01)[0]
    assert found.observed < 1e-6
    errors = [statistical_errors(run.field, {})["whole"] for run in (whole, small)]
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)
    assert (small.plan.dem.time_step, small.blocks) == (whole.plan.dem.time_step, whole.blocks)
    assert json.loads((packed / "manifest.json").read_text())["files"].keys() == {
        "case.yaml",
        "field.npz",
        "plan.json",
        "provenance.json",
    }
    assert json.loads((packed / "provenance.json").read_text())["origin"]["file"] == "smoke.yaml"
    reactor_limit.pack([folder], packed)  # a second time takes the place of the first


def test_several_fillings_are_packed_as_their_mean_by_travel(tmp_path: Path) -> None:
    """Three times as far with a noise of 1, and once at five times the flow with one of 10: √(0.75² + (0.25 · 2)²)."""

    def filling(flow: float, noise: float, travel: float) -> Callable[[dict], None]:
        def change(files: dict) -> None:
            one = reactor_limit.scaled(files["field"], flow)
            noisy = replace(one, flux_z_se=np.full_like(one.flux_z, noise), flux_r_se=0 * one.flux_r)
            files["field"] = replace(noisy, bulk_flow=flow * one.bulk_flow)
            files["provenance"]["figures"]["averaged_plate_travel_m"] = travel

        return change

    one, other = results(tmp_path / "1", filling(1, 1, 0.3)), results(tmp_path / "2", filling(5, 10, 0.1))
    reactor_limit.pack([one, other], tmp_path / "packed")
    mean, first = read_run(tmp_path / "packed"), read_run(one)
    np.testing.assert_allclose(mean.field.flux_z, first.field.flux_z, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(mean.field.flux_z_se, (0.75**2 + 0.5**2) ** 0.5, rtol=1e-3)
    assert (mean.blocks, mean.travel, mean.cores) == (60, pytest.approx(0.4), 2)
    assert mean.plan.case.dem.replicas == 2
    assert len(mean.failed) == 2


def sized(diameter: float, cell: float = 0.025) -> reactor_limit.Entry:
    """ψ that changes linearly with the diameter: at 0.06 m a plug, at 0 m a parabola."""
    plug, curved = field_of(hopper(0.0), cell), field_of(hopper(1.0), cell)
    assert plug.psi is not None
    assert curved.psi is not None
    psi = plug.psi + (1 - diameter / 0.06) * (curved.psi - plug.psi)
    flux_r, flux_z = flux_from_psi(psi, plug.grid)
    return reactor_limit.Entry("run", replace(plug, psi=psi, flux_r=flux_r, flux_z=flux_z), diameter)


def test_a_mixture_is_the_weighted_sum_on_the_larger_cells_with_the_noise_of_independent_fields() -> None:
    def noisy(entry: reactor_limit.Entry) -> Field:
        one = entry.field
        return replace(one, flux_r_se=np.zeros_like(one.flux_r), flux_z_se=np.full_like(one.flux_z, 0.01))

    made = reactor_limit.mixed([(0.5, noisy(sized(0.06, 0.025))), (0.5, noisy(sized(0.0, 0.0125)))])
    assert made.grid.cell == pytest.approx(0.025)
    assert compare(sized(0.03).field, made, {}, 0.02)[0].observed < 1e-3
    assert made.flux_z_se is not None
    assert np.allclose(made.flux_z_se, 0.01 / np.sqrt(2))


def test_a_field_whose_noise_is_known_by_section_gets_that_noise() -> None:
    levels = {"upper": (1.0, 0.5), "lower": (0.5, 0.0)}
    noise = {"whole": 0.05, "upper": 0.08, "lower": 0.04}
    made = reactor_limit.with_noise(sized(0.03).field, noise, levels)
    found = statistical_errors(made, levels)
    assert found["upper"] == pytest.approx(0.08, rel=0.05)
    assert found["lower"] == pytest.approx(0.04, rel=0.05)
    difference = compare(made, made, levels, 0.03)[0]
    assert told(difference).startswith("<")


def test_velocities_are_those_at_the_flow_rate_of_the_case() -> None:
    one = field_of(hopper(1.0), 0.025)
    made = reactor_limit.unit(one, CASE)
    flow = CASE.flow_rate.mass / (CASE.material.density * one.bulk_packing)
    assert made.bulk_flow == pytest.approx(flow)
    assert np.allclose(made.flux_z, one.flux_z / one.bulk_packing * flow / one.bulk_flow)
