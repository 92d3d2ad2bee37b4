"""Integrals of a frictional fluid on a mesh: everything that stays the same while the viscosity changes.

Integrals over the volume are over 2π, or over the depth of a slab: there the weight r is 1, and nothing is strained
along y.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from granpipe.field import Array, Mask
from granpipe.fluid.elements import Space
from granpipe.rzmesh import Index

_GAUSS, _WEIGHT = np.polynomial.legendre.leggauss(3)
EDGE_PLACES, EDGE_WEIGHTS = 0.5 * (_GAUSS + 1), 0.5 * _WEIGHT
_DOUBLE = np.array([2.0, 2.0, 2.0, 1.0])  # of rr, zz, θθ and twice rz in 2 D:D


class FrictionForms:
    """Strain, wall sliding, gravity and the equation of the spread rate, for velocity of order 2 and pressure of 1.

    Parameters
    ----------
    space, pressure : P2 and P1 on one mesh with one quadrature
    rubbing : (k,) boundary edges with wall friction
    """

    def __init__(self, space: Space, pressure: Space, rubbing: Mask) -> None:
        self.space, self.pressure = space, pressure
        basis = space.basis
        self.r, self.z = (np.asarray(x) for x in np.asarray(basis.global_coordinates()))  # (ne, nq)
        self._measure = space.mesh.measure
        self.weight = np.asarray(basis.dx) * self._measure.weight(self.r)  # (ne, nq) of an integral over the volume
        self.edges = np.flatnonzero(rubbing)
        self._strain = self._strain_operator()
        dofs = basis.element_dofs.T  # (ne, 6)
        self.dofs: Index = np.concatenate([dofs, space.size + dofs], axis=1)
        self.corners: Index = pressure.basis.element_dofs.T  # (ne, 3)
        self._corner_shape = np.stack([np.broadcast_to(np.asarray(b[0]), self.r.shape) for b in pressure.basis.basis])

    def _strain_operator(self) -> Array:
        """(ne, nq, 4, 12): rr, zz, θθ (0 in a slab) and twice rz of D from the element's u and w."""
        shape = np.stack([np.broadcast_to(np.asarray(b[0]), self.r.shape) for b in self.space.basis.basis], -1)
        slope = np.stack([b[0].grad for b in self.space.basis.basis], -1)  # (2, ne, nq, 6)
        made = np.zeros((*self.r.shape, 4, 12))
        made[:, :, 0, :6], made[:, :, 1, 6:] = slope[0], slope[1]
        if self._measure.axial:
            made[:, :, 2, :6] = shape / self.r[..., None]
        made[:, :, 3, :6], made[:, :, 3, 6:] = slope[1], slope[0]
        return made

    def shear_rate(self, velocity: Array) -> Array:
        """(ne, nq) γ̇ = √(2 D:D) of a velocity (2N,)."""
        strain = np.einsum("eqsi,ei->eqs", self._strain, velocity[self.dofs], optimize=True)
        return np.asarray(np.sqrt(np.sum(_DOUBLE * strain**2, axis=2)))

    def stiffness(self, viscosity: Array) -> Any:
        """(2N, 2N) sparse ∫ r 2 η D(u):D(v)."""
        part = self._strain * np.sqrt(self.weight * viscosity)[..., None, None] * np.sqrt(_DOUBLE)[:, None]
        flat = part.reshape(len(part), -1, 12)
        return self._sparse(flat.transpose(0, 2, 1) @ flat, self.dofs)

    def _sparse(self, blocks: Array, dofs: Index) -> Any:
        rows = np.broadcast_to(dofs[:, :, None], blocks.shape)
        columns = np.broadcast_to(dofs[:, None, :], blocks.shape)
        size = 2 * self.space.size
        return sparse.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()

    def at_quadrature(self, nodal: Array) -> Array:
        """(ne, nq) a P1 function (M,) at the quadrature points."""
        return np.asarray(np.einsum("ieq,ei->eq", self._corner_shape, nodal[self.corners]))

    @cached_property
    def gravity(self) -> Array:
        """(2N,) ∫ r (−1) v_z: the weight, in units of ρ g."""
        shape = np.stack([np.broadcast_to(np.asarray(b[0]), self.r.shape) for b in self.space.basis.basis], -1)
        load = np.einsum("eq,eqi->ei", self.weight, shape)
        dofs = self.space.basis.element_dofs.T
        weight = np.bincount(dofs.ravel(), load.ravel(), minlength=self.space.size)
        return np.concatenate([np.zeros(self.space.size), -weight])

    @cached_property
    def volume(self) -> Array:
        """(N,) share of each node in the volume: a lumped mass of vertices and edges, all positive."""
        total = self.weight.sum(axis=1) / 6
        dofs = self.space.basis.element_dofs.ravel()
        return np.bincount(dofs, np.tile(total, 6), minlength=self.space.size).astype(float)

    # --- walls --------------------------------------------------------------------------------------------------------

    @cached_property
    def edge_points(self) -> tuple[Array, Array, Array]:
        """r, z and the weight of an integral over the surface, (e, 3) each."""
        ends = self.space.mesh.ends()[self.edges]
        place = ends[:, None, 0] + EDGE_PLACES[:, None] * (ends[:, 1] - ends[:, 0])[:, None]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        r, z = place.transpose(2, 0, 1)
        return r, z, self._measure.weight(r) * length[:, None] * EDGE_WEIGHTS

    @cached_property
    def _tangent(self) -> Array:
        normal = self.space.mesh.normals()[self.edges]
        return np.stack([-normal[:, 1], normal[:, 0]], axis=1)

    @cached_property
    def _edge_shape(self) -> Array:
        """(3 points, 3 nodes) of order 2, from the first end of an edge to the second."""
        s = EDGE_PLACES
        return np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)], axis=1)

    @property
    def _edge_nodes(self) -> Index:
        return self.space.edge_nodes[self.edges]

    def slip(self, velocity: Array) -> Array:
        """(e, 3) speed along the rubbing edges, signed."""
        u, w = np.split(velocity, 2)
        along = u[self._edge_nodes] * self._tangent[:, :1] + w[self._edge_nodes] * self._tangent[:, 1:]
        return np.asarray(along @ self._edge_shape.T)

    def at_edges(self, nodal: Array) -> Array:
        """(e, 3) a P1 function (M,) on the rubbing edges."""
        ends = nodal[self._edge_corners]
        return np.asarray(ends[:, :1] * (1 - EDGE_PLACES) + ends[:, 1:] * EDGE_PLACES)

    @cached_property
    def _edge_corners(self) -> Index:
        return np.asarray(self.pressure.basis.nodal_dofs[0, self.space.mesh.edges[self.edges]])

    def rubbing(self, drag: Array) -> Any:
        """(2N, 2N) sparse ∫ r β u_t v_t ds on the walls, β (e, 3)."""
        along = np.einsum("qn,ed->qedn", self._edge_shape, self._tangent).reshape(3, len(self.edges), 6)
        blocks = np.einsum("eq,qei,qej->eij", self.edge_points[2] * drag, along, along, optimize=True)
        nodes = self._edge_nodes
        return self._sparse(blocks, np.concatenate([nodes, self.space.size + nodes], axis=1))

    # --- the rate of shear, spread ------------------------------------------------------------------------------------

    def spreading(self, length: float) -> Any:
        """Factors of γ̃ − ℓ² ∇²γ̃ in P1, with a lumped mass: no rate becomes negative for small ℓ."""
        grad = np.stack([np.broadcast_to(b[0].grad, (2, *self.r.shape)) for b in self.pressure.basis.basis])
        blocks = length**2 * np.einsum("idej,kdej,ej->eik", grad, grad, self.weight, optimize=True)
        rows = np.broadcast_to(self.corners[:, :, None], blocks.shape)
        columns = np.broadcast_to(self.corners[:, None, :], blocks.shape)
        size = self.pressure.size
        matrix = sparse.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
        return linalg.splu(sparse.csc_array(matrix + sparse.diags_array(self._loads(np.ones_like(self.r)))))

    def _loads(self, values: Array) -> Array:
        load = np.einsum("eq,ieq->ei", self.weight * values, self._corner_shape)
        return np.bincount(self.corners.ravel(), load.ravel(), minlength=self.pressure.size).astype(float)

    def spread_rate(self, factors: Any, velocity: Array) -> Array:
        """(M,) γ̃ of a velocity, its sliding along the walls included."""
        source = self._loads(self.shear_rate(velocity))
        load = self.edge_points[2] * np.abs(self.slip(velocity))
        shares = np.stack([load @ (1 - EDGE_PLACES), load @ EDGE_PLACES], axis=1)
        source += np.bincount(self._edge_corners.ravel(), shares.ravel(), minlength=self.pressure.size)
        return np.asarray(np.maximum(factors.solve(source), 0.0))
