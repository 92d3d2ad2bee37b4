"""Dumps of an analytic flow: spheres that move along a known stream function.

The vessel is a straight cylinder of radius `upper_radius`, a cone, and a cylinder of radius `lower_radius`, joined by
a cosine, so that the wall is smooth. In every level the stream function is ψ = −Q/2π · r²/R(z)² · (1 + p(1 − r²/R²)),
Q the solids flow and p the peak of the profile (p = 0: the same velocity over the whole level). Spheres are spread
at the packing asked for, overlapping each other: the deposit does not mind.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLUMNS = ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")


@dataclass(frozen=True)
class ConvergingFlow:
    """Steady flow through a converging vessel between z = 0 and `height` [m].

    Parameters
    ----------
    solids_flow : Q, solids through every level, downwards [m³/s]
    packing : solids fraction
    peak : p, excess of the axis velocity over the mean (0: uniform, 1: parabola that falls to 0 at the wall)
    """

    height: float = 1.0
    upper_radius: float = 0.5
    lower_radius: float = 0.25
    cone_top: float = 0.7
    cone_bottom: float = 0.3
    solids_flow: float = 0.01
    packing: float = 0.58
    peak: float = 0.0

    def wall(self, z: Array) -> tuple[Array, Array]:
        """Radius R of the vessel [m] and its slope dR/dz at heights z [m]."""
        span = self.cone_top - self.cone_bottom
        phase = np.pi * np.clip((np.asarray(z) - self.cone_bottom) / span, 0, 1)
        rise = 0.5 * (self.upper_radius - self.lower_radius)
        return self.lower_radius + rise * (1 - np.cos(phase)), rise * np.pi / span * np.sin(phase)

    def psi(self, r: Array, z: Array) -> Array:
        """Stream function of the solids flux [m³/s per radian]; constant outside the wall."""
        x = np.minimum((r / self.wall(z)[0]) ** 2, 1)
        return -self.solids_flow / (2 * np.pi) * x * (1 + self.peak * (1 - x))

    def particle_velocity(self, r: Array, z: Array) -> tuple[Array, Array]:
        """Radial and vertical velocity of the solids [m/s]: u = −(1/r)∂ψ/∂z /φ, w = (1/r)∂ψ/∂r /φ."""
        radius, slope = self.wall(z)
        x = (r / radius) ** 2
        w = -self.solids_flow / (np.pi * radius**2 * self.packing) * (1 + self.peak * (1 - 2 * x))
        return w * r / radius * slope, w  # dψ/dz = −(2 r²/R³) R' dψ/dx

    def flux(self, r_edges: Array, z_edges: Array) -> tuple[Array, Array]:
        """Exact mean flux through the faces of a grid: (nz, nr+1) and (nz+1, nr) [m/s], from differences of ψ."""
        psi = self.psi(r_edges[None, :], z_edges[:, None])
        flux_r = np.zeros((len(z_edges) - 1, len(r_edges)))
        flux_r[:, 1:] = -np.diff(psi, axis=0)[:, 1:] / (r_edges[1:] * np.diff(z_edges)[:, None])
        return flux_r, 2 * np.diff(psi, axis=1) / np.diff(r_edges**2)

    def smeared_flux(self, r_edges: Array, z_edges: Array, radius: float, samples: int = 2000) -> tuple[Array, Array]:
        """Exact mean of the faces' flux carried by spheres of one radius [m], their centres spread over the vessel.

        The flux at a point is that of all centres within a radius of it: an average over the ball, in which what lies
        outside the vessel moves nothing. Balls are sampled at the same quasi-random offsets for all faces, at Gauss
        points of the faces. The vessel goes on straight below z = 0 and above `height`.
        """
        from scipy.stats import qmc  # imported late: it takes a second, and the stand-in for LIGGGHTS needs none of it

        draws = qmc.Sobol(3, rng=1).random(samples)
        distance = radius * np.cbrt(draws[:, 0])
        cosine = 2 * draws[:, 1] - 1
        level = distance * np.sqrt(1 - cosine**2)
        offsets = np.column_stack(
            [level * np.cos(2 * np.pi * draws[:, 2]), level * np.sin(2 * np.pi * draws[:, 2]), distance * cosine]
        )
        node, weight = np.polynomial.legendre.leggauss(3)
        flux_r = np.zeros((len(z_edges) - 1, len(r_edges)))
        flux_z = np.zeros((len(z_edges), len(r_edges) - 1))
        middle, half = 0.5 * (z_edges[1:] + z_edges[:-1]), 0.5 * np.diff(z_edges)
        square, half_square = 0.5 * (r_edges[1:] ** 2 + r_edges[:-1] ** 2), 0.5 * np.diff(r_edges**2)
        for x, share in zip(node, 0.5 * weight, strict=True):
            z_points, r_points = (middle + x * half)[:, None], np.sqrt(square + x * half_square)[None]
            for dx, dy, dz in offsets:
                flux_r += share / samples * self._centre_flux(r_edges[None] + dx, dy, z_points + dz)[0]
                flux_z += share / samples * self._centre_flux(r_points + dx, dy, z_edges[:, None] + dz)[1]
        return flux_r, flux_z

    def _centre_flux(self, x: Array, y: float, z: Array) -> tuple[Array, Array]:
        """Flux along x and z of the solids centred at (x, y, z); 0 outside the vessel."""
        r = np.hypot(x, y)
        u, w = self.particle_velocity(r, z)
        inside = (r < self.wall(z)[0]) * self.packing
        return inside * u * x / np.maximum(r, 1e-30), inside * w

    def particles(self, rng: np.random.Generator, radii: Array) -> tuple[Array, Array, Array]:
        """Spheres with centres spread over the vessel, extended straight beyond both ends, at the wanted packing.

        Parameters
        ----------
        radii : (k,) radii [m] to draw from, with equal probability

        Returns
        -------
        position (n, 3), velocity (n, 3), radius (n,)
        """
        from scipy.stats import qmc

        largest = float(np.max(radii))
        spread = 0.5 * largest  # of a normal shift: disorder among neighbours, evenness beyond, as in a packing
        low, high, reach = -largest - 4 * spread, self.height + largest + 4 * spread, self.upper_radius + 4 * spread
        density = self.packing / float(np.mean(4 / 3 * np.pi * radii**3))
        draws = 2 ** int(np.ceil(np.log2(density * np.pi * reach**2 * (high - low))))
        x, y, level = qmc.Sobol(3, rng=rng).random(draws).T
        angle = 2 * np.pi * y
        place = np.column_stack([reach * np.sqrt(x) * np.cos(angle), reach * np.sqrt(x) * np.sin(angle), level])
        place[:, 2] = low + level * draws / (density * np.pi * reach**2)
        place += rng.normal(0, spread, place.shape)
        r, z = np.hypot(place[:, 0], place[:, 1]), place[:, 2]
        inside = (z > -largest) & (z < self.height + largest) & (r < self.wall(z)[0])
        angle = np.arctan2(place[inside, 1], place[inside, 0])
        return self._moving(angle, r[inside], z[inside], rng.choice(radii, int(inside.sum())))

    def _moving(self, angle: Array, r: Array, z: Array, radius: Array) -> tuple[Array, Array, Array]:
        u, w = self.particle_velocity(r, z)
        position = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
        velocity = np.column_stack([u * np.cos(angle), u * np.sin(angle), w])
        return position, velocity, radius

    def travelled(self, position: Array, time: float, steps: int = 2) -> tuple[Array, Array]:
        """Positions after `time` [s] along the flow (Runge–Kutta 4), and the velocity there; both (n, 3)."""

        def velocity(at: Array) -> Array:
            r = np.hypot(at[:, 0], at[:, 1])
            u, w = self.particle_velocity(r, at[:, 2])
            return np.column_stack([at[:, :2] * (u / np.maximum(r, 1e-30))[:, None], w])

        dt = time / steps
        for _ in range(steps):
            k1 = velocity(position)
            k2 = velocity(position + 0.5 * dt * k1)
            k3 = velocity(position + 0.5 * dt * k2)
            k4 = velocity(position + dt * k3)
            position = position + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return position, velocity(position)


def snapshots(
    flow: ConvergingFlow, radii: Array, interval: float, count: int, seed: int
) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield (number, position, velocity, radius) of one steady flow at equal intervals [s], with fresh feed above.

    Numbers follow a particle through the vessel. The feed is placed in a reservoir, once, as far up as the
    flow reaches in the whole time; what has left below is dropped once it can touch z = 0 no more on a path between
    two snapshots.
    """
    rng = np.random.default_rng(seed)
    margin = float(np.max(radii))
    speed = flow.solids_flow / (np.pi * flow.upper_radius**2 * flow.packing) * (1 + flow.peak)
    tall = ConvergingFlow(**{**flow.__dict__, "height": flow.height + speed * interval * count + margin})
    drop_below = -margin - speed * (flow.upper_radius / flow.lower_radius) ** 2 * interval
    position, velocity, radius = tall.particles(rng, radii)
    number = np.arange(1, len(position) + 1)
    for _ in range(count):
        yield number, position, velocity, radius
        position, velocity = flow.travelled(position, interval)
        kept = position[:, 2] > drop_below
        number, position, velocity, radius = number[kept], position[kept], velocity[kept], radius[kept]


