"""The flow of a frictional fluid: creeping, with the viscosity of `granpipe.fluid.friction_law`, by a fixed point.

Each step solves one Stokes problem (P2–P1, direct) whose viscosity and wall drag come from the last velocity and
pressure. The regularization falls step by step to its value, then Anderson's acceleration goes on until a step changes
the velocity by less than `CONVERGED`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from granpipe.errors import SolveError
from granpipe.field import Array, Mask, Measure
from granpipe.fluid.constraints import Constraints, constrain
from granpipe.fluid.direct import solve_ordered
from granpipe.fluid.elements import Space
from granpipe.fluid.fixed_point import Anderson
from granpipe.fluid.friction_forms import FrictionForms
from granpipe.fluid.friction_law import FrictionLaw
from granpipe.fluid.stokes import StokesSolution, divergence, elimination_order
from granpipe.fluid.wall_speed import BoundaryData
from granpipe.rzmesh import Index, RZMesh

CONVERGED = 1e-4
"""‖change of the velocity in a step‖ over its size, each node's speed taken relative to the mean of its level."""

FIRST_REGULARIZATION, FALL = 0.3, 0.6
"""The regularization starts at 0.3 U/R and falls by this factor a step."""

RELAXATION = 0.7
MOST_STEPS = 150
QUADRATURE = 4
_PIVOT_SHIFT = 1e-13  # of ∫ r q², over the mean viscosity


@dataclass(frozen=True)
class FrictionSolution:
    """What the fixed point came to.

    Parameters
    ----------
    stokes : velocity and pressure (in units of ρ g) of the last step
    steps : how many it took
    change : relative change of the velocity in the last step
    tension : part of the volume where the pressure is not positive
    """

    stokes: StokesSolution
    steps: int
    change: float
    tension: float


def solve_friction(
    mesh: RZMesh, data: BoundaryData, rubbing: Mask, law: FrictionLaw, tolerance: float = CONVERGED
) -> FrictionSolution:
    """Solve on a mesh in units of its size, for boundary data of order 2.

    Parameters
    ----------
    data : walls with `normal_held` and a free tangent slide; what is not held is free of traction
    rubbing : (k,) which edges have wall friction; the other sliding ones are free surfaces

    Raises
    ------
    SolveError
        the iteration does not converge, or a linear system defeats the solver
    """
    data.check_balance()
    problem = _Problem(mesh, data, rubbing, law)
    state = problem.first()
    strength = max(FIRST_REGULARIZATION, law.regularization)
    while strength > law.regularization:
        state = problem.relaxed(state, strength)
        strength *= FALL
    anderson = Anderson(problem.scale, damping=RELAXATION)
    for step in range(1, MOST_STEPS + 1):
        image = problem.step(state, law.regularization)
        change = problem.change(state, image)
        if change < tolerance:
            return FrictionSolution(problem.stokes(image), step, change, problem.tension(image))
        state = anderson.next(state, image)
    raise SolveError(
        f"the frictional fluid did not converge: after {MOST_STEPS} steps one still changes the velocity by "
        f"{change:.2g}, and {tolerance:g} is asked for; use particles (model: dem), or rheology: viscous"
    )


