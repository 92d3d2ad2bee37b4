"""Statistics of a correlated run: onset of the steady state, blocks, standard errors, trends, off-centre flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from granpipe.errors import DataError
from granpipe.field import Array, Grid, Mask
from granpipe.homogenize.average import Sums, merge

LEAST_BLOCKS = 7
"""Fewer give no standard error."""

BLOCKS = 60
"""Blocks that the standard errors of a field rest on, where there are so many segments."""

_REACH = 1.0  # diameters: correlation times are seen through a Gaussian of this width
_LEAST_CORRELATED = 0.25  # samples, as a correlation time
_LEAST_WINDOW = 8
"""Lags: to 0.8 diameters of travel where blocks are shortest; what flowed too much has come back at 1.6."""
_MOST_CORRELATED = 1 / 3  # of the samples, as a correlation time: longer ones cannot be told from a trend


def onset(products: Array, more: Array | float = 0.0) -> int:
    """Number of samples to leave out at the beginning, at most half of them, for the least mean squared error.

    Of all truncations t, the one with the least estimated squared error of the remaining mean, bias² + variance
    (Pasupathy & Schmeiser 2010), where neighbouring samples are correlated: the variance of a mean of n samples is
    γ₀ τ/n, with γ₀ and τ those of the second half of the run. The bias is told by the difference from the mean of that
    half. Without a transient the variance of the difference is the difference of the variances (Hausman 1978); what
    exceeds it counts as bias².

    Parameters
    ----------
    products : (n, n) products of the n samples with each other, x @ x.T for samples x (n, m) that are scaled as they
        count in the error
    more : (n,) squared error that the mean of what is left from each sample on has besides
    """
    count, half = len(products), len(products) // 2
    if half < 2:
        return 0
    late = _centred(products[half:, half:])
    time = len(late) / _effective(late, np.zeros(len(late), dtype=int))
    # the samples' own mean takes the share τ/n of their variance with it
    long_run = time * np.trace(late) / len(late) / (1 - time / len(late))
    left = np.arange(count, 0, -1)[: half + 1]
    sums = products[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)[::-1, ::-1][: half + 1, : half + 1]
    means = sums / left[:, None] / left  # products of the means of what is left
    apart = means.diagonal() - 2 * means[half] + means[half, half]
    variance = long_run / left
    bias = np.maximum(apart - (variance[half] - variance), 0.0)  # squared
    return int(np.argmin(bias + variance + np.broadcast_to(more, count)[: half + 1]))


def _centred(products: Array) -> Array:
    """Products of samples with each other, of what they differ from their mean by."""
    means = products.mean(axis=0)
    return np.asarray(products - means - means[:, None] + means.mean())


def blocks(segments: Sequence[Sums], least: int = LEAST_BLOCKS) -> list[Sums]:
    """Join neighbouring segments of each run into the longest equal blocks that leave at least `least` of them.

    Long blocks are nearly independent of each other; left-over segments at the beginning of a run go into no block.
    Ordered by run, then by time.

    Raises
    ------
    DataError : too few segments for blocks
    """
    if len(segments) < least:
        raise DataError(f"{len(segments)} segments give no standard error; at least {least} are needed: average longer")
    ordered = sorted(segments, key=lambda segment: segment.start)
    runs = [
        [segment for segment in ordered if segment.run == run] for run in sorted({segment.run for segment in ordered})
    ]
    length = next(n for n in range(len(ordered) // least, 0, -1) if sum(len(run) // n for run in runs) >= least)
    return [merge(run[at : at + length]) for run in runs for at in range(len(run) % length, len(run), length)]


def standard_error(values: Array, effective: Array | float | None = None) -> Array:
    """Standard error of the mean of (n, …) values along the first axis, from `effective` independent ones (or n)."""
    count = len(values) if effective is None else effective
    return np.asarray(values.std(axis=0) / np.sqrt(np.asarray(count) - 1))


def effective_samples(values: Array, run: NDArray[np.int64]) -> float:
    """How many independent samples fix a mean as well as these n correlated ones: n/τ; above n where they alternate.

    τ is that of all columns together (`_correlation_time`).

    Parameters
    ----------
    values : (n, m) samples of m quantities, scaled as they shall count, in the order of run and time
    run : (n,) which run each sample is of; runs are independent
    """
    deviation = values - values.mean(axis=0)
    return _effective(deviation @ deviation.T, run)


def _effective(products: Array, run: NDArray[np.int64]) -> float:
    """`effective_samples` by the products (n, n) of the samples' deviations from their mean."""
    count = len(products)
    same = run[:, None] == run
    lagged = [np.diagonal(products, lag)[np.diagonal(same, lag)] for lag in range(count // 2)]
    covariance = np.array([pairs.mean() for pairs in lagged if pairs.size])
    if len(covariance) < 2:
        return float(count)
    return count / float(_correlation_time(covariance, count))


def local_effective_samples(values: Array, run: NDArray[np.int64], reach: float) -> Array:
    """(nz, nr) the same place by place, for n correlated samples on a grid.

    What is far apart, or flows in another direction, is correlated over other times: where solids creep along a wall
    the same particles stay for long. Covariances are seen through a Gaussian, since those of one place are noisy.

    Parameters
    ----------
    values : (n, nz, nr) samples, scaled so that neighbours count alike
    run : (n,) which run each sample is of; runs are independent
    reach : width of the Gaussian, in cells
    """
    count = len(values)
    deviation = values - values.mean(axis=0)
    lags = []
    for lag in range(count // 2):
        same = run[: count - lag] == run[lag:]
        if not same.any():
            break
        products = np.einsum("i...,i...->...", deviation[: count - lag][same], deviation[lag:][same]) / same.sum()
        lags.append(ndimage.gaussian_filter(products, reach, mode="nearest"))
    if len(lags) < 2:
        return np.full(values.shape[1:], float(count))
    return count / _correlation_time(np.array(lags), count)


def flux_errors(
    fluxes: Sequence[tuple[Array, Array]], run: NDArray[np.int64], grid: Grid, diameter: float
) -> tuple[tuple[Array, Array], float]:
    """Standard errors of the mean flux through every face, and how many independent samples there are in all.

    The errors go by the correlation times of each component and place: one time for all is too short for the radial
    motion and too long for the vertical one, which the plate controls.

    Parameters
    ----------
    fluxes : flux through the cylindrical and the horizontal faces, sample by sample, in the order of run and time
    run : (n,) which run each sample is of
    diameter : of the particles [m]
    """
    flux_r, flux_z = (np.array(component) for component in zip(*fluxes, strict=True))
    through = [flux_r * np.sqrt(grid.side_area), flux_z * np.sqrt(grid.ring_area)]
    effective = effective_samples(np.concatenate([a.reshape(len(a), -1) for a in through], axis=1), run)
    local_r, local_z = (local_effective_samples(a, run, _REACH * diameter / grid.cell) for a in through)
    return (standard_error(flux_r, local_r), standard_error(flux_z, local_z)), min(effective, len(fluxes))


def local_errors(values: Array, run: NDArray[np.int64], grid: Grid, diameter: float) -> Array:
    """Standard errors of the mean of (n, …) samples on a grid of equal cells, by the correlation times of each place.

    Parameters
    ----------
    values : samples in the order of run and time
    run : (n,) which run each sample is of
    diameter : of the particles [m]
    """
    return standard_error(values, local_effective_samples(values, run, _REACH * diameter / grid.cell))


def errors_in_space(
    fluxes: Sequence[tuple[Array, Array, Array]], run: NDArray[np.int64], grid: Grid, diameter: float
) -> tuple[tuple[Array, Array, Array], float]:
    """Standard errors of the mean flux through every face in space, and how many independent samples there are.

    A face sees only few particles pass, without a ring to average over: its own variance is as uncertain as from three
    degrees of freedom. So variances, as covariances, are seen through a Gaussian of one particle diameter; and nowhere
    do samples count for more than those of the whole component, for slow motion is wide and local noise hides it.
    Intervals are Student's with one degree of freedom less than the independent samples.

    Parameters
    ----------
    fluxes : along x, y and z, sample by sample, in the order of run and time
    run : (n,) which run each sample is of
    diameter : of the particles [m]
    """
    reach, errors, independent = _REACH * diameter / grid.cell, [], float(len(fluxes))
    for values in (np.array(component) for component in zip(*fluxes, strict=True)):
        whole = effective_samples(values.reshape(len(values), -1), run)
        effective = np.minimum(local_effective_samples(values, run, reach), whole)
        variance = values.var(axis=0)
        varies = variance > 1e-24 * (values**2).mean(axis=0)  # not by rounding alone
        seen, counted = (
            ndimage.gaussian_filter(one, reach, mode="constant") for one in (variance, varies.astype(float))
        )
        mean = np.divide(seen, counted, out=np.zeros_like(seen), where=varies)
        errors.append(np.sqrt(mean / (effective - 1)))
        independent = min(independent, whole)
    return (errors[0], errors[1], errors[2]), independent


def _correlation_time(covariance: Array, count: int) -> Array:
    """(…) τ from the covariances (lags, …) of `count` samples; 1 where nothing varies.

    τ = 1 + 2 Σ w_k (1 − k/n) ρ_k, with w 1 up to lag m and falling to 0 at 2m (the flat-top window of Politis & Romano
    1995): unlike one that ends where ρ turns negative, it counts what comes back, and unlike means of long blocks it
    has no error of the order 1/m. m is the least that is not below `_LEAST_WINDOW` and 2 τ itself (as Sokal's rule
    does it), as long as 2m lags are known. Covariances about the samples' own mean lack that mean's variance, γ₀ τ/n;
    with it, ρ_k is [γ_k/γ₀ (n − τ) + τ]/n, and the equation is linear in τ.
    """
    lag = np.arange(len(covariance))
    seen = covariance / np.where(covariance[0] > 0, covariance[0], 1.0)
    most = max(len(covariance) // 2, 1)
    time, short = np.ones(covariance.shape[1:]), np.ones(covariance.shape[1:], dtype=bool)
    for width in range(min(_LEAST_WINDOW, most), most + 1):
        weight = np.clip(2 - lag / width, 0, 1) * (1 - lag / count)
        total = np.tensordot(weight, seen, axes=1)
        found = np.maximum(2 * total - 1, 0) / np.maximum(1 - 2 * (weight.sum() - total) / count, 1e-9)
        time = np.where(short, np.clip(found, _LEAST_CORRELATED, _MOST_CORRELATED * count), time)
        short = short & (width < 2 * time)
        if not short.any():
            break
    return np.where(covariance[0] > 0, time, 1.0)


def turnovers(sums: Sums, z_range: tuple[float, float]) -> float:
    """How often the solids between two levels [m] were renewed: outflow below times duration, over their volume."""
    rows = _rows_between(sums.grid, z_range)
    lowest = int(np.argmax(rows))
    outflow = -float(sums.flow_z[lowest].sum()) / sums.weight
    return outflow * sums.duration / float(sums.mean_volume[rows].sum())


@dataclass(frozen=True)
class Trend:
    """A straight line through block means.

    change : from the first block to the last, in the units of the values
    p_value : chance of at least such a slope without a trend (Student's t on independent blocks)
    """

    change: float
    p_value: float


def trend(values: Array) -> Trend:
    """Trend of (n,) block means: packing, mean particle size, level of a free surface."""
    from scipy.stats import linregress  # takes half a second

    fit = linregress(np.arange(len(values)), values)
    return Trend(float(fit.slope) * (len(values) - 1), float(fit.pvalue))


@dataclass(frozen=True)
class OffCentre:
    """What ring averages hide: flow that is not the same all round.

    With the solids flow per angle ∝ 1 + a₁ cos(θ − θ₁) + a₂ cos 2(θ − θ₂) + …

    amplitude : (2,) a₁ (leaning to one side) and a₂ (two-lobed)
    amplitude_se : (2,) standard errors; without any asymmetry the amplitude is of their size, not 0
    swirl : mean v_θ over mean downward speed, both weighted by volume
    swirl_se : its standard error
    """

    amplitude: Array
    amplitude_se: Array
    swirl: float
    swirl_se: float


def off_centre(segments: Sequence[Sums], z_range: tuple[float, float]) -> OffCentre:
    """Asymmetry of the flow between two levels [m], with errors from blocks.

    Raises
    ------
    DataError : the segments hold no moments about the axis
    """
    rows = _rows_between(segments[0].grid, z_range)
    totals = []
    for block in blocks(segments):
        if block.moments is None:
            raise DataError("these segment sums hold no moments about the axis; run again")
        totals.append(block.moments[:, rows].sum(axis=1) / block.weight)
    flow, waves, spin = np.split(np.array(totals), [1, 5], axis=1)
    mean_flow = flow.mean()
    waves, spin = 2 * waves / mean_flow, -spin / mean_flow
    mean, error = waves.mean(axis=0).reshape(2, 2), standard_error(waves).reshape(2, 2)
    return OffCentre(
        np.hypot(*mean.T), np.sqrt((error**2).mean(axis=1)), float(spin.mean()), float(standard_error(spin)[0])
    )


def _rows_between(grid: Grid, z_range: tuple[float, float]) -> Mask:
    rows = (grid.z_centres > z_range[0]) & (grid.z_centres < z_range[1])
    if not rows.any():
        raise DataError(f"no row of the grid lies between z = {z_range[0]:g} and {z_range[1]:g} m")
    return np.asarray(rows)