def binary_snapshot(step: int, box: Array, values: Array, chunks: int = 1) -> bytes:
    """One snapshot as LIGGGHTS writes it; rows are dealt to `chunks` ranks."""
    parts = np.array_split(np.asarray(values, dtype="<f8"), chunks)
    head = struct.pack("<qqi6i6dii", step, len(values), 0, *([1] * 6), *np.ravel(box), values.shape[1], chunks)
    return head + b"".join(struct.pack("<i", part.size) + part.tobytes() for part in parts)


def text_snapshot(step: int, box: Array, values: Array, columns: tuple[str, ...] = COLUMNS) -> bytes:
    """One snapshot as LAMMPS text with six digits, as LIGGGHTS writes it."""
    bounds = "\n".join(f"{low:g} {high:g}" for low, high in box)
    rows = "".join(" ".join(f"{value:g}" for value in row) + " \n" for row in values)
    head = f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(values)}\nITEM: BOX BOUNDS ff ff ff\n{bounds}\n"
    return f"{head}ITEM: ATOMS {' '.join(columns)} \n{rows}".encode()


def table(number: Array, position: Array, velocity: Array, radius: Array) -> Array:
    """(n, 9) the columns of granpipe's own dumps."""
    return np.column_stack([number, np.ones(len(number)), position, velocity, radius])


def write_dumps(
    folder: Path, flow: ConvergingFlow, radii: Array, interval: float, count: int, seed: int = 1, stride: int = 1000
) -> list[Path]:
    """Write `count` binary snapshots `interval` [s] and `stride` steps apart, one file each, named by their step."""
    side = flow.upper_radius + 2 * float(np.max(radii))
    box = np.array([[-side, side], [-side, side], [-flow.height, 10 * flow.height]])
    paths = []
    for index, particles in enumerate(snapshots(flow, radii, interval, count, seed)):
        path = folder / f"flow.{index * stride}.bin"
        path.write_bytes(binary_snapshot(index * stride, box, table(*particles)))
        paths.append(path)
    return paths
