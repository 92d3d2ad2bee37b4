"""Error of the averaged field in a converging flow whose truth is known, and what its error bars are worth."""

import numpy as np
import pytest
from fakes.converging_scene import DIAMETER, FLOW, GRID, INSIDE, PLUG, TRUTH, averaged, errors_of, relative
from scipy import stats

from granpipe.field import divergence, level_flow
from granpipe.homogenize.assemble import gaussian_field
from granpipe.homogenize.average import merge
from granpipe.homogenize.conserve import measure_plug
from granpipe.homogenize.psi_field import psi_field


@pytest.fixture(scope="module")
def errors():
    """method → (whole, wall, axis, interior, u) error, mean of several runs."""
    found = {}
    for seed in range(8):
        parts = averaged(seed, 42, 7)
        sums = merge(parts)
        plug = measure_plug(sums, INSIDE, PLUG, DIAMETER)
        gaussian = {f"gaussian, {n} passes": gaussian_field(sums, INSIDE, plug, DIAMETER, n) for n in (0, 1, 2)}
        fields = gaussian | {"psi": psi_field(parts, INSIDE, plug, DIAMETER).field}
        fluxes = {"raw": sums.mean_flux} | {name: (field.flux_r, field.flux_z) for name, field in fields.items()}
        for name, flux in fluxes.items():
            found.setdefault(name, []).append(list(errors_of(*flux).values()))
    return {name: np.mean(rows, axis=0) for name, rows in found.items()}


def test_the_truth_conserves_and_carries_the_flow():
    assert np.allclose(level_flow(TRUTH[1], GRID), FLOW.solids_flow, rtol=1e-3)
    assert np.abs(divergence(*TRUTH, GRID)).max() * GRID.cell < 5e-3 * np.abs(TRUTH[1]).max()


def test_the_psi_fit_is_best_or_equal_everywhere(errors):
    for name, row in errors.items():
        assert (errors["psi"] <= 1.03 * row).all(), f"{name}: {row} against {errors['psi']}"


def test_the_psi_fit_halves_nothing_away_at_the_wall_as_the_gaussian_does(errors):
    assert errors["gaussian, 2 passes"][1] > 3 * errors["raw"][1]
    assert errors["psi"][1] < 1.1 * errors["raw"][1]


def test_the_error_falls_with_the_length_of_the_run():
    means = []
    for count in (21, 84):
        error = []
        for seed in range(4):
            parts = averaged(100 + seed, count, 7)
            plug = measure_plug(merge(parts), INSIDE, PLUG, DIAMETER)
            field = psi_field(parts, INSIDE, plug, DIAMETER).field
            error.append(relative(field.flux_z - TRUTH[1], TRUTH[1], np.ones(TRUTH[1].shape, dtype=bool)))
        means.append(np.mean(error))
    assert means[1] < 0.75 * means[0]


def test_straight_paths_of_a_diameter_do_not_bend_the_flow():
    # the mean of several runs: what is left is mostly bias; over three diameters the paths cut the corners
    fastest = 1.5 * FLOW.solids_flow / (np.pi * FLOW.lower_radius**2 * FLOW.packing)  # on the axis
    bias = {}
    for travel, sampling in ((1, "velocity"), (1, "displacement"), (3, "displacement")):
        runs = [averaged(seed, 8, 1, travel * DIAMETER / fastest, sampling)[0].mean_flux for seed in range(300, 306)]
        bias[travel, sampling] = errors_of(*(np.mean([run[k] for run in runs], axis=0) for k in (0, 1)))
    for part in ("whole", "u"):
        assert bias[1, "displacement"][part] < 1.5 * bias[1, "velocity"][part]
    assert bias[3, "displacement"]["u"] > 3 * bias[1, "displacement"]["u"]


@pytest.mark.slow
def test_nominal_intervals_hold_the_truth_as_often_as_they_say():
    # over 10 independent runs: of the faces with more than 5 % of the mean flux, 90–99 % within Student's 95 %
    mean = np.sqrt(np.average(TRUTH[1] ** 2, weights=np.broadcast_to(GRID.ring_area, TRUTH[1].shape)))
    held = {"raw": [], "final": []}
    for seed in range(10):
        parts = averaged(200 + seed, 84, 7)
        plug = measure_plug(merge(parts), INSIDE, PLUG, DIAMETER)
        fitted = psi_field(parts, INSIDE, plug, DIAMETER)
        field, reach = fitted.field, stats.t.ppf(0.975, fitted.effective_blocks - 1)
        pairs = {
            "raw": ((field.raw_flux_r, field.raw_flux_r_se), (field.raw_flux_z, field.raw_flux_z_se)),
            "final": ((field.flux_r, field.flux_r_se), (field.flux_z, field.flux_z_se)),
        }
        for name, components in pairs.items():
            inside = [
                (np.abs(flux - truth) <= reach * se)[np.abs(truth) > 0.05 * mean]
                for (flux, se), truth in zip(components, TRUTH, strict=True)
            ]
            held[name].append(np.concatenate(inside).mean())
    for name, shares in held.items():
        assert 0.90 <= np.mean(shares) <= 0.99, f"{name}: {np.mean(shares):.3f}"
