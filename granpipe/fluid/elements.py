"""Finite-element spaces on an r–z mesh: nodes along the boundary, flows through edges, an order of elimination."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from granpipe.field import Array
from granpipe.rzmesh import Index, RZMesh

HIGHEST_ORDER = 4  # of scikit-fem's triangles


@dataclass(frozen=True)
class Space:
    """Continuous piecewise polynomials of one order on a mesh.

    Parameters
    ----------
    mesh : the mesh
    order : 1–4
    basis : scikit-fem's basis (its triangles and their vertices are sorted; point numbers stay)
    """

    mesh: RZMesh
    order: int
    basis: Any

    @classmethod
    def on(cls, mesh: RZMesh, order: int, quadrature: int) -> Space:
        """Space with integrals exact to polynomials of degree `quadrature`."""
        import skfem

        triangles = skfem.MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))
        return cls(mesh, order, skfem.Basis(triangles, _element(order), intorder=quadrature))

    def of_order(self, order: int) -> Space:
        """The space of another order, with the same quadrature."""
        return Space(self.mesh, order, self.basis.with_element(_element(order)))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(self.basis.N)

    @cached_property
    def points(self) -> Array:
        """(size, 2) r and z of every node [m]."""
        return np.asarray(self.basis.doflocs.T)

    @cached_property
    def edge_facets(self) -> Index:
        """(k,) scikit-fem's number of each boundary edge."""
        a, b = self.mesh.edges.T
        count, facets = len(self.mesh.points), self.basis.mesh.facets  # (2, nf), the lower number first
        known = facets[0].astype(np.int64) * count + facets[1]
        order = np.argsort(known)
        return np.asarray(order[np.searchsorted(known, np.minimum(a, b) * count + np.maximum(a, b), sorter=order)])

    @cached_property
    def edge_nodes(self) -> Index:
        """(k, order+1) nodes along each boundary edge, equally spaced, from its first end to its second (order ≥ 2)."""
        a, b = self.mesh.edges.T
        within = self.basis.facet_dofs[:, self.edge_facets].T
        within = np.where((a < b)[:, None], within, within[:, ::-1])
        return np.column_stack([self.basis.nodal_dofs[0, a], within, self.basis.nodal_dofs[0, b]])

    @cached_property
    def entity(self) -> Index:
        """(size,) the mesh entity that each node sits on: points first, then edges, then triangles."""
        basis, owner = self.basis, np.empty(self.size, dtype=np.int64)
        points, facets = basis.mesh.p.shape[1], basis.mesh.facets.shape[1]
        for start, dofs in ((0, basis.nodal_dofs), (points, basis.facet_dofs), (points + facets, basis.interior_dofs)):
            owner[dofs] = start + np.arange(dofs.shape[1])
        return owner


def _element(order: int) -> Any:
    import skfem

    return (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3, skfem.ElementTriP4)[order - 1]()


def edge_flow_weights(space: Space, upto: float = 1.0) -> Array:
    """(k, order+1) weights c with ∫ r f ds = Σ c f over the nodes of each boundary edge, from its first end on [m²].

    In a slab r is left out, as in all integrals of this room (`granpipe.field.Measure.weight`) [m].

    Exact for the space's polynomials. `upto` ends the integral at a part of the edge.
    """
    along = np.arange(space.order + 1) / space.order
    lagrange = [np.poly1d(np.delete(along, i), r=True) for i in range(space.order + 1)]
    lagrange = [p / p(t) for p, t in zip(lagrange, along, strict=True)]
    rising = np.poly1d([1.0, 0.0])
    plain = np.array([p.integ()(upto) for p in lagrange])
    slanted = np.array([(rising * p).integ()(upto) for p in lagrange])
    (r0, z0), (r1, z1) = space.mesh.ends().transpose(1, 2, 0)[..., None]
    length = np.hypot(r1 - r0, z1 - z0)
    return np.asarray(length * (r0 * plain + (r1 - r0) * slanted if space.mesh.measure.axial else plain))


def dissection(space: Space) -> Index:
    """Rank of every mesh entity (as `Space.entity`) in a nested dissection of the mesh by METIS.

    A sparse factorisation that eliminates in this order has little fill. Nodes inside a triangle come first.
    """
    import pymetis

    mesh = space.basis.mesh
    triangles, shared = mesh.t.shape[1], mesh.p.shape[1] + mesh.facets.shape[1]
    members = np.vstack([mesh.t, mesh.p.shape[1] + mesh.t2f])
    place = (np.tile(np.arange(triangles), len(members)), members.ravel())
    table = sparse.csr_array((np.ones(members.size), place), shape=(triangles, shared))
    graph = sparse.csr_array(table.T @ table)
    graph.setdiag(0)
    graph.eliminate_zeros()
    _, rank = pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))
    return np.concatenate([np.asarray(rank), np.arange(triangles) - triangles])
