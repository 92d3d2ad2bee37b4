"""Boundary data as a linear map: every velocity that keeps it is x = P y + g, with y free.

At a corner two edges ask for different velocities. Whatever the corner gets, the nodes inside each edge then make up
for it along the edge's normal, so that the flow through every edge is the prescribed one to rounding (for second order
and a wall: the mid-edge normal velocity −(r₀ u_n0 + r₁ u_n1)/(4 r_m)). This holds for the free part of the velocity,
too, so walls with slip do not leak at their bends either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from granpipe.field import Array, Mask
from granpipe.fluid.elements import Space, edge_flow_weights
from granpipe.fluid.wall_speed import BoundaryData
from granpipe.rzmesh import Index

SMOOTH = np.deg2rad(45)  # slip walls that turn by less have a common tangent at the bend; sharper corners are at rest


@dataclass(frozen=True)
class Constraints:
    """x = P y + g, where x holds u at the N nodes of a space, then w.

    Parameters
    ----------
    prolongation : (2N, n) sparse P
    given : (2N,) g [m/s]
    node : (n,) the node that each free unknown moves
    edge_flow : (k, 2N) sparse; times x it is the outward flow through each boundary edge over 2π or the depth
    """

    prolongation: Any
    given: Array
    node: Index
    edge_flow: Any


def constrain(space: Space, data: BoundaryData) -> Constraints:
    """The map for boundary data on a space of order len(data.along) − 1."""
    held, normal = _held_normals(space, data)
    prolongation, node = _free_directions(space.size, held, normal)
    edge_flow = _edge_flow(space)
    correction = _correction(space, data, edge_flow)
    given = _given(space, data)
    return Constraints(
        sparse.csr_array(prolongation - correction @ (edge_flow @ prolongation)),
        given + correction @ (data.flow / space.mesh.measure.turn - edge_flow @ given),
        node,
        edge_flow,
    )


def _held_normals(space: Space, data: BoundaryData) -> tuple[Index, Array]:
    """How many velocity components each node has prescribed (N,), and the direction (N, 2) where it is one."""
    nodes, normals = space.edge_nodes, space.mesh.normals()
    only_normal = data.normal_held & ~data.tangent_held
    tensor = np.zeros((space.size, 2, 2))
    touched = nodes[only_normal]
    outer = np.einsum("ki,kj->kij", normals[only_normal], normals[only_normal])
    np.add.at(tensor, touched, outer[:, None])
    shares, directions = np.linalg.eigh(tensor)  # normals at an angle θ: shares 1 ∓ cos θ of two
    held = (shares[:, 1] > 0).astype(np.int64)
    held[shares[:, 0] > 1 - np.cos(SMOOTH)] = 2
    held[_corner_on_axis(space, only_normal)] = 2
    held[nodes[data.normal_held & data.tangent_held]] = 2
    return held, directions[:, :, 1]


def _corner_on_axis(space: Space, only_normal: Mask) -> Index:
    """Nodes on the axis where an obstacle with slip begins: at rest, whatever its slope."""
    axis = space.mesh.named("axis")
    return np.intersect1d(space.edge_nodes[axis], space.edge_nodes[only_normal & ~axis])


def _free_directions(count: int, held: Index, normal: Array) -> tuple[Any, Index]:
    """P before the correction of flows, and the node of each free unknown."""
    free, sliding = np.flatnonzero(held == 0), np.flatnonzero(held == 1)
    node = np.concatenate([free, free, sliding])
    column = np.arange(len(node))
    along_u = np.concatenate([np.ones(len(free)), np.zeros(len(free)), normal[sliding, 1]])
    along_w = np.concatenate([np.zeros(len(free)), np.ones(len(free)), -normal[sliding, 0]])
    rows, columns = np.concatenate([node, count + node]), np.tile(column, 2)
    values = np.concatenate([along_u, along_w])
    matrix = sparse.csr_array((values, (rows, columns)), shape=(2 * count, len(node)))
    matrix.eliminate_zeros()
    return matrix, node


def _given(space: Space, data: BoundaryData) -> Array:
    """(2N,) the prescribed velocities; a node that several edges prescribe gets their mean."""
    fixed = data.normal_held & data.tangent_held
    total, count = np.zeros((space.size, 2)), np.zeros(space.size)
    np.add.at(total, space.edge_nodes[fixed], data.velocity[fixed])
    np.add.at(count, space.edge_nodes[fixed], 1)
    mean = total / np.maximum(count, 1)[:, None]
    mean[space.edge_nodes[space.mesh.named("axis")], 0] = 0.0
    return np.concatenate([mean[:, 0], mean[:, 1]])


def _edge_flow(space: Space) -> Any:
    """(k, 2N) sparse: ∫ r u·n ds over each boundary edge."""
    nodes, weights, normals = space.edge_nodes, edge_flow_weights(space), space.mesh.normals()
    rows = np.broadcast_to(np.arange(len(nodes))[:, None], nodes.shape)
    columns = np.stack([nodes, space.size + nodes])
    values = np.stack([weights * normals[:, :1], weights * normals[:, 1:]])
    return sparse.csr_array(
        (values.ravel(), (np.stack([rows, rows]).ravel(), columns.ravel())), shape=(len(nodes), 2 * space.size)
    )


def _correction(space: Space, data: BoundaryData, edge_flow: Any) -> Any:
    """(2N, k) sparse: the least normal velocity inside each held edge that lets one unit of flow out."""
    edges = np.flatnonzero(data.normal_held & ~space.mesh.named("axis"))
    inside = space.edge_nodes[edges, 1:-1]
    weights = edge_flow_weights(space)[edges, 1:-1]
    amount = weights / np.sum(weights**2, axis=1, keepdims=True)
    normals = space.mesh.normals()[edges]
    rows = np.stack([inside, space.size + inside])
    values = np.stack([amount * normals[:, :1], amount * normals[:, 1:]])
    columns = np.broadcast_to(edges[:, None], rows.shape)
    return sparse.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=edge_flow.shape[::-1])
