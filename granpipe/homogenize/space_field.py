"""A field in space that conserves, from segment sums: the change of the average that is least by its own errors.

Solids enter no cell that they do not leave, and pass no wall: of all such flows Q through the faces, the one with the
least Σ (Q − Q̄)²/s² is taken, Q̄ the average and s its standard error, smoothed over a particle diameter. With the
multiplier λ of each cell, Q = Q̄ + s² Δλ, where Δλ is the difference across the face: a Poisson equation on the cells,
solved by conjugate gradients with an algebraic multigrid (Bell, Olson, Schroder & Southworth, J. Open Source Softw. 8
(2023) 5495).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import cg

from granpipe.errors import DataError, SolveError
from granpipe.field import Array, Box, Field, Mask, level_flow, section_rows
from granpipe.homogenize.assemble import raw_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug
from granpipe.homogenize.space_outlets import Faces, OutletCells, OutletFaces, face_areas, fluxes, left_above
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, errors_in_space, local_errors, standard_error

BLOCKS = 2 * LEAST_BLOCKS
"""Blocks that the standard errors rest on, where there are so many segments."""

BALANCE = 1e-12
"""Largest imbalance of a cell over the flow through the vessel."""

_ROUGH = 1e-6  # of the right side, at which a solve begins anew with what is left
_MOST_SOLVES, _MOST_STEPS = 6, 200
_DIRECT = 500  # cells of the coarsest grid
_LEAST_VARIANCE = 0.01  # of the mean


@dataclass(frozen=True)
class SpaceFitted:
    """A field in space that conserves, and how it was made.

    field : the field
    blocks : how many blocks of segments the standard errors rest on; none are given below 7
    effective_blocks : as how many independent ones they count, where there are standard errors
    change : of the average by conserving, beyond noise, relative
    out : (1 + blocks, outlets) solids that leave through each outlet, of the whole and of each block [m³/s]
    """

    field: Field
    blocks: int
    effective_blocks: float
    change: float
    out: Array


def space_field(
    segments: Sequence[Sums],
    inside_fraction: Array,
    plug: Plug,
    diameter: float,
    flow_scale: float = 1.0,
    outlets: OutletCells | None = None,
    most_blocks: int = BLOCKS,
) -> SpaceFitted:
    """Make the average of some segments conserve, and that of each block of them for the standard error.

    Parameters
    ----------
    segments : on a grid in space, of equal length; from 7 on the field has standard errors
    inside_fraction : (nz, ny, nx) part of each cell inside the vessel
    plug : packing and flow in the plug
    diameter : particle diameter [m]
    flow_scale : flow of the case over that of the simulation
    outlets : cells beyond each outlet, and its part of the flow where that is known; without them solids leave
        through all lowest faces
    most_blocks : that the standard errors rest on

    Raises
    ------
    DataError : fewer than two segments, or nothing flows down through the vessel
    SolveError : the equation was not solved to `BALANCE`
    """
    if len(segments) < 2:
        raise DataError("errors of faces come from how segments differ: average two segments or more")
    sums = merge(segments)
    grid = sums.grid
    assert isinstance(grid, Box)
    raw = raw_field(sums, inside_fraction, plug, diameter, flow_scale)
    independent = blocks(segments, min(len(segments), most_blocks))
    each, run = [fluxes(block) for block in independent], np.array([block.run for block in independent])
    leaving = [] if outlets is None else outlets.faces(raw.bulk)
    faces = _flowing(raw.bulk, leaving)
    area = face_areas(grid)
    rough = [local_errors(np.array(one), run, grid, diameter) for one in zip(*each, strict=True)]
    variance = _variances([(a * se) ** 2 for a, se in zip(area, rough, strict=True)], faces, grid, diameter)
    given = [one for one in leaving if one.share is not None]
    projection = Projection(raw.bulk, faces, variance, given)
    asked = [one.share * plug.solids_flow for one in given if one.share is not None]

    def flow_of(flux: Faces) -> Faces:
        return flux[0] * area[0], flux[1] * area[1], flux[2] * area[2]

    def conserving(flux: Faces) -> Faces:
        x, y, z = projection.of(flow_of(flux), plug.solids_flow, asked)
        return x / area[0], y / area[1], z / area[2]

    flux_r, flux_y, flux_z = final = conserving(fluxes(sums))
    flow = float((level_flow(flux_z, grid) + left_above(leaving, flow_of(final))).mean())
    if not flow > 0:
        raise DataError(f"nothing flows down through the vessel: {flow:.3g} m³/s of solids on average")
    change = _change(final, sums, independent, raw.bulk, diameter, leaving)
    field = replace(
        raw, flux_r=flux_r, flux_y=flux_y, flux_z=flux_z, bulk_flow=flow / plug.packing,
        flow_scale=flow_scale * plug.solids_flow / flow,
    )  # fmt: skip
    out, effective = [[one.out(flow_of(final)) for one in leaving]], float(len(each))
    if len(segments) >= LEAST_BLOCKS:
        fitted = [conserving(one) for one in each]
        out += [[one.out(flow_of(block)) for one in leaving] for block in fitted]
        (x, y, z), effective = errors_in_space(fitted, run, grid, diameter)
        (raw_x, _, raw_z), _ = errors_in_space(each, run, grid, diameter)
        field = replace(field, flux_r_se=x, flux_y_se=y, flux_z_se=z, raw_flux_r_se=raw_x, raw_flux_z_se=raw_z)
    return SpaceFitted(field, len(each), effective, change, np.array(out))


def space_errors(field: Field, levels: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """E = √(Σ SE² / Σ F²) over the cells of solids, whole and per section, of all three components."""
    errors = field.flux_r_se, field.flux_y_se, field.flux_z_se
    assert errors[0] is not None
    assert errors[1] is not None
    assert errors[2] is not None
    assert field.flux_y is not None

    def squares(x: Array, y: Array, z: Array) -> Array:
        middles = (x[..., 1:] + x[..., :-1]) ** 2 + (y[:, 1:] + y[:, :-1]) ** 2 + (z[1:] + z[:-1]) ** 2
        return np.asarray(np.where(field.bulk, 0.25 * middles, 0.0).sum(axis=(1, 2)))

    error, flux = squares(errors[0], errors[1], errors[2]), squares(field.flux_r, field.flux_y, field.flux_z)
    rows = section_rows(field.grid, levels)
    return {name: float(np.sqrt(error[at].sum() / max(flux[at].sum(), 1e-300))) for name, at in rows.items()}


class Projection:
    """The flows nearest to given ones that leave no cell with more or less.

    Parameters
    ----------
    cells : (nz, ny, nx) that solids flow or rest in
    faces : that may carry flow
    variance : of the flow through each [m⁶/s²]
    outlets : those whose flow is given, and nothing else leaves there
    """

    def __init__(
        self, cells: Mask, faces: Sequence[Mask], variance: Faces, outlets: Sequence[OutletFaces] = ()
    ) -> None:
        import pyamg

        self._faces = faces
        number = np.full(cells.shape, -1)
        number[cells] = np.arange(cells.sum())
        columns, signs, rows, places, count = [], [], [], [], 0
        for axis, face in zip((2, 1, 0), faces, strict=True):
            place = np.full(face.shape, -1)
            place[face] = count + np.arange(face.sum())
            places.append(place)
            count += int(face.sum())
            ends = [np.delete(place, end, axis) for end in (-1, 0)]  # faces before and after each cell
            for sign, end in zip((-1.0, 1.0), ends, strict=True):
                here = cells & (end >= 0)
                rows.append(number[here])
                columns.append(end[here])
                signs.append(np.full(here.sum(), sign))
        size = int(cells.sum())
        for row, outlet in enumerate(outlets, start=size):  # what is beyond an outlet takes in a flow, as a cell does
            for place, face, outwards in zip(places, faces, outlet.signs, strict=True):
                through = face & (outwards != 0)
                rows.append(np.full(through.sum(), row))
                columns.append(place[through])
                signs.append(-1.0 * outwards[through])
        entries = (np.concatenate(signs), (np.concatenate(rows), np.concatenate(columns)))
        self._outlets = len(outlets)
        self._out = sparse.csr_matrix(entries, (size + len(outlets), count))  # flow out of each cell
        self._variance = np.concatenate([v[f] for v, f in zip(variance, faces, strict=True)])
        self._matrix = (self._out @ sparse.diags(self._variance) @ self._out.T).tocsr()
        coarser = pyamg.smoothed_aggregation_solver(self._matrix, max_coarse=_DIRECT)
        self._preconditioner = coarser.aspreconditioner()

    def of(self, flow: Faces, whole: float, leaving: Sequence[float] = ()) -> Faces:
        """The flows nearest to these [m³/s].

        Parameters
        ----------
        whole : the flow through the vessel [m³/s]
        leaving : what leaves through each of the outlets [m³/s]

        Raises
        ------
        SolveError : a cell does not balance to `BALANCE` of the whole
        """
        kept = np.concatenate([one[f] for one, f in zip(flow, self._faces, strict=True)])
        given = np.zeros(self._out.shape[0])
        given[len(given) - self._outlets :] = -np.asarray(leaving)
        left = self._out @ kept - given
        for _ in range(_MOST_SOLVES):
            if np.abs(left).max(initial=0.0) <= BALANCE * abs(whole):
                break
            shift, _ = cg(self._matrix, left, rtol=_ROUGH, maxiter=_MOST_STEPS, M=self._preconditioner)
            kept = kept - self._variance * (self._out.T @ shift)
            left = self._out @ kept - given
        else:
            worst = np.abs(left).max() / abs(whole)
            raise SolveError(
                f"a cell keeps {worst:.1e} of the flow, {BALANCE:.0e} is allowed: no conserving field found"
            )
        found, at = [], 0
        for face in self._faces:
            values = np.zeros(face.shape)
            values[face] = kept[at : at + face.sum()]
            at += int(face.sum())
            found.append(values)
        return found[0], found[1], found[2]


def _change(
    final: Faces,
    sums: Sums,
    independent: Sequence[Sums],
    bulk: Mask,
    diameter: float,
    outlets: Sequence[OutletFaces],
) -> float:
    """Relative difference of a field from its raw average, beyond noise, in what is larger than a particle.

    √(max(0, E² − Σ SE² / Σ F²)), as `granpipe.pipeline.averages.smoothing_change`: each level of the raw average is
    scaled to the field's own flow, with what has left above it, and both are seen through a Gaussian of half a particle
    diameter.
    """
    grid, reach = sums.grid, 0.5 * diameter / sums.grid.cell
    assert isinstance(grid, Box)
    area = face_areas(grid)

    def through(flux: Faces) -> Array:
        flow = flux[0] * area[0], flux[1] * area[1], flux[2] * area[2]
        return level_flow(flux[2], grid) + left_above(outlets, flow)

    carried, own = through(final), through(fluxes(sums))
    scale = np.divide(carried, own, out=np.ones_like(own), where=own > 0)[:, None, None]
    middle = 0.5 * (scale[1:] + scale[:-1])

    def seen(flux: Faces) -> Array:
        x, y, z = (ndimage.gaussian_filter(one, reach, mode="constant") for one in flux)
        parts = x[..., 1:] + x[..., :-1], y[:, 1:] + y[:, :-1], z[1:] + z[:-1]
        return 0.5 * np.array([part[bulk] for part in parts])

    def scaled(flux: Faces) -> Faces:
        return flux[0] * middle, flux[1] * middle, flux[2] * scale

    fitted = seen(final)
    change = float(((fitted - seen(scaled(fluxes(sums)))) ** 2).sum())
    noise = float((standard_error(np.array([seen(fluxes(one)) for one in independent])) ** 2).sum())
    return float(np.sqrt(max(0.0, change - noise) / max(1e-300, float((fitted**2).sum()))))


def _flowing(bulk: Mask, outlets: Sequence[OutletFaces]) -> list[Mask]:
    """Faces between two cells of solids, at the upper end of the grid, and of outlets or at its lower end."""
    found = []
    for axis in (2, 1, 0):
        width = [(1, 1) if one == axis else (0, 0) for one in range(3)]
        padded = np.pad(bulk, width, mode="edge" if axis == 0 else "constant")
        found.append(np.delete(padded, -1, axis) & np.delete(padded, 0, axis))
    if outlets:
        found[2][0] = False
    for outlet in outlets:
        found = [face | mask for face, mask in zip(found, outlet.masks, strict=True)]
    return found


def _variances(variance: Sequence[Array], faces: Sequence[Mask], grid: Box, diameter: float) -> Faces:
    """Variances over the mean of all, through a Gaussian of one particle diameter: a few blocks give them only roughly.

    At least `_LEAST_VARIANCE`: where nothing varies, as across a rigid motion, the average is not known without error.
    """
    open_faces = sum(int(face.sum()) for face in faces)
    mean = sum(float(one[face].sum()) for one, face in zip(variance, faces, strict=True)) / max(1, open_faces)
    found = []
    for one, face in zip(variance, faces, strict=True):
        reach = diameter / grid.cell
        seen = ndimage.gaussian_filter(np.where(face, one, 0.0), reach, mode="constant")
        counted = ndimage.gaussian_filter(face.astype(float), reach, mode="constant")
        smooth = np.divide(seen, counted * mean, out=np.ones_like(one), where=counted * mean > 1e-6 * mean)
        found.append(np.maximum(smooth, _LEAST_VARIANCE))
    return found[0], found[1], found[2]
