"""The stream function that fits the averaged flux best: conserving at every point, smooth where it may be.

Minimised over the nodes' ψ, with F(ψ) the flux that ψ makes through each face:

    Σ_faces (F(ψ) − F_data)² / s²  +  (ℓ/h)⁴ Σ_faces |δ²F(ψ)|² / s²,      |δ²F|² = F_rr² + 2 F_rz² + F_zz²

with s the statistical error of the data (a smooth model of it), δ² second differences between neighbouring faces, and
ℓ the smoothing length: waves longer than 2πℓ pass. The second sum leaves out what lies within a given distance of walls
and voids, where the flux changes over a fraction of a particle. ψ is 0 on the axis and on what touches it, the wall's
value on the outer wall and on all that is connected to it (obstacles, cavities, the void over a free surface), and an
unknown constant on each body that touches neither.

In the plane x–z the left wall takes the part of the axis, but nothing goes on beyond it as a mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from granpipe.errors import DataError
from granpipe.field import Array, Grid, Mask

Roles = NDArray[np.int64]

FREE, AXIS, WALL = 0, 1, 2
"""Roles of nodes; 3 and on: bodies in the stream, each of a constant ψ of its own."""

_EVERY_NEIGHBOUR = np.ones((3, 3))


def node_roles(inside_fraction: Array, bulk: Mask) -> Roles:
    """(nz+1, nr+1) what is known of ψ at each node, from the cells that let nothing pass: outside, or void.

    A node that touches such a cell lies on the boundary of the stream (of the four cells round a node outside a
    straight wall at least one is wholly outside). Cells that touch each other, if only at a corner, are one body.

    Raises
    ------
    DataError : a row of the grid lets nothing pass
    """
    blocked = np.pad(~bulk | (inside_fraction <= 0), ((0, 0), (0, 1)), constant_values=True)  # the wall, and beyond
    label, count = ndimage.label(blocked, structure=_EVERY_NEIGHBOUR)
    at_wall, at_axis = set(label[:, -1].tolist()), set(label[:, 0].tolist()) - {0}
    if at_wall & at_axis:
        row = int(np.flatnonzero(np.isin(label[:, 0], list(at_wall)))[0])
        raise DataError(
            f"no passage for the flow at row {row} of the grid: blocked all across, or cells too large for it"
        )
    bodies = [body for body in range(1, count + 1) if body not in at_wall | at_axis]
    roles = np.zeros(count + 1, dtype=np.int64)
    roles[list(at_axis)] = AXIS
    roles[list(at_wall)] = WALL
    roles[bodies] = WALL + 1 + np.arange(len(bodies))
    # a node takes the role of any body it touches; it cannot touch two, or they would be one
    cells = np.pad(roles[label], ((1, 1), (1, 0)), mode="edge")
    nodes = np.maximum.reduce([cells[1:, 1:], cells[1:, :-1], cells[:-1, 1:], cells[:-1, :-1]])
    nodes[:, 0] = AXIS
    return np.asarray(nodes)


class Unknowns(NamedTuple):
    """ψ = expand · x + wall_part · ψ_wall, over all nodes in one row.

    expand : (nodes, unknowns) sparse; a body's nodes share an unknown
    wall_part : (nodes,) 1 on the wall, otherwise 0
    """

    expand: sparse.csr_matrix
    wall_part: Array


def _unknowns(roles: Roles) -> Unknowns:
    flat = roles.ravel()
    body = np.flatnonzero(flat > WALL)
    free = np.flatnonzero(flat == FREE)
    bodies = int(flat.max(initial=WALL)) - WALL
    row = np.concatenate([free, body])
    column = np.concatenate([np.arange(len(free)), len(free) + flat[body] - WALL - 1])
    shape = (len(flat), len(free) + bodies)
    return Unknowns(sparse.csr_matrix((np.ones(len(row)), (row, column)), shape), (flat == WALL).astype(float))


@dataclass(frozen=True)
class Weights:
    """1/s² of every face: (nz, nr+1) and (nz+1, nr) [s²/m²]."""

    r: Array
    z: Array


class NormalEquations:
    """The normal equations of the fit but for its smoothing length: assembled once, for fits of several lengths.

    Parameters
    ----------
    grid : the cells
    roles : (nz+1, nr+1) from `node_roles`
    weights : of the faces; only their ratios matter
    clearance : distance to walls and voids within which nothing is smoothed [m]
    """

    def __init__(self, grid: Grid, roles: Roles, weights: Weights, clearance: float) -> None:
        self.grid, self.shape, self.unknowns = grid, roles.shape, _unknowns(roles)
        flux = _flux_operators(grid)
        far = _far_faces(roles, grid, clearance)
        mirrors = (-1, 1) if grid.measure.axial else (0, 0)
        self.data, data_part, smooth_part = [], [], []
        for operator, weight, smooth_faces, mirror in zip(flux, (weights.r, weights.z), far, mirrors, strict=True):
            diagonal = sparse.diags_array(weight.ravel())
            self.data.append(operator.T @ diagonal)
            data_part.append(operator.T @ diagonal @ operator)
            for bend, count in _second_differences(smooth_faces, mirror):
                rows = bend @ operator
                smooth_part.append(count * (rows.T @ diagonal @ rows))
        self._data_part, self._smooth_part = sum(data_part[1:], data_part[0]), sum(smooth_part[1:], smooth_part[0])

    def fit(self, smoothing_length: float) -> PsiFit:
        """The fit with ℓ [m].

        Raises
        ------
        DataError : the segments do not determine ψ
        """
        return PsiFit(self, smoothing_length)

    def matrix(self, smoothing_length: float) -> sparse.csr_matrix:
        """(nodes, nodes) over all nodes, known ones included."""
        return sparse.csr_matrix(self._data_part + (smoothing_length / self.grid.cell) ** 4 * self._smooth_part)


class PsiFit:
    """A least-squares fit whose matrix is factored once, for many data; made by `NormalEquations.fit`."""

    def __init__(self, equations: NormalEquations, smoothing_length: float) -> None:
        self.grid, self.smoothing_length = equations.grid, smoothing_length
        self._equations = equations
        matrix = equations.matrix(smoothing_length)
        expand, wall_part = equations.unknowns
        self._wall_load = expand.T @ (matrix @ wall_part)
        try:
            self._factor = splu(
                sparse.csc_matrix(expand.T @ matrix @ expand),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise DataError(f"the segments do not determine a stream function ({error}); average longer") from error

    def solve(self, flux_r: Array, flux_z: Array, solids_flow: float) -> Array:
        """(nz+1, nr+1) ψ of the solids flux [m³/s per radian] for data (nz, nr+1), (nz+1, nr) [m/s].

        `solids_flow` [m³/s, positive downwards] passes every level: ψ = −solids_flow/2π on the wall (over the depth in
        the plane x–z).
        """
        expand, wall_part = self._equations.unknowns
        by_r, by_z = self._equations.data
        wall = -solids_flow / self.grid.measure.turn
        load = expand.T @ (by_r @ flux_r.ravel() + by_z @ flux_z.ravel()) - wall * self._wall_load
        return np.asarray(expand @ self._factor.solve(load) + wall * wall_part).reshape(self._equations.shape)


def _flux_operators(grid: Grid) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Nodes → faces, as `granpipe.field.flux_from_psi`: F_r = −2π Δ_z ψ / side area, F_z = 2π Δ_r ψ / ring area."""
    turn = grid.measure.turn
    rows, columns = grid.shape
    inverse_side = np.divide(1, grid.side_area, out=np.zeros(columns + 1), where=grid.side_area > 0)
    along_z = sparse.kron(_difference(rows + 1), sparse.diags_array(-turn * inverse_side))
    along_r = sparse.kron(
        sparse.eye_array(rows + 1), sparse.diags_array(turn / grid.ring_area) @ _difference(columns + 1)
    )
    return sparse.csr_matrix(along_z), sparse.csr_matrix(along_r)


