"""Heat carried by a flow through the r–z section, a test of what a velocity field does in the program that imports it.

Steady, axisymmetric, in conservative form:

    ∇·(ρc U T − k ∇T) = 0,     no heat through axis and walls but where their temperature is held,

by linear finite elements, upwinded along the streamlines in a way that keeps whatever the equation keeps (SUPG: Brooks
& Hughes, Comput. Methods Appl. Mech. Eng. 32, 1982; time scale after Shakib, Hughes & Johan, ibid. 89, 1991). What
enters leaves, to rounding, whatever the flow; and where the flow has no divergence, a constant temperature stays one
and the error is of second order.

Nothing here knows how a field was made: a flow is a function of r and z.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from granpipe.errors import DataError
from granpipe.field import Array
from granpipe.rzmesh import Index, RZMesh

_QUADRATURE = 4  # exact to this degree

RadialFlow = tuple[Array, Array]
"""(r u, r w) at points [m²/s]."""


class Flow(Protocol):
    """What carries the heat."""

    def at(self, basis: Any, mesh: RZMesh) -> RadialFlow:
        """(r u, r w) at the quadrature points of a scikit-fem basis on the mesh [m²/s]."""


@dataclass(frozen=True)
class Stream:
    """A flow given by its stream function, u = −(1/r)∂ψ/∂z and w = (1/r)∂ψ/∂r.

    ψ is interpolated by quadratic elements on the mesh, and these are differentiated: no divergence is left, within
    elements or between them. Along each piece of wall ψ is its median there, so that nothing passes.

    Parameters
    ----------
    psi : ψ(r, z) [m³/s per radian], for arrays of any one shape
    """

    psi: Callable[[Array, Array], Array]

    @classmethod
    def on_grid(cls, r: Array, z: Array, psi: Array) -> Stream:
        """From ψ (nz, nr) on nodes, linear in r² and in z between them: a plug is exact."""
        linear = bilinear(r**2, z, psi)
        return cls(lambda r, z: linear(r**2, z))

    def at(self, basis: Any, mesh: RZMesh) -> RadialFlow:
        """(r u, r w) at the quadrature points of a scikit-fem basis on the mesh [m²/s]."""
        from skfem import ElementTriP2

        quadratic = basis.with_element(ElementTriP2())
        psi = self.psi(*quadratic.doflocs)
        edges, piece = _walls(mesh)
        dofs = np.vstack([quadratic.nodal_dofs[0, edges].T, quadratic.facet_dofs[0, _facets(basis.mesh, edges)]])
        for number in range(piece.max(initial=-1) + 1):
            own = np.unique(dofs[:, piece == number])
            psi[own] = np.median(psi[own])
        dpsi = quadratic.interpolate(psi).grad
        return -dpsi[1], dpsi[0]


@dataclass(frozen=True)
class HeatProblem:
    """What is solved for, and with what.

    Parameters
    ----------
    mesh : the section; heat leaves with the flow through ``outlet``
    conductivity : k [W/(m K)]
    heat_capacity : ρc of the bulk [J/(m³ K)]
    held : temperature on boundaries, by name or by what comes before the colon of one, as ``wall``; where two meet,
        the later one holds
    """

    mesh: RZMesh
    conductivity: float
    heat_capacity: float
    held: Mapping[str, float]

    @property
    def diffusivity(self) -> float:
        """κ = k/ρc [m²/s]."""
        return self.conductivity / self.heat_capacity


@dataclass(frozen=True)
class Temperature:
    """A temperature on the points of a mesh.

    Parameters
    ----------
    mesh : the section
    values : (n,) at its points
    outlet_mean : at the outlet, weighted by the flow that leaves there
    """

    mesh: RZMesh
    values: Array
    outlet_mean: float

    def at(self, r: Array, z: Array) -> Array:
        """Values at points of the section."""
        from skfem import Basis, ElementTriP1

        place = np.stack([np.ravel(r), np.ravel(z)])
        probes = Basis(_triangles(self.mesh), ElementTriP1()).probes(place)
        return np.asarray(probes @ self.values).reshape(np.shape(r))

    def apart(self, other: Temperature) -> tuple[float, float]:
        """RMS over the volume, and largest, difference from another temperature on the same mesh.

        Raises
        ------
        DataError : the other temperature is on another mesh
        """
        if self.values.shape != other.values.shape or not np.array_equal(self.mesh.points, other.mesh.points):
            raise DataError("temperatures on different meshes cannot be compared point by point")
        difference, weight = self.values - other.values, _point_volumes(self.mesh)
        return float(np.sqrt(weight @ difference**2 / weight.sum())), float(np.abs(difference).max())


def solve_heat(problem: HeatProblem, flow: Flow) -> Temperature:
    """The temperature of a problem in a flow.

    Raises
    ------
    DataError : the mesh lacks a boundary that the problem names, or an outlet
    """
    from skfem import BilinearForm, condense

    space = Space(problem.mesh)
    basis, outlet = space.basis, space.through("outlet")
    diffusivity = problem.diffusivity
    flux_r, flux_z = flow.at(basis, problem.mesh)
    radius = np.asarray(basis.global_coordinates())[0]
    delay = _time_scale(np.hypot(flux_r, flux_z) / radius, space.size, diffusivity)

    @BilinearForm
    def carried(t, v, at):  # type: ignore[no-untyped-def]
        along_v = at.flux_r * v.grad[0] + at.flux_z * v.grad[1]
        along_t = at.flux_r * t.grad[0] + at.flux_z * t.grad[1]
        rest = along_t / at.x[0] - diffusivity * t.grad[0] / at.x[0]  # what a linear T leaves of the equation
        conducted = diffusivity * at.x[0] * (t.grad[0] * v.grad[0] + t.grad[1] * v.grad[1])
        return conducted - t * along_v + at.delay * along_v * rest

    @BilinearForm
    def leaving(t, v, at):  # type: ignore[no-untyped-def]
        return t * v * (at.flux_r * at.n[0] + at.flux_z * at.n[1])

    out_r, out_z = flow.at(outlet, problem.mesh)
    matrix = carried.assemble(basis, flux_r=flux_r, flux_z=flux_z, delay=delay)
    matrix += leaving.assemble(outlet, flux_r=out_r, flux_z=out_z)
    held = _held(problem)
    system, right, values, free = condense(
        matrix, x=np.nan_to_num(held), D=np.flatnonzero(~np.isnan(held)), expand=True
    )
    values[free] = splu(sparse.csc_matrix(system)).solve(right)
    return Temperature(problem.mesh, values, _outlet_mean(outlet, out_r, out_z, values))


def bilinear(first: Array, second: Array, values: Array) -> Callable[[Array, Array], Array]:
    """Function of two coordinates from values on (second, first); beyond the grid it goes on in the same way."""
    from scipy.interpolate import RegularGridInterpolator

    inner = RegularGridInterpolator((second, first), values, bounds_error=False, fill_value=None)
    return lambda a, b: np.asarray(inner((b, a)))


@dataclass(frozen=True)
class Space:
    """Linear elements on a mesh."""

    mesh: RZMesh

    @cached_property
    def basis(self) -> Any:
        """Of the section."""
        from skfem import Basis, ElementTriP1

        return Basis(_triangles(self.mesh), ElementTriP1(), intorder=_QUADRATURE)

    def through(self, name: str) -> Any:
        """Of a part of the boundary.

        Raises
        ------
        DataError : the mesh has no such boundary
        """
        from skfem import ElementTriP1, FacetBasis

        edges = self.mesh.edges[self.mesh.named(name)]
        if not len(edges):
            raise DataError(f"the mesh has no boundary called {name!r}")
        facets = _facets(self.basis.mesh, edges)
        return FacetBasis(self.basis.mesh, ElementTriP1(), facets=facets, intorder=_QUADRATURE)

    @property
    def size(self) -> Array:
        """(elements, 1) side of the equilateral triangle of the same area [m]."""
        return np.asarray(np.sqrt(4 / np.sqrt(3) * self.basis.dx.sum(axis=1, keepdims=True)))


def _triangles(mesh: RZMesh) -> Any:
    """scikit-fem's mesh; points keep their numbers."""
    from skfem import MeshTri

    return MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))


