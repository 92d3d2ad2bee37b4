"""Flows that do not conserve, and what heat they make of nothing: for checks of fields by `granpipe.analysis.heat`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from granpipe.analysis.heat import Flow, RadialFlow, Space, bilinear
from granpipe.field import Array
from granpipe.rzmesh import RZMesh


@dataclass(frozen=True)
class Velocity:
    """A flow given by its components, taken as they are at every point.

    Parameters
    ----------
    components : (u, w) as a function of r and z [m/s], for arrays of any one shape
    """

    components: Callable[[Array, Array], tuple[Array, Array]]

    @classmethod
    def on_grid(cls, r: Array, z: Array, u: Array, w: Array) -> Velocity:
        """From u and w (nz, nr) on nodes, linear in r and in z between them."""
        radial, vertical = bilinear(r, z, u), bilinear(r, z, w)
        return cls(lambda r, z: (radial(r, z), vertical(r, z)))

    def at(self, basis: Any, mesh: RZMesh) -> RadialFlow:
        """(r u, r w) at the quadrature points of a scikit-fem basis on the mesh [m²/s]."""
        r, z = np.asarray(basis.global_coordinates())
        u, w = self.components(r, z)
        return r * u, r * w


def false_source(mesh: RZMesh, flow: Flow) -> tuple[float, float]:
    """Heat that a flow makes of nothing when all is at one temperature, over the heat that it carries in.

    Returns
    -------
    net : sum over the section: what leaves through the outlet beyond what came in through the inlet
    gross : sum of the absolute values, each point of the mesh with the elements round it
    """
    from skfem import LinearForm

    @LinearForm
    def within(v, at):  # type: ignore[no-untyped-def]
        return -(at.flux_r * v.grad[0] + at.flux_z * v.grad[1])

    @LinearForm
    def through(v, at):  # type: ignore[no-untyped-def]
        return v * (at.flux_r * at.n[0] + at.flux_z * at.n[1])

    space = Space(mesh)
    flux = dict(zip(("flux_r", "flux_z"), flow.at(space.basis, mesh), strict=True))
    source = within.assemble(space.basis, **flux)
    inflow = 0.0
    for name in ("inlet", "outlet"):
        edge = space.through(name)
        flux = dict(zip(("flux_r", "flux_z"), flow.at(edge, mesh), strict=True))
        passing = through.assemble(edge, **flux)
        source += passing
        inflow -= passing.sum() if name == "inlet" else 0.0
    return float(source.sum() / inflow), float(np.abs(source).sum() / inflow)
