"""The stream function nearest to a computed velocity: exactly conserving where Taylor–Hood elements are not.

With ψ = r² χ the velocity is u = −r ∂χ/∂z, w = 2χ + r ∂χ/∂r: nothing is singular on the axis, and plug and Poiseuille
flow have a polynomial χ. In a slab χ is ψ itself, u = −∂χ/∂z, w = ∂χ/∂x. χ minimises ∫ r |u(χ) − u_h|² (in a slab
without r) among all that have the prescribed flow through inlet, walls and obstacles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from granpipe.field import Array, Mask, Measure
from granpipe.fluid.direct import solve_ordered
from granpipe.fluid.elements import HIGHEST_ORDER, Space, dissection, edge_flow_weights
from granpipe.fluid.locate import locate
from granpipe.fluid.stokes import StokesSolution
from granpipe.fluid.wall_speed import BoundaryData
from granpipe.rzmesh import Index

ON_WALL = 1e-9  # of a triangle's height: nearer points lie on its side
LAST = np.iinfo(np.int64).max  # rank of the constants of free rings: they meet a whole obstacle


@dataclass(frozen=True)
class StreamFunction:
    """ψ in the mesh and, constant across the walls, beyond it.

    Parameters
    ----------
    space : of χ
    chi : (N,) χ = ψ/r² at its nodes [m/s]; in a slab ψ [m²/s]
    edge_psi : (k,) ψ in the middle of each boundary edge [m³/s per radian or metre of depth]; NaN: not prescribed
    correction : ‖u(χ) − u_h‖ / ‖u(χ)‖ over the volume: how much Taylor–Hood elements missed
    """

    space: Space
    chi: Array
    edge_psi: Array
    correction: float

    def psi_at(self, r: Array, z: Array) -> Array:
        """(nz, nr) ψ on the nodes of a grid [m³/s per radian or metre of depth]; outside, that of the nearest solid."""
        basis = self.space.basis
        triangle, place = locate(basis.mesh.p.T, basis.mesh.t.T, r, z)
        inside = triangle >= 0
        psi = np.empty(triangle.shape)
        radius, height = np.meshgrid(r, z)
        nodes, local = basis.element_dofs[:, triangle[inside]], place[inside].T
        shape = np.stack([basis.elem.lbasis(local, i)[0] for i in range(len(nodes))])
        psi[inside] = _psi_per_chi(self.space.mesh.measure, radius[inside]) * np.sum(shape * self.chi[nodes], axis=0)
        on_wall = self._psi_on_walls(triangle[inside], local)
        psi[inside] = np.where(np.isnan(on_wall), psi[inside], on_wall)
        psi[~inside] = self._psi_beyond_walls(np.stack([radius[~inside], height[~inside]], axis=1))
        return psi

    @property
    def _solid(self) -> Mask:
        return self.space.mesh.named("wall") | self.space.mesh.named("obstacle")

    def _psi_on_walls(self, triangle: Index, local: Array) -> Array:
        """(n,) ψ of the wall for points in triangles, given in local coordinates (2, n), that lie on one; else NaN."""
        mesh = self.space.basis.mesh
        facet_psi = np.full(mesh.facets.shape[1], np.nan)
        facet_psi[self.space.edge_facets[self._solid]] = self.edge_psi[self._solid]
        away = np.stack([local[1], 1 - local.sum(axis=0), local[0]])  # from the sides ab, bc and ac
        met = np.where(np.abs(away) < ON_WALL, facet_psi[mesh.t2f[:, triangle]], np.nan)
        return np.asarray(np.fmax(np.fmax(met[0], met[1]), met[2]))

    def _psi_beyond_walls(self, points: Array) -> Array:
        """(n,) ψ of the wall or obstacle that is nearest to each point (n, 2)."""
        from scipy.spatial import KDTree

        ends = self.space.mesh.ends()[self._solid]
        samples = np.concatenate([ends[:, 0], ends.mean(axis=1)])
        return np.asarray(np.tile(self.edge_psi[self._solid], 2)[KDTree(samples).query(points)[1]])

    def at_points(self) -> tuple[Array, Array, Array]:
        """u, w and ψ at the points of the mesh, (n,) each; velocities as the mean of the triangles that meet."""
        basis, mesh = self.space.basis, self.space.basis.mesh
        corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        from skfem import Basis

        at_corners = Basis(mesh, basis.elem, quadrature=(corners, np.ones(3)))
        chi = at_corners.interpolate(self.chi)
        measure = self.space.mesh.measure
        parts = _velocity(measure, chi, mesh.p[0, mesh.t.T])
        count = np.bincount(mesh.t.ravel())
        mean = [np.bincount(mesh.t.T.ravel(), weights=part.ravel()) / count for part in parts]
        return mean[0], mean[1], _psi_per_chi(measure, mesh.p[0]) * self.chi[basis.nodal_dofs[0]]


def _psi_per_chi(measure: Measure, r: Array) -> Array:
    """ψ/χ: r², or 1 in a slab."""
    return measure.weight(r) ** 2


def _velocity(measure: Measure, chi: Any, r: Array) -> tuple[Array, Array]:
    """u and w of χ, given with its gradient."""
    if not measure.axial:
        return -chi.grad[1], chi.grad[0]
    return -r * chi.grad[1], 2 * np.asarray(chi) + r * chi.grad[0]


def nearest_stream_function(flow: StokesSolution, data: BoundaryData) -> StreamFunction:
    """Fit ψ to a velocity, with the flows of the boundary data kept exactly; of one order more, where there is one.

    Raises
    ------
    SolveError : the equations have no accurate solution
    """
    from skfem import BilinearForm, LinearForm

    measure = flow.space.mesh.measure

    @BilinearForm
    def agreement(f, g, at):  # type: ignore[no-untyped-def]
        (u, w), (other_u, other_w) = (_velocity(measure, one, at.x[0]) for one in (f, g))
        return measure.weight(at.x[0]) * (u * other_u + w * other_w)

    @LinearForm
    def towards(g, at):  # type: ignore[no-untyped-def]
        u, w = _velocity(measure, g, at.x[0])
        return measure.weight(at.x[0]) * (at.u * u + at.w * w)

    order = min(flow.space.order + 1, HIGHEST_ORDER)
    space = Space.on(flow.space.mesh, order, 2 * order + 1)
    velocity = space.of_order(flow.space.order).basis
    u, w = velocity.interpolate(flow.u), velocity.interpolate(flow.w)
    matrix, right = agreement.assemble(space.basis), towards.assemble(space.basis, u=u, w=w)
    boundary = _boundary_psi(flow, data, order)
    P, given, entity = _free_chi(space, boundary)
    unknowns = np.argsort(np.append(dissection(space), LAST)[entity], kind="stable")
    y, _ = solve_ordered(P.T @ matrix @ P, P.T @ (right - matrix @ given), unknowns, np.zeros(P.shape[1]))
    chi = P @ y + given
    middle = boundary.psi[:, order // 2] + np.append(y, 0.0)[boundary.unknown(len(y))]
    return StreamFunction(space, chi, middle, _distance(space, chi, u, w))


def _distance(space: Space, chi: Array, u: Any, w: Any) -> float:
    """‖u(χ) − u‖ / ‖u(χ)‖ over the volume."""
    field, r = space.basis.interpolate(chi), np.asarray(space.basis.global_coordinates())[0]
    own = np.stack(_velocity(space.mesh.measure, field, r))
    weight = space.mesh.measure.weight(r) * space.basis.dx
    difference = np.sum(weight * np.sum((own - np.stack([np.asarray(u), np.asarray(w)])) ** 2, axis=0))
    return float(np.sqrt(difference / np.sum(weight * np.sum(own**2, axis=0))))


@dataclass(frozen=True)
class _BoundaryPsi:
    """ψ along the boundary edges, up to a constant for every free ring.

    Parameters
    ----------
    psi : (k, order+1) ψ at the nodes along each edge [m³/s per radian or metre of depth]; NaN: not prescribed
    ring : (k,) number of the free ring that the edge belongs to, 0 for what hangs together with the inlet
    """

    psi: Array
    ring: Index

    def unknown(self, count: int) -> Index:
        """(k,) place of each edge's constant among `count` unknowns that end with those of the rings; −1: none."""
        return np.where(self.ring > 0, count - self.ring.max(initial=0) + self.ring - 1, count)


