"""The hybrid: the fluid is made to follow a known flow in parts of the vessel, by a volume force K (s_Φ u* − u).

Sparta & Halvorsen (2017). The known flow comes as a stream function, because a strong force passes on whatever
divergence u* has. Between the forced parts and the rest K fades by a quintic ramp, and the wall's speed changes with
the same ramp from that of the moving-wall law to that of the known flow, which at a wall may be anything down to rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from granpipe.errors import DataError
from granpipe.field import ROUND, Array, Measure
from granpipe.fluid.stokes import Forcing
from granpipe.fluid.wall_speed import BoundaryData
from granpipe.rzmesh import RZMesh

FORCE_FACTOR = 1e5
"""K in units of μ/a². In the one scene studied (docs/validation/force_factor.md) the error in the forced part has
settled by 1e5, the error outside is least at 1e5 to 1e6, and above 1e8 divergence and the error outside grow."""


@dataclass(frozen=True)
class KnownFlow:
    """A flow for the fluid to follow in parts of the vessel.

    Parameters
    ----------
    r_edges, z_edges : nodes of its grid, rising [m]; it may cover a part of the vessel
    psi : (nz+1, nr+1) its stream function, for any flow rate [m³/s per radian or metre of depth]
    intervals : lower and upper end of the parts where the fluid is to follow it altogether [m]
    ramp : length over which the force fades beyond these ends [m]
    force_factor : K in units of μ/a², a being the radius of the vessel's outlet, or half the width of a slot
    measure : what its section stands for
    """

    r_edges: Array
    z_edges: Array
    psi: Array
    intervals: tuple[tuple[float, float], ...]
    ramp: float
    force_factor: float = FORCE_FACTOR
    measure: Measure = ROUND

    @property
    def flow(self) -> float:
        """Its flow Φ [m³/s], positive downwards, as ψ on the outermost columns of nodes has it."""
        return float(self.measure.turn * (self.psi[:, 0] - self.psi[:, -1]).mean())

    def strength(self, z: Array) -> Array:
        """Part of the full force at a height: 1 in the intervals, 0 farther than `ramp` from all of them."""
        away = np.min([np.maximum(np.maximum(low - z, z - high), 0) for low, high in self.intervals], axis=0)
        near = np.clip(1 - away / self.ramp, 0, 1)
        return np.asarray(near**3 * (10 - 15 * near + 6 * near**2))

    def velocity(self) -> Callable[[Array, Array], tuple[Array, Array]]:
        """u* and w* at (r, z) for a flow of 1 m³/s, from a bicubic spline of ψ: divergence-free throughout.

        It is a spline in z and ∫ r dr, or x in a slab: there plug flow is linear and the axis has nothing singular.
        """
        from scipy.interpolate import RectBivariateSpline

        measure = self.measure
        psi = RectBivariateSpline(self.z_edges, measure.reach(self.r_edges), self.psi / self.flow)
        (z_min, z_max), (r_min, r_max) = self.z_edges[[0, -1]], self.r_edges[[0, -1]]
        if measure.axial:
            r_min = 1e-6 * r_max

        def at(r: Array, z: Array) -> tuple[Array, Array]:
            across, height = np.clip(r, r_min, r_max), np.clip(z, z_min, z_max)
            reach = measure.reach(across)
            u = -psi(height, reach, dx=1, grid=False) / measure.weight(across)
            return u, psi(height, reach, dy=1, grid=False)

        return at

    def in_units_of(self, length: float) -> KnownFlow:
        """The same flow with all lengths divided by `length`."""
        intervals = tuple((low / length, high / length) for low, high in self.intervals)
        r_edges, z_edges = self.r_edges / length, self.z_edges / length
        return replace(self, r_edges=r_edges, z_edges=z_edges, intervals=intervals, ramp=self.ramp / length)

    def check_covers(self, mesh: RZMesh) -> None:
        """DataError where the fluid would have to follow it beyond its grid."""
        bottom, top = mesh.points[:, 1].min(), mesh.points[:, 1].max()
        slack = 1e-9 * (top - bottom)
        for low, high in self.intervals:
            first, last = max(low - self.ramp, bottom), min(high + self.ramp, top)
            if first < self.z_edges[0] - slack or last > self.z_edges[-1] + slack:
                raise DataError(
                    f"the known flow covers z {self.z_edges[0]:g} to {self.z_edges[-1]:g} m, but with its ramps the "
                    f"fluid is to follow it from {first:g} to {last:g} m: a field that covers this is needed"
                )


def force_of(known: KnownFlow, mesh: RZMesh) -> Forcing:
    """The volume force in a mesh, for a fluid with a flow of 1 m³/s and unit viscosity."""
    _, radius = mesh.outlet()
    full = known.force_factor / radius**2

    def factor(r: Array, z: Array) -> Array:
        return full * known.strength(z)

    return Forcing(factor, known.velocity())


def blended_walls(data: BoundaryData, known: KnownFlow, mesh: RZMesh) -> BoundaryData:
    """Boundary data for a flow of 1 m³/s whose walls and obstacles move as the known flow does, where it is followed.

    Only along themselves: what flows through them stays nothing.
    """
    (r0, z0), (r1, z1) = mesh.ends().transpose(1, 2, 0)[..., None]
    r, z = r0 + (r1 - r0) * data.along, z0 + (z1 - z0) * data.along
    normals = mesh.normals()
    tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None]
    beside = np.stack(known.velocity()(r, z), axis=2)
    sliding = np.sum(beside * tangents, axis=2, keepdims=True) * tangents
    solid = mesh.named("wall") | mesh.named("obstacle")
    part = (solid[:, None] * known.strength(z))[..., None]
    return replace(data, velocity=np.asarray((1 - part) * data.velocity + part * sliding))
