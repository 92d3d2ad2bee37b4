"""Stiff and extreme vessels for the frictional fluid: which converge, in how many steps, and what is refused.

`python benchmarks/friction_extremes.py` writes docs/validation/friction_extremes.md. The vessel is a bin above a hopper
of a half-angle with a pipe below it; ℓ is 0.65 d with 10 d across the outlet. A row is repeated with twice the
regularization and with elements half as wide: changes of the stream function above 2 % are marked.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from granpipe.errors import GranpipeError
from granpipe.field import Array
from granpipe.fluid.fictitious import FluidSolution
from granpipe.fluid.friction_law import LENGTH, FrictionLaw
from granpipe.fluid.frictional import FrictionSolution
from granpipe.fluid.frictional_vessel import Outlet, solve_frictional
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.gates import REGULARIZATION, TENSION

OUT = Path(__file__).resolve().parent.parent / "docs" / "validation" / "friction_extremes.md"


@dataclass(frozen=True)
class Extreme:
    """Half-angle [°], outlet radius over that of the bin, bulk and wall friction, diameter of the bin [m]."""

    what: str
    angle: float = 30.0
    outlet: float = 0.5
    internal: float = 0.45
    wall: float = 0.3
    diameter: float = 1.0

    def solve(self, regularization: float, cells: float) -> tuple[FluidSolution, FrictionSolution]:
        r = 0.5 * self.diameter
        a = self.outlet * r
        height = (r - a) / np.tan(np.radians(self.angle)) if self.angle < 90 else 0.0
        corners = [[r, height + 2 * r], [r, height], [a, 0.0], [a, -a]]
        mesh = mesh_section(np.array(corners), {}, {}, cells_across=cells, corner_refinement=3)
        law = FrictionLaw(self.internal, self.wall, LENGTH * a / 5, regularization)
        return solve_frictional(mesh, law, 1.0, Outlet())

    def profile(self, found: FluidSolution) -> Array:
        """ψ over the flow on a grid within the bin and the hopper's core."""
        r = np.linspace(0, 0.98, 30) * 0.5 * self.diameter / found.length
        z = np.linspace(0.05, 1.5, 30) * 0.5 * self.diameter / found.length
        return np.asarray(2 * np.pi * found.stream.psi_at(r, z))


CASES = [
    Extreme("half-angle 1°", angle=1.0, outlet=0.9),
    *(Extreme(f"half-angle {angle:g}°", angle=angle) for angle in (10, 60, 80, 89)),
    Extreme("flat bottom", angle=90.0),
    *(Extreme(f"bulk friction {mu:g}, the walls as rough", internal=mu, wall=mu) for mu in (0.05, 0.2, 0.6, 0.8, 1.2)),
    *(Extreme(f"bulk friction {mu:g}, wall 0.3", internal=mu) for mu in (0.8, 1.2)),
    Extreme("wall friction 0.05", wall=0.05),
    *(Extreme(f"area ratio {ratio:g}", outlet=ratio**0.5) for ratio in (1e-2, 1e-3, 1e-4)),
    *(Extreme(f"bin {diameter:g} m wide", diameter=diameter) for diameter in (1e-3, 1e2)),
]


def row(case: Extreme) -> str:
    started = time.process_time()
    try:
        found, steps = case.solve(FrictionLaw.regularization, 14)
    except GranpipeError as error:
        return f"| {case.what} | refused | | | | | {str(error).split(';')[0]} |"
    seconds = time.process_time() - started
    base = case.profile(found)

    def change(regularization: float, cells: float) -> float:
        try:
            other = case.profile(case.solve(regularization, cells)[0])
        except GranpipeError:
            return float("inf")  # refused, and so marked
        return float(np.linalg.norm(other - base) / np.linalg.norm(base))

    twice, finer = change(2 * FrictionLaw.regularization, 14), change(FrictionLaw.regularization, 28)
    marks = [str(gate) for gate in (TENSION.gate(steps.tension), REGULARIZATION.gate(twice)) if not gate.passed]
    cells = [case.what, "marked" if marks else "converged", str(steps.steps), f"{seconds:.1f}"]
    cells += [f"{twice:.2%}", f"{finer:.2%}", "; ".join(marks) or ("mesh: more than 2 %" if finer > 0.02 else "")]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    lines = [
        "# The frictional fluid in extreme vessels",
        "",
        f"Made by `benchmarks/friction_extremes.py` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        "A bin above a hopper of half-angle 30° with an outlet of half its width, μ_i 0.45, μ_w 0.3, 10 d across the",
        "outlet, unless the row says otherwise. Steps of the fixed point and seconds of one core; change of the stream",
        "function with twice the regularization and with elements half as wide.",
        "",
        "| vessel | result | steps | s | 2 ε | half the elements | why |",
        "|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        lines.append(row(case))
        print(lines[-1], flush=True)
    OUT.write_text("\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