def _boundary_psi(flow: StokesSolution, data: BoundaryData, order: int) -> _BoundaryPsi:
    """Integrate the flow along the boundary, dψ = −r u·n ds (slab: −u·n ds), from 0 at the inlet's least r."""
    mesh, space = flow.space.mesh, flow.space
    out, held = data.flow / mesh.measure.turn, np.flatnonzero(data.normal_held)
    (a, b), count = mesh.edges[held].T, len(mesh.points)
    graph = sparse.csr_array((np.ones(len(a)), (a, b)), shape=(count, count))
    step = dict(zip(zip(a, b, strict=True), -out[held], strict=True))
    inlet = mesh.edges[mesh.named("inlet")].ravel()
    psi, ring, rings = np.full(count, np.nan), np.zeros(count, dtype=np.int64), -1
    for start in (inlet[mesh.points[inlet, 0].argmin()], *a):
        if not np.isnan(psi[start]):
            continue
        rings, psi[start] = rings + 1, 0.0
        reached, before = csgraph.breadth_first_order(graph, start, directed=False)
        ring[reached] = rings
        for point, previous in zip(reached[1:], before[reached[1:]], strict=True):
            forward = step.get((previous, point))
            psi[point] = psi[previous] + (-step[point, previous] if forward is None else forward)
    along = np.full((len(out), order + 1), np.nan)
    along[held] = psi[a, None]
    through = np.flatnonzero(data.normal_held & (out != 0))
    nodes, normals = space.edge_nodes[through], mesh.normals()[through]
    normal_speed = flow.u[nodes] * normals[:, :1] + flow.w[nodes] * normals[:, 1:]
    for i in range(1, order + 1):
        along[through, i] -= np.sum(edge_flow_weights(space, i / order)[through] * normal_speed, axis=1)
    return _BoundaryPsi(along, ring[mesh.edges[:, 0]])


