"""Fields with a known answer: solids flow with ψ = ψ_wall [(1+c) t − c t²], t = r²/b(z)², inside a boundary b(z).

With c = 0 the profile is flat, with c = 1 the speed falls to zero at the boundary. Outside b(z) nothing moves: solids
at rest, a void or no vessel at all, as each vessel says. All of it comes from these formulas, none from granpipe.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from granpipe.field import Field, Grid

FLOW = 0.02  # bulk flow at DEM scale [m³/s]
PACKING = 0.58
SCALE = 0.01  # flow rate of the case over that of the DEM


@dataclass(frozen=True)
class Vessel:
    """An axisymmetric vessel, the boundary b(z) of what flows in it, and which of the rest is void."""

    wall: list[tuple[float, float]]
    obstacles: dict[str, list[tuple[float, float]]]
    boundary: Callable
    slope: Callable
    curvature: float  # c
    inside: Callable  # (r, z) -> bool
    void: Callable  # (r, z) -> bool

    def bulk_velocity(self, r, z):
        """(u, w) [m/s] at the flow rate of the case; r may be 0."""
        b, db, c = self.boundary(z), self.slope(z), self.curvature
        t = np.minimum(1.0, (r / b) ** 2)
        edge = -SCALE * FLOW / (2 * np.pi)
        rise = (1 + c - 2 * c * t) * (r <= b * (1 + 1e-12))
        return edge * rise * 2 * r * db / b**3, edge * rise * 2 / b**2

    def psi(self, r, z):
        """Stream function of the solids flux at DEM scale."""
        t = np.minimum(1.0, (r / self.boundary(z)) ** 2)
        return -PACKING * FLOW / (2 * np.pi) * ((1 + self.curvature) * t - self.curvature * t**2)


def ring_vessel() -> Vessel:
    """A cylinder with a ring on its wall: a stagnant heap on the ring, a cavity under it, flow through its middle."""

    def ramp(z, low, high):
        x = np.clip((z - low) / (high - low), 0, 1)
        return x * x * (3 - 2 * x), np.where((z > low) & (z < high), 6 * x * (1 - x) / (high - low), 0.0)

    def boundary(z):
        return 0.5 - 0.25 * ramp(z, 0.3, 0.9)[0] + 0.25 * ramp(z, 1.1, 1.7)[0]

    def slope(z):
        return -0.25 * ramp(z, 0.3, 0.9)[1] + 0.25 * ramp(z, 1.1, 1.7)[1]

    return Vessel(
        wall=[(0.5, 2.0), (0.5, 0.0)],
        obstacles={"ring": [(0.3, 0.9), (0.5, 0.9), (0.5, 1.0), (0.3, 1.0)]},
        boundary=boundary,
        slope=slope,
        curvature=1.0,
        inside=lambda r, z: ~((r > 0.3) & (z > 0.9) & (z < 1.0)) & (r < 0.5),
        void=lambda r, z: (r > boundary(z)) & (z < 0.9),
    )


def hopper(curvature: float = 0.0) -> Vessel:
    """A straight cone, filled and flowing everywhere: every row of its wall cuts cells."""

    def boundary(z):
        return 0.2 + 0.3 * z

    return Vessel(
        wall=[(0.5, 1.0), (0.2, 0.0)],
        obstacles={},
        boundary=boundary,
        slope=lambda z: 0.3 + 0 * z,
        curvature=curvature,
        inside=lambda r, z: r < boundary(z),
        void=lambda r, z: np.zeros(np.broadcast(r, z).shape, bool),
    )


def pipe(curvature: float = 0.0, radius: float = 0.5) -> Vessel:
    """A cylinder: plug flow, or a parabola."""
    return Vessel(
        wall=[(radius, 1.0), (radius, 0.0)],
        obstacles={},
        boundary=lambda z: radius + 0 * z,
        slope=lambda z: 0 * z,
        curvature=curvature,
        inside=lambda r, z: r + 0 * z < radius,
        void=lambda r, z: np.zeros(np.broadcast(r, z).shape, bool),
    )


def field_of(vessel: Vessel, cell: float, *, with_psi: bool = True, with_packing: bool = True) -> Field:
    """Sample a vessel's analytic flow as a Field."""
    wall = np.array(vessel.wall)
    grid = Grid.covering(wall[:, 0].max(), wall[:, 1].min(), wall[:, 1].max(), cell)
    psi = vessel.psi(grid.r_edges[None, :], grid.z_edges[:, None])
    inside = _fraction(vessel.inside, grid)
    r, z = np.meshgrid(grid.r_centres, grid.z_centres)
    bulk = (inside > 0) & ~vessel.void(r, z)
    side = 2 * np.pi * grid.r_edges[1:] * np.diff(grid.z_edges)[:, None]
    flux_r = np.zeros((len(grid.z_centres), len(grid.r_edges)))
    flux_r[:, 1:] = -2 * np.pi * np.diff(psi, axis=0)[:, 1:] / side
    flux_z = 2 * np.diff(psi, axis=1) / np.diff(grid.r_edges**2)
    return Field(
        grid=grid,
        inside_fraction=inside,
        bulk=bulk,
        flux_r=flux_r,
        flux_z=flux_z,
        bulk_flow=FLOW,
        bulk_packing=PACKING,
        flow_scale=SCALE,
        packing_fraction=np.where(bulk, PACKING, 0.0) if with_packing else None,
        psi=psi if with_psi else None,
    )


def _fraction(inside: Callable, grid: Grid, points: int = 40) -> np.ndarray:
    """Part of each cell where `inside` holds, from points × points samples of equal volume."""
    step = (np.arange(points) + 0.5) / points
    square = grid.r_edges**2
    r = np.sqrt(square[:-1, None] + np.diff(square)[:, None] * step).ravel()
    z = (grid.z_edges[:-1, None] + np.diff(grid.z_edges)[:, None] * step).ravel()
    hits = inside(r[None, :], z[:, None])
    return hits.reshape(len(grid.z_centres), points, len(grid.r_centres), points).mean(axis=(1, 3))
