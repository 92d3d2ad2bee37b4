"""The ψ fit: from segment sums to a `Field` with standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, Mask, flux_from_psi, level_flow
from granpipe.homogenize.assemble import raw_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, gathered_flow, plug_levels
from granpipe.homogenize.psi_fit import NormalEquations, PsiFit, Roles, Weights, node_roles
from granpipe.homogenize.smooth import flowing_faces
from granpipe.homogenize.statistics import BLOCKS, LEAST_BLOCKS, blocks, flux_errors, standard_error

SMOOTHING_LENGTHS = (0.1, 0.2, 0.3, 0.45, 0.6, 0.8)
"""Candidates for ℓ, in particle diameters."""

CLEARANCE = 1.25
"""Nothing is smoothed within this many particle diameters of walls and voids."""

_VARIANCE_REACH = 1.0  # diameters: the variance is seen through a Gaussian of this width
_LEAST_VARIANCE = 0.01  # of its mean
MOST_STORAGE = 0.2  # of the flow

Flux = tuple[Array, Array]
Data = tuple[Flux, float]


@dataclass(frozen=True)
class PsiFitted:
    """A field made by the ψ fit, and how.

    field : the field
    smoothing_length : ℓ [m], the candidate that predicts left-out blocks best
    blocks : how many blocks of segments the standard errors rest on; none are given below 7
    effective_blocks : equivalent number of independent blocks
    storage : largest part of the flow that gathers between the plug and a level, taken off before the fit
    scatter : how far the runs' own fields lie apart, over what the standard errors let expect; None for a single run
    """

    field: Field
    smoothing_length: float
    blocks: int
    effective_blocks: float
    storage: float
    scatter: float | None


def psi_field(
    segments: Sequence[Sums], inside_fraction: Array, plug: Plug, diameter: float, flow_scale: float = 1.0
) -> PsiFitted:
    """Fit ψ to the average of some segments, and to that of each block of them for the standard error.

    Errors allow for the correlation that neighbouring blocks still have, by component and place (`flux_errors`).

    Parameters
    ----------
    segments : segments of equal length; from 7 on the field has standard errors
    inside_fraction : (nz, nr) part of each cell inside the outline
    plug : packing and flow in the plug, of all segments together
    diameter : particle diameter [m]
    flow_scale : flow of the case over that of the simulation

    Raises
    ------
    DataError : fewer than two segments, or segments that do not differ
    """
    if len(segments) < 2:
        raise DataError("the ψ fit takes its weights from how segments differ: average two segments or more")
    sums = merge(segments)
    raw = raw_field(sums, inside_fraction, plug, diameter, flow_scale)
    independent = blocks(segments, min(len(segments), BLOCKS))
    run = np.array([block.run for block in independent])
    raw_se, _ = flux_errors([block.mean_flux for block in independent], run, sums.grid, diameter)
    if raw_se[1].max() < 1e-9 * np.abs(sums.mean_flux[1]).max():
        raise DataError("the segments do not differ at all: no standard error can be had from them")
    weights = _weights(raw_se, flowing_faces(raw.bulk, inside_fraction), sums.grid, diameter)
    roles = node_roles(inside_fraction, raw.bulk)
    steady = _Steady(sums, plug)
    long = blocks(segments, min(len(segments), LEAST_BLOCKS))  # short ones share noise with their neighbours
    fit = _best_fit([steady.data(block) for block in long], sums.grid, roles, weights, diameter)
    psi = fit.solve(*steady.flux(sums), plug.solids_flow)
    flux_r, flux_z = flux_from_psi(psi, sums.grid)
    field = replace(raw, psi=psi, flux_r=flux_r, flux_z=flux_z)
    fluxes = [flux_from_psi(fit.solve(*flux, flow), sums.grid) for flux, flow in map(steady.data, independent)]
    se, effective = flux_errors(fluxes, run, sums.grid, diameter)
    if len(segments) >= LEAST_BLOCKS:
        field = replace(field, raw_flux_r_se=raw_se[0], raw_flux_z_se=raw_se[1], flux_r_se=se[0], flux_z_se=se[1])
    return PsiFitted(
        field=field,
        smoothing_length=fit.smoothing_length,
        blocks=len(independent),
        effective_blocks=effective,
        storage=steady.storage,
        scatter=_scatter(fluxes, run, se[1], sums.grid),
    )


def _best_fit(data: Sequence[Data], grid: Grid, roles: Roles, weights: Weights, diameter: float) -> PsiFit:
    """The fit whose smoothing length predicts left-out blocks best; no more than two are held at a time."""
    best, least = None, np.inf
    equations = NormalEquations(grid, roles, weights, CLEARANCE * diameter)
    for length in SMOOTHING_LENGTHS:
        fit = equations.fit(length * diameter)
        error = _prediction_error(fit, data, weights)
        if best is None or error < least:
            best, least = fit, error
    assert best is not None
    return best


def _prediction_error(fit: PsiFit, data: Sequence[Data], weights: Weights) -> float:
    """Weighted squares of what each block holds less what the fit to all others says: cross-validation.

    The noise of the block left out is in it, the same for every fit; what differs is the fit's own error.
    """
    count = len(data)
    total = [sum(flux[axis] for flux, _ in data) for axis in (0, 1)]
    all_flow = sum(flow for _, flow in data)
    error = 0.0
    for flux, flow in data:
        rest = [(whole - own) / (count - 1) for whole, own in zip(total, flux, strict=True)]
        told = flux_from_psi(fit.solve(rest[0], rest[1], (all_flow - flow) / (count - 1)), fit.grid)
        error += float((weights.r * (told[0] - flux[0]) ** 2).sum() + (weights.z * (told[1] - flux[1]) ** 2).sum())
    return error


class _Steady:
    """Takes from an average the part of the flow that fills or empties the vessel: a steady field has none.

    What level z carries beyond the plug's flow is what gathers in the rows between the two, as measured from the
    deposited volume. It is taken off in the shape of the whole average's own flux at that level, so that the operation
    is linear and blocks may be treated one by one.
    """

    def __init__(self, sums: Sums, plug: Plug) -> None:
        self._levels = plug_levels(sums.grid, plug.z_range)
        self._mean = sums.mean_flux
        self._flow = level_flow(self._mean[1], sums.grid)
        self._range = plug.z_range
        excess = gathered_flow(sums, self._range)
        worst = int(np.argmax(np.abs(excess)))
        self.storage = float(abs(excess[worst]) / plug.solids_flow)
        if self._flow.min() <= 0:
            z = sums.grid.z_edges[int(np.argmin(self._flow))]
            raise DataError(f"no downward flow through z = {z:g} m in the average: blocked there, or average longer")
        if self.storage > MOST_STORAGE:
            held = self._flow[worst] < plug.solids_flow
            remedy = "; if an arch holds it up, use smaller particles or a wider opening" if held else ""
            raise DataError(
                f"the filling changes too fast for a steady field: between the plug and z = "
                f"{sums.grid.z_edges[worst]:g} m {self.storage:.0%} of the flow gathers, of which {MOST_STORAGE:.0%} "
                f"are allowed; average later or longer{remedy}"
            )

    def data(self, sums: Sums) -> Data:
        """What ψ is fitted to: the flux, and the solids flow in the plug [m³/s]."""
        return self.flux(sums), float(level_flow(sums.mean_flux[1], sums.grid)[self._levels].mean())

    def flux(self, sums: Sums) -> Flux:
        """Mean flux less the part that storage explains."""
        flux_r, flux_z = sums.mean_flux
        part = gathered_flow(sums, self._range) / self._flow
        return (
            flux_r - self._mean[0] * (0.5 * (part[1:] + part[:-1]))[:, None],
            flux_z - self._mean[1] * part[:, None],
        )


def _scatter(fluxes: Sequence[Flux], run: NDArray[np.int64], se_z: Array, grid: Grid) -> float | None:
    """√(Σ A s² / Σ A SE²) of the vertical flux, s the standard error that the means of the single runs tell."""
    runs = np.unique(run)
    if len(runs) < 2:
        return None
    flux_z = np.array([flux[1] for flux in fluxes])
    between = standard_error(np.array([flux_z[run == one].mean(axis=0) for one in runs]))
    return float(np.sqrt((between**2 @ grid.ring_area).sum() / (se_z**2 @ grid.ring_area).sum()))


def _weights(se: Flux, faces: tuple[Mask, Mask], grid: Grid, diameter: float) -> Weights:
    """1/s² from standard errors, which a few blocks give only roughly.

    The variance per face goes down with the area of its ring; times that area it varies slowly, and is seen through a
    Gaussian.
    """
    area_r = np.maximum(grid.side_area, 0.5 * grid.side_area[1])
    along_z = _smooth_variance(se[1] ** 2 * grid.ring_area, faces[1], grid, diameter)
    along_r = se[0] ** 2 * area_r
    if not along_r[faces[0]].any():  # a rigid motion: nothing ever moves sidewise, and that is known as well
        along_r = np.full_like(along_r, along_z.mean())
    return Weights(area_r / _smooth_variance(along_r, faces[0], grid, diameter), grid.ring_area / along_z)


def _smooth_variance(variance: Array, faces: Mask, grid: Grid, diameter: float) -> Array:
    reach = _VARIANCE_REACH * diameter / grid.cell
    known = faces & (variance > 0)
    seen = ndimage.gaussian_filter(np.where(known, variance, 0), reach)
    counted = ndimage.gaussian_filter(known.astype(float), reach)
    mean = float(variance[known].mean())
    smooth = np.divide(seen, counted, out=np.full_like(variance, mean), where=counted > 1e-6)
    return np.asarray(np.maximum(smooth, _LEAST_VARIANCE * mean))
