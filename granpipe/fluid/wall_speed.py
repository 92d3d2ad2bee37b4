"""What the boundary asks of the fictitious fluid: the moving-wall law, inlet and outlet.

Sparta & Halvorsen (2017) let the wall move, w_wall = −f Φ/Ω(z) and u_wall = w_wall dr_wall/dz (their equations (1)
and (2), with the signs of a downward flow): f = 1 on upright walls, which makes plug flow, and on sloping ones
what is given, or what the law of `granpipe.fluid.wall_factor` says of friction and angle. Ledges and obstacles are at
rest, or slip.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from granpipe.errors import CaseError, SolveError
from granpipe.field import Array, Mask
from granpipe.fluid.wall_factor import wall_factor_law
from granpipe.rzmesh import Index, Names, RZMesh

UPRIGHT = 1e-6  # |dr/dz| below which a wall counts as upright
LEVEL = 1e-6  # |dz/dr| below which it is a ledge
NUDGE = 1e-9  # of an edge, from its ends: where Ω is read
EVERYWHERE = (-np.inf, np.inf)
BALANCE = 1e-10  # of the flow: what the flows through the boundary may miss


@dataclass(frozen=True)
class WallLaw:
    """How the boundary of a fictitious fluid behaves.

    Parameters
    ----------
    walls : "moving" at the speed of the law, or "slip" (no friction)
    friction : of particles on the wall, which tells f of sloping walls: the wall's speed over the mean at its height
    wall_factor : f of sloping walls where it is given, whatever the friction
    section_factors : the same of the sloping walls of a section, by its name
    solids : ledges and obstacles: at "rest", or "slip"
    outlet_profile : "developed": no traction, the flow leaves as if the vessel continued; "uniform": the same
        speed everywhere; "annular": the same speed between the radii `annulus`, no flow elsewhere
    annulus : inner and outer radius of an annular outlet [m]
    """

    walls: Literal["moving", "slip"] = "moving"
    friction: float = 0.73
    wall_factor: float | None = None
    section_factors: Mapping[str, float] = field(default_factory=dict)
    solids: Literal["rest", "slip"] = "rest"
    outlet_profile: Literal["developed", "uniform", "annular"] = "developed"
    annulus: tuple[float, float] | None = None

    @property
    def outlet_radii(self) -> tuple[float, float]:
        """Radii between which a prescribed outlet lets the flow out [m].

        Raises
        ------
        CaseError : an annular outlet without its radii
        """
        if self.outlet_profile != "annular":
            return EVERYWHERE
        if self.annulus is None:
            raise CaseError("an annular outlet needs its inner and outer radius", ("fluid", "annulus"))
        return self.annulus


@dataclass(frozen=True)
class BoundaryData:
    """What holds on each of the k boundary edges of a mesh, at n places along it.

    Parameters
    ----------
    along : (n,) the places: 0 at the first end of an edge, 1 at the second
    velocity : (k, n, 2) u and w there [m/s]; it counts where it is held
    normal_held, tangent_held : (k,) which components are prescribed; what is not held is free of traction
    flow : (k,) flow out through each edge [m³/s]; kept exactly where the normal component is held
    """

    along: Array
    velocity: Array
    normal_held: Mask
    tangent_held: Mask
    flow: Array

    def check_balance(self) -> None:
        """SolveError where nothing is free to take up a mismatch of the prescribed flows."""
        missing, through = float(self.flow.sum()), float(np.abs(self.flow).sum())
        if self.normal_held.all() and abs(missing) > BALANCE * through:
            raise SolveError(
                f"the flows through the boundary do not balance: {missing:.6g} m³/s of {0.5 * through:.6g} m³/s goes "
                "out more than in, and no outlet is open to take it"
            )


def boundary_data(mesh: RZMesh, law: WallLaw, flow: float, along: Array) -> BoundaryData:
    """The law on the edges of a mesh, for a flow Φ [m³/s, positive downwards].

    Raises
    ------
    SolveError : no part of the outlet lies between the given radii
    """
    role = edge_roles(mesh, law)
    velocity, out = np.zeros((len(role), len(along), 2)), np.zeros(len(role))
    moving, inlet, outlet = (np.flatnonzero(role == name) for name in ("moving", "inlet", "outlet"))
    velocity[moving] = _wall_velocity(mesh, moving, law, flow, along)
    velocity[inlet], out[inlet] = outflow(mesh, inlet, -flow, EVERYWHERE, along)
    if len(outlet):
        velocity[outlet], out[outlet] = outflow(mesh, outlet, flow, law.outlet_radii, along)
    return BoundaryData(along, velocity, role != "open", ~np.isin(role, ["open", "axis", "slip"]), out)


def edge_roles(mesh: RZMesh, law: WallLaw) -> Names:
    """(k,) what each boundary edge does: axis, inlet, outlet, open, moving, slip or rest."""
    dr, dz = np.abs(np.diff(mesh.ends(), axis=1)[:, 0]).T
    wall = mesh.named("wall") & (dz > LEVEL * dr)
    known = [mesh.named(name) for name in ("axis", "inlet", "outlet")]
    outlet = "open" if law.outlet_profile == "developed" else "outlet"
    return np.select([*known, wall], ["axis", "inlet", outlet, law.walls], law.solids)


def _wall_velocity(mesh: RZMesh, edges: Index, law: WallLaw, flow: float, along: Array) -> Array:
    """(e, n, 2) the moving-wall law on some edges [m/s]; where Ω jumps, with the value on the edge's side."""
    (r0, z0), (r1, z1) = mesh.ends()[edges].transpose(1, 2, 0)[..., None]
    just_inside = np.clip(along, NUDGE, 1 - NUDGE)
    mean = -flow / mesh.free_area(z0 + (z1 - z0) * just_inside)
    slope = (r1 - r0) / (z1 - z0)
    sections = [name.partition(":")[2] for name in mesh.names[edges]]
    angles = np.arctan(np.abs(slope[:, 0]))
    sloping = np.array([_factor(law, name, angle) for name, angle in zip(sections, angles, strict=True)])
    w = np.where(np.abs(slope) < UPRIGHT, 1.0, sloping[:, None]) * mean
    return np.stack([w * slope, w], axis=2)


def _factor(law: WallLaw, section: str, half_angle: float) -> float:
    given = law.section_factors.get(section, law.wall_factor)
    return wall_factor_law().factor(half_angle, law.friction) if given is None else given


def outflow(mesh: RZMesh, edges: Index, out: float, radii: tuple[float, float], along: Array) -> tuple[Array, Array]:
    """Velocity (e, n, 2) and outward flow (e,) of level edges where the flow `out` leaves at one speed.

    It leaves between the two radii only; an edge that one of them cuts gets its share of the flow. SolveError where no
    part of the outlet lies between them.
    """
    radius = mesh.ends()[edges, :, 0]
    area = np.abs(mesh.measure.area(*np.clip(radius, *radii).T))
    if not area.sum() > 0:
        raise SolveError(f"no part of the outlet lies between the radii {radii[0]:g} and {radii[1]:g} m")
    place = radius[:, :1] * (1 - along) + radius[:, 1:] * along
    speed = np.abs(out) / area.sum() * ((place >= radii[0]) & (place <= radii[1]))
    return np.stack([np.zeros_like(speed), -speed], axis=2), out * area / area.sum()
