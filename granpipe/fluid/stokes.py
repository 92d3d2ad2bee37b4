"""Creeping flow with an axis or in the plane: Taylor–Hood elements of order k, and a direct solver.

Velocity is of order k, pressure of order k−1. −∇²u + ∇p = K (u* − u), ∇·u = 0 with unit viscosity; u* and K are the
forcing of the hybrid. At an open outlet the natural condition ∂u/∂n = p n holds: the flow leaves as if the vessel went
on, and Poiseuille flow passes unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from granpipe.field import Array
from granpipe.fluid.constraints import Constraints, constrain
from granpipe.fluid.direct import solve_ordered
from granpipe.fluid.elements import Space, dissection
from granpipe.fluid.wall_speed import BoundaryData
from granpipe.rzmesh import Index, RZMesh

PRESSURE_SHIFT = 1e-13  # on the diagonal, of r h²/(1 + K): keeps pivots from zero; refinement takes it out again


@dataclass(frozen=True)
class Forcing:
    """A volume force K (u* − u) that steers the fluid.

    Parameters
    ----------
    factor : K at (r, z) [1/m²], in units of the viscosity
    target : u* and w* at (r, z) [m/s]
    """

    factor: Callable[[Array, Array], Array]
    target: Callable[[Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class StokesSolution:
    """Velocity on the nodes of a space.

    Parameters
    ----------
    space : of the velocity
    u, w : (N,) at its nodes [m/s]
    pressure : (M,) at the nodes of the space one order below [m/s per m]
    unknowns : size of the linear system
    residual : largest residual of the linear system over its right-hand side
    """

    space: Space
    u: Array
    w: Array
    pressure: Array
    unknowns: int
    residual: float


def solve_stokes(mesh: RZMesh, data: BoundaryData, forcing: Forcing | None = None) -> StokesSolution:
    """Solve for boundary data given at k+1 equally spaced places of every edge; that makes the order k.

    SolveError where the prescribed flows do not balance, or where the linear system defeats the solver.
    """
    data.check_balance()
    order = len(data.along) - 1
    space = Space.on(mesh, order, 2 * order + 1)
    pressure = space.of_order(order - 1)
    bound = constrain(space, data)
    momentum, source = _momentum(space, forcing)
    outflow = divergence(space, pressure)
    P = bound.prolongation
    matrix = sparse.block_array([[P.T @ momentum @ P, (outflow @ P).T], [outflow @ P, None]], format="csr")
    right = np.concatenate([P.T @ (source - momentum @ bound.given), -outflow @ bound.given])
    unknowns = elimination_order(matrix, bound, space, pressure)
    if data.normal_held.all():  # the pressure is known up to a constant: the flows balance, so any node may be 0
        unknowns = unknowns[unknowns != len(right) - 1]
    solution, residual = solve_ordered(matrix, right, unknowns, _shift(len(bound.node), pressure, forcing))
    u, w = np.split(P @ solution[: P.shape[1]] + bound.given, 2)
    return StokesSolution(space, u, w, solution[P.shape[1] :], len(right), residual)


def _momentum(space: Space, forcing: Forcing | None) -> tuple[Any, Array]:
    """(2N, 2N) sparse ∫ r (∇u·∇v + K u·v) with u v/r² for the radial component, and the source (2N,) ∫ r K u*·v.

    In a slab without r and u v/r².
    """
    from skfem import BilinearForm, LinearForm

    measure = space.mesh.measure

    @BilinearForm
    def gradients(f, g, at):  # type: ignore[no-untyped-def]
        return measure.weight(at.x[0]) * (f.grad[0] * g.grad[0] + f.grad[1] * g.grad[1] + at.factor * f * g)

    @BilinearForm
    def hoop(f, g, at):  # type: ignore[no-untyped-def]
        return f * g / at.x[0]

    @LinearForm
    def push(g, at):  # type: ignore[no-untyped-def]
        return measure.weight(at.x[0]) * at.factor * at.target * g

    factor = _factor(space, forcing)
    common = gradients.assemble(space.basis, factor=factor)
    sideways = common + hoop.assemble(space.basis) if measure.axial else common
    matrix = sparse.block_diag([sideways, common], format="csr")
    if not forcing:
        return matrix, np.zeros(2 * space.size)
    target = forcing.target(*np.asarray(space.basis.global_coordinates()))
    return matrix, np.concatenate([push.assemble(space.basis, factor=factor, target=part) for part in target])


def divergence(space: Space, pressure: Space) -> Any:
    """(M, 2N) sparse −∫ q (r ∂u/∂r + u + r ∂w/∂z); in a slab −∫ q (∂u/∂x + ∂w/∂z)."""
    from skfem import BilinearForm

    measure = space.mesh.measure

    @BilinearForm
    def sideways(f, q, at):  # type: ignore[no-untyped-def]
        return -q * (at.x[0] * f.grad[0] + f if measure.axial else f.grad[0])

    @BilinearForm
    def vertical(f, q, at):  # type: ignore[no-untyped-def]
        return -q * measure.weight(at.x[0]) * f.grad[1]

    forms = [form.assemble(space.basis, pressure.basis) for form in (sideways, vertical)]
    return sparse.hstack(forms, format="csr")


def _shift(velocities: int, pressure: Space, forcing: Forcing | None) -> Array:
    """(n,) what is taken from the diagonal: nothing for velocities, 1e-13 ∫ r q²/(1 + K) for pressures.

    A force that holds the velocity makes the pressure soft, like 1/K; the shift must stay small beside that.
    """
    from skfem import BilinearForm

    @BilinearForm
    def mass(p, q, at):  # type: ignore[no-untyped-def]
        return pressure.mesh.measure.weight(at.x[0]) * p * q / (1 + at.factor)

    softness = mass.assemble(pressure.basis, factor=_factor(pressure, forcing)).diagonal()
    return np.concatenate([np.zeros(velocities), PRESSURE_SHIFT * softness])


def _factor(space: Space, forcing: Forcing | None) -> Array:
    """K at the quadrature points of a space; 0 without a force."""
    r, z = np.asarray(space.basis.global_coordinates())
    return forcing.factor(r, z) if forcing else np.zeros_like(r)


def elimination_order(matrix: Any, bound: Constraints, space: Space, pressure: Space) -> Index:
    """Elimination order by nested dissection; in each mesh entity velocities first, so that pressures find a pivot.

    A pressure on the boundary, whose own velocities are prescribed, waits for the last velocity that it meets.
    """
    rank = dissection(space)
    velocity, own = rank[space.entity[bound.node]], rank[pressure.entity]
    met = sparse.csr_array(matrix[len(velocity) :, : len(velocity)])
    latest = np.full(pressure.size, np.iinfo(np.int64).min)
    np.maximum.at(latest, np.repeat(np.arange(pressure.size), np.diff(met.indptr)), velocity[met.indices])
    alone = ~np.isin(pressure.entity, space.entity[bound.node])
    own[alone] = np.maximum(own, latest)[alone]
    kind = np.repeat([0, 1], [len(velocity), pressure.size])
    return np.asarray(np.lexsort((kind, np.concatenate([velocity, own]))))