def _free_chi(space: Space, boundary: _BoundaryPsi) -> tuple[Any, Array, Index]:
    """χ = P y + g with free y: nodes off the boundary and on the axis, then one constant per free ring.

    Returns P (N, n), g (N,) and the mesh entity of each unknown (−1 for a ring's constant).
    """
    known = ~np.isnan(boundary.psi[:, 0])
    nodes = space.edge_nodes[known]
    psi, ring = boundary.psi[known], np.broadcast_to(boundary.ring[known, None], nodes.shape)
    square = _psi_per_chi(space.mesh.measure, space.points[:, 0])
    off_axis = square[nodes] > 0
    nodes, psi, ring = nodes[off_axis], psi[off_axis], ring[off_axis]
    given = np.zeros(space.size)
    given[nodes] = psi / square[nodes]
    node_ring = np.full(space.size, -1)
    node_ring[nodes] = ring
    free, on_ring = np.flatnonzero(node_ring < 0), np.flatnonzero(node_ring > 0)
    rows = np.concatenate([free, on_ring])
    columns = np.concatenate([np.arange(len(free)), len(free) + node_ring[on_ring] - 1])
    values = np.concatenate([np.ones(len(free)), 1 / square[on_ring]])
    rings = int(boundary.ring.max(initial=0))
    P = sparse.csr_array((values, (rows, columns)), shape=(space.size, len(free) + rings))
    return P, given, np.concatenate([space.entity[free], np.full(rings, -1)])