class _Problem:
    """One state is the velocity (2N,), then the pressure (M,)."""

    def __init__(self, mesh: RZMesh, data: BoundaryData, rubbing: Mask, law: FrictionLaw) -> None:
        self.law = law
        self.space = Space.on(mesh, 2, QUADRATURE)
        self.pressure = self.space.of_order(1)
        self.forms = FrictionForms(self.space, self.pressure, rubbing)
        self.bound: Constraints = constrain(self.space, data)
        flow = float(-data.flow[mesh.named("outlet")].sum())
        self._levels = _Levels(mesh, abs(flow))
        self._factors = self.forms.spreading(law.length)
        self._outflow = divergence(self.space, self.pressure)
        self._closed = bool(data.normal_held.all())
        self._order: Index | None = None
        self._residual = 0.0
        speed = self._levels.speed(self.space.points[:, 1])
        share = np.sqrt(self.forms.volume / self.forms.volume.sum()) / speed
        height = self._levels.radius(self.pressure.points[:, 1])
        self.scale = np.concatenate([share, share, 1e-2 / (height * np.sqrt(self.pressure.size))])

    def first(self) -> Array:
        """The flow of a fluid as viscous as friction is under the weight of one radius, sheared at U/R."""
        radius, rate = self._levels.radius(self.forms.z), self._levels.rate(self.forms.z)
        edge_z = self.forms.edge_points[1]
        drag = self.law.wall * self._levels.radius(edge_z) / self._levels.speed(edge_z)
        return self._solve(self.law.internal * radius / rate, drag)

    def step(self, state: Array, regularization: float) -> Array:
        """G(state)."""
        law = replace(self.law, regularization=regularization)
        velocity, pressure = np.split(state, [2 * self.space.size])
        spread = self.forms.at_quadrature(self.forms.spread_rate(self._factors, velocity))
        z, edge_z = self.forms.z, self.forms.edge_points[1]
        levels = self._levels
        viscosity = law.viscosity(self.forms.at_quadrature(pressure), spread, levels.rate(z), levels.radius(z))
        slip = self.forms.slip(velocity)
        drag = law.drag(self.forms.at_edges(pressure), slip, levels.speed(edge_z), levels.radius(edge_z))
        return self._solve(viscosity, drag)

    def relaxed(self, state: Array, regularization: float) -> Array:
        """A step, of which a part is taken."""
        return state + RELAXATION * (self.step(state, regularization) - state)

    def change(self, state: Array, image: Array) -> float:
        """Relative change of the velocity."""
        velocities = 2 * self.space.size
        scale = self.scale[:velocities]
        size = float(np.linalg.norm(scale * image[:velocities]))
        return float(np.linalg.norm(scale * (image - state)[:velocities])) / size

    def tension(self, state: Array) -> float:
        """Part of the volume with p ≤ 0."""
        pressure = self.forms.at_quadrature(state[2 * self.space.size :])
        return float(self.forms.weight[pressure <= 0].sum() / self.forms.weight.sum())

    def stokes(self, state: Array) -> StokesSolution:
        """The state as a solution of Stokes' equations."""
        u, w, pressure = np.split(state, [self.space.size, 2 * self.space.size])
        return StokesSolution(self.space, u, w, pressure, len(self._ordered()) + self._closed, self._residual)

    def _ordered(self) -> Index:
        assert self._order is not None
        return self._order

    def _solve(self, viscosity: Array, drag: Array) -> Array:
        P, given, outflow = self.bound.prolongation, self.bound.given, self._outflow
        momentum = self.forms.stiffness(viscosity) + self.forms.rubbing(drag)
        matrix = sparse.block_array([[P.T @ momentum @ P, (outflow @ P).T], [outflow @ P, None]], format="csr")
        right = np.concatenate([P.T @ (self.forms.gravity - momentum @ given), -outflow @ given])
        if self._order is None:
            order = elimination_order(matrix, self.bound, self.space, self.pressure)
            self._order = order[order != len(right) - 1] if self._closed else order
        solution, self._residual = solve_ordered(matrix, right, self._order, self._shift(viscosity))
        return np.concatenate([P @ solution[: P.shape[1]] + given, solution[P.shape[1] :]])

    def _shift(self, viscosity: Array) -> Array:
        share = np.bincount(
            self.forms.corners.ravel(),
            np.repeat((self.forms.weight / viscosity).sum(axis=1) / 3, 3),
            minlength=self.pressure.size,
        )
        return np.concatenate([np.zeros(len(self.bound.node)), _PIVOT_SHIFT * share])


@dataclass(frozen=True)
class _Levels:
    """Mean speed U and radius R (in a slab half the width) of the free area at each level, by linear interpolation."""

    z: Array
    area: Array
    flow: float
    measure: Measure

    def __init__(self, mesh: RZMesh, flow: float) -> None:
        heights = np.unique(mesh.ends()[..., 1])
        middle = 0.5 * (heights[1:] + heights[:-1])
        object.__setattr__(self, "z", middle)
        object.__setattr__(self, "area", mesh.free_area(middle))
        object.__setattr__(self, "flow", flow)
        object.__setattr__(self, "measure", mesh.measure)

    def radius(self, z: Array) -> Array:
        """√(Ω/π), or half the free width."""
        return self.measure.radius(np.interp(z, self.z, self.area))

    def speed(self, z: Array) -> Array:
        """Φ/Ω."""
        return np.asarray(self.flow / np.interp(z, self.z, self.area))

    def rate(self, z: Array) -> Array:
        """U/R."""
        return self.speed(z) / self.radius(z)