def _difference(count: int) -> sparse.dia_array:
    """(count − 1, count) first differences."""
    return sparse.diags_array([-np.ones(count - 1), np.ones(count - 1)], offsets=[0, 1], shape=(count - 1, count))


def _far_faces(roles: Roles, grid: Grid, clearance: float) -> tuple[Mask, Mask]:
    """Faces (nz, nr+1), (nz+1, nr) farther than `clearance` [m] from every node of wall, void and body."""
    known = roles != FREE
    if grid.measure.axial:  # the axis itself is no wall, but what stands on it is
        known[:, 0] = (roles[:, 0] > AXIS) | (roles[:, 1] == AXIS)
    distance = ndimage.distance_transform_edt(~known) * grid.cell
    return (
        0.5 * (distance[1:] + distance[:-1]) > clearance,
        0.5 * (distance[:, 1:] + distance[:, :-1]) > clearance,
    )


def _second_differences(smooth: Mask, mirror: int) -> list[tuple[sparse.csr_matrix, int]]:
    """Operators faces → F_rr, F_zz (counted once) and F_rz (twice); only those all of whose faces are in `smooth`.

    Across the axis the field goes on as its mirror image: F_z stands half a cell off it and is even (`mirror` = 1),
    F_r stands on it, is odd, and its F_rr vanishes there. Without an axis `mirror` is 0.
    """
    rows, columns = smooth.shape
    bend_r = _bend(columns).tolil()
    if mirror == 1 and columns > 1:
        bend_r[0, :2] = [-1, 1]
    slope_r, slope_z = _slope(columns), _slope(rows)
    eye_r, eye_z = sparse.eye_array(columns), sparse.eye_array(rows)
    outside = (~smooth).ravel().astype(float)
    chosen = []
    for product, count in (
        (sparse.kron(eye_z, bend_r), 1),
        (sparse.kron(_bend(rows), eye_r), 1),
        (sparse.kron(slope_z, slope_r), 2),
    ):
        whole = sparse.csr_matrix(product)
        chosen.append((sparse.csr_matrix(sparse.diags_array((abs(whole) @ outside == 0).astype(float)) @ whole), count))
    return chosen


def _bend(count: int) -> sparse.dia_array:
    """(count, count) second differences; none at the ends."""
    inner = np.r_[0.0, np.ones(max(count - 2, 0)), 0.0][:count]
    return sparse.diags_array([inner[1:], -2 * inner, inner[:-1]], offsets=[-1, 0, 1], shape=(count, count))


def _slope(count: int) -> sparse.dia_array:
    """(count, count) forward differences; none at the end."""
    inner = np.r_[np.ones(count - 1), 0.0]
    return sparse.diags_array([-inner, inner[:-1]], offsets=[0, 1], shape=(count, count))