def _facets(triangles: Any, edges: Index) -> Index:
    """(k,) scikit-fem's number of each edge (k, 2)."""
    count = triangles.p.shape[1]
    known, wanted = (np.min(e, axis=0) * count + np.max(e, axis=0) for e in (triangles.facets.astype(int), edges.T))
    order = np.argsort(known)
    return np.asarray(order[np.searchsorted(known, wanted, sorter=order)])


def _walls(mesh: RZMesh) -> tuple[Index, Index]:
    """(k, 2) edges that nothing passes, the axis among them, and (k,) the number of the piece that each belongs to."""
    edges = mesh.edges[~mesh.named("inlet") & ~mesh.named("outlet")]
    count = len(mesh.points)
    graph = sparse.csr_array((np.ones(len(edges)), tuple(edges.T)), shape=(count, count))
    piece = csgraph.connected_components(graph, directed=False)[1][edges[:, 0]]
    return edges, np.unique(piece, return_inverse=True)[1]


def _time_scale(speed: Array, size: Array, diffusivity: float) -> Array:
    """How far upwind, as a time, the test functions look [s]."""
    return np.asarray(((2 * speed / size) ** 2 + (12 * diffusivity / size**2) ** 2) ** -0.5)


def _held(problem: HeatProblem) -> Array:
    """(n,) temperature where it is given, NaN elsewhere."""
    values = np.full(len(problem.mesh.points), np.nan)
    for name, temperature in problem.held.items():
        edges = problem.mesh.edges[problem.mesh.named(name)]
        if not len(edges):
            raise DataError(f"the mesh has no boundary called {name!r}, where {temperature:g} is to be held")
        values[edges] = temperature
    return values


def _outlet_mean(outlet: Any, flux_r: Array, flux_z: Array, values: Array) -> float:
    flow = (flux_r * outlet.normals[0] + flux_z * outlet.normals[1]) * outlet.dx
    return float((flow * np.asarray(outlet.interpolate(values))).sum() / flow.sum())


def _point_volumes(mesh: RZMesh) -> Array:
    """(n,) share of the volume, but for 2π, that belongs to each point [m³]."""
    from skfem import LinearForm

    @LinearForm
    def share(v, at):  # type: ignore[no-untyped-def]
        return at.x[0] * v

    return np.asarray(share.assemble(Space(mesh).basis))
