"""A frictional fluid in a vessel: boundary data for walls, surfaces and outlet, and the stream function."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from granpipe.field import Array, Mask
from granpipe.fluid.fictitious import FluidSolution
from granpipe.fluid.friction_law import FrictionLaw
from granpipe.fluid.frictional import CONVERGED, FrictionSolution, solve_friction
from granpipe.fluid.stream import nearest_stream_function
from granpipe.fluid.wall_speed import EVERYWHERE, BoundaryData, outflow
from granpipe.rzmesh import RZMesh

SURFACE = "free surface"
"""Obstacles of a mesh whose names begin so are voids; their edges are free surfaces."""

FREE_FALL = 0.7
"""Exponent of the profile of an open outlet, w ∝ (1 − r²/a²)^0.7: an assumption in round vessels. In the outlets of two
silos of 6 d the field was 14 and 19 % wrong (docs/validation/friction_fluid.md). For slots Janda et al. (Phys. Rev.
Lett. 108 (2012) 248001) measured 0.5 of the velocity and 0.22 of the packing, whose product it is."""

ALONG = np.array([0.0, 0.5, 1.0])


@dataclass(frozen=True)
class Outlet:
    """How the solids leave: on a `plate` or through an `open` hole; between two radii [m]."""

    kind: Literal["plate", "open"] = "plate"
    radii: tuple[float, float] = EVERYWHERE


def solve_frictional(
    mesh: RZMesh, law: FrictionLaw, flow: float, outlet: Outlet, tolerance: float = CONVERGED
) -> tuple[FluidSolution, FrictionSolution]:
    """Solve for a flow Φ [m³/s, positive downwards]; the solids enter freely at an inlet that lies high enough.

    The problem has no time and no weight of its own: it is solved for unit flow and unit weight in units of the
    outlet's radius, or half its width in a slab. `law.length` is in metres.

    Raises
    ------
    SolveError : see `granpipe.fluid.frictional.solve_friction`
    """
    _, length = mesh.outlet()
    unit_mesh = replace(mesh, points=mesh.points / length)
    radii = (outlet.radii[0] / length, outlet.radii[1] / length)
    data, rubbing = friction_boundary(unit_mesh, replace(outlet, radii=radii))
    found = solve_friction(unit_mesh, data, rubbing, replace(law, length=law.length / length), tolerance)
    stream = nearest_stream_function(found.stokes, data)
    u, w, psi = stream.at_points()
    speed = flow / length ** (2 if mesh.measure.axial else 1)
    unknowns, residual = found.stokes.unknowns, found.stokes.residual
    return FluidSolution(mesh, u * speed, w * speed, psi * flow, flow, stream, length, unknowns, residual), found


def friction_boundary(mesh: RZMesh, outlet: Outlet) -> tuple[BoundaryData, Mask]:
    """For unit flow: nothing passes walls and surfaces, both may slide; which edges rub (k,)."""
    leaves, enters, axis = (mesh.named(name) for name in ("outlet", "inlet", "axis"))
    edges = np.flatnonzero(leaves)
    velocity, out = np.zeros((len(leaves), 3, 2)), np.zeros(len(leaves))
    velocity[edges], out[edges] = outflow(mesh, edges, 1.0, outlet.radii, ALONG)
    if outlet.kind == "open":
        velocity[edges], out[edges] = _free_outflow(mesh, leaves, velocity[edges])
    surface = np.char.startswith(mesh.names, f"obstacle:{SURFACE}")
    return BoundaryData(ALONG, velocity, ~enters, leaves, out), ~(leaves | enters | axis | surface)


def _free_outflow(mesh: RZMesh, leaves: Mask, plug: Array) -> tuple[Array, Array]:
    """Velocity (e, 3, 2) and flow (e,) of the outlet's edges with the profile of an open hole, for unit flow."""
    ends, (middle, radius) = mesh.ends()[leaves, :, 0], mesh.outlet()
    away = (ends[:, :1] * (1 - ALONG) + ends[:, 1:] * ALONG - middle) / radius
    shape = np.maximum(1 - away**2, 0.0) ** FREE_FALL * (plug[..., 1] != 0)
    half = 0.5 * np.abs(ends[:, 1] - ends[:, 0])[:, None]
    points, weights = np.polynomial.legendre.leggauss(3)
    place = 0.5 * (points + 1)
    lagrange = np.stack([(1 - place) * (1 - 2 * place), 4 * place * (1 - place), place * (2 * place - 1)])
    at = ends[:, :1] * (1 - place) + ends[:, 1:] * place
    flow = mesh.measure.turn * ((shape @ lagrange) * mesh.measure.weight(at) * weights * half).sum(axis=1)
    velocity = np.stack([np.zeros_like(shape), -shape / flow.sum()], axis=2)
    return velocity, flow / flow.sum()
