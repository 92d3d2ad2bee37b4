"""The fictitious fluid of a vessel, from its r–z mesh to the field that is exported."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from granpipe.field import Array, Field, Grid, flux_from_psi
from granpipe.fluid.forcing import KnownFlow, blended_walls, force_of
from granpipe.fluid.stokes import solve_stokes
from granpipe.fluid.stream import StreamFunction, nearest_stream_function
from granpipe.fluid.wall_speed import WallLaw, boundary_data
from granpipe.rzmesh import RZMesh


@dataclass(frozen=True)
class FluidSolution:
    """The flow of a fictitious fluid.

    Parameters
    ----------
    mesh : its mesh
    u, w : (n,) velocity at the points of the mesh [m/s]
    psi : (n,) stream function there [m³/s per radian, or per metre of depth]
    flow : Φ [m³/s], positive downwards
    stream : ψ for unit flow in units of `length`, from which everything is sampled
    length : unit of length of `stream` [m]
    unknowns, residual : of the Stokes system
    """

    mesh: RZMesh
    u: Array
    w: Array
    psi: Array
    flow: float
    stream: StreamFunction
    length: float
    unknowns: int
    residual: float

    @property
    def correction(self) -> float:
        """Part of the computed velocity, ‖·‖ over the volume, that was not divergence-free before ψ replaced it."""
        return self.stream.correction

    def psi_at(self, grid: Grid) -> Array:
        """(nz+1, nr+1) ψ on the nodes of a grid [m³/s per radian]; outside the vessel that of the nearest wall."""
        return self.flow * self.stream.psi_at(grid.r_edges / self.length, grid.z_edges / self.length)


def solve_fluid(
    mesh: RZMesh, law: WallLaw, flow: float, order: int = 2, known: KnownFlow | None = None
) -> FluidSolution:
    """Solve for a flow Φ [m³/s, positive downwards] with elements of an order 2–4; the hybrid follows a known flow.

    The problem is linear and has no length of its own: it is solved for unit flow in a vessel of about unit size.

    Raises
    ------
    SolveError : the equations have no unique or no accurate solution
    """
    length = 2.0 ** np.round(np.log2(np.abs(mesh.points[:, 0]).max()))
    annulus = law.annulus and (law.annulus[0] / length, law.annulus[1] / length)
    unit_mesh, unit_law = replace(mesh, points=mesh.points / length), replace(law, annulus=annulus)
    data = boundary_data(unit_mesh, unit_law, 1.0, np.arange(order + 1) / order)
    forcing = None
    if known is not None:
        known.check_covers(mesh)
        unit_known = known.in_units_of(length)
        data, forcing = blended_walls(data, unit_known, unit_mesh), force_of(unit_known, unit_mesh)
    stokes = solve_stokes(unit_mesh, data, forcing)
    stream = nearest_stream_function(stokes, data)
    u, w, psi = stream.at_points()
    area = mesh.measure.area(np.zeros(()), np.array([1.0, length]))  # of a body twice as large, four times or twice
    speed = flow * float(area[0] / area[1])
    return FluidSolution(
        mesh, u * speed, w * speed, psi * flow, flow, stream, float(length), stokes.unknowns, stokes.residual
    )


def to_field(solution: FluidSolution, grid: Grid, inside_fraction: Array, bulk_packing: float) -> Field:
    """The solution as face fluxes on a grid, divergence-free in every cell and with the whole flow through every level.

    Parameters
    ----------
    solution : the fluid
    grid : r–z grid that covers the vessel
    inside_fraction : (nz, nr) part of each cell inside the outline
    bulk_packing : φ_ref, which makes a solids flux of the fluid's velocity
    """
    psi = bulk_packing * solution.psi_at(grid)
    flux_r, flux_z = flux_from_psi(psi, grid)
    return Field(
        grid=grid,
        inside_fraction=inside_fraction,
        bulk=inside_fraction > 0,
        flux_r=flux_r,
        flux_z=flux_z,
        bulk_flow=solution.flow,
        bulk_packing=bulk_packing,
        flow_scale=1.0,
        psi=psi,
    )
