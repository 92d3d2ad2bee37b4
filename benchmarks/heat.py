"""Heat carried by the exported field through the vessel: what each way of using the files makes of it.

Reads the COMSOL files of a result folder as a user's program would; writes docs/validation/heat.md and its picture.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests"))
from fakes.comsol_text import read_sections  # noqa: E402
from heat_checks import Velocity, false_source  # noqa: E402
from methods import paper  # noqa: E402

from granpipe.analysis.heat import (  # noqa: E402
    HeatProblem,
    Stream,
    Temperature,
    solve_heat,
)
from granpipe.case.reader import load_case  # noqa: E402
from granpipe.export.comsol import write_comsol  # noqa: E402
from granpipe.export.exported import Exported  # noqa: E402
from granpipe.field import Array, Field  # noqa: E402
from granpipe.geometry.outline import Outline  # noqa: E402
from granpipe.geometry.section import mesh_section  # noqa: E402
from granpipe.rzmesh import RZMesh  # noqa: E402

Flow = Stream | Velocity

ON_MESH, AT_POINTS, LINEAR = "ψ on the mesh", "ψ, differentiated at points", "u, w, linear"
SCALED, PAPER = "rows scaled: u, w, linear", "rows scaled, smoothed: u, w, linear"
CELLS_ACROSS, CORNERS = 40, 4  # of the mesh; elements at corners are so much smaller
DEGREES = 1000.0  # K, of which a false source is told in kW


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="results folder of a case (method psi, export comsol)")
    parser.add_argument("--conductivity", type=float, default=1.0, help="of the bed [W/(m K)]")
    parser.add_argument("--specific-heat", type=float, default=1000.0, help="of the solids [J/(kg K)]")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation")
    options = parser.parse_args()
    case, field = load_case(options.results / "case.yaml"), Field.load(options.results / "field.npz")
    outline = Outline.from_case(case)
    capacity = case.material.density * field.bulk_packing * options.specific_heat
    scene = Scene(
        case.name, outline, field.bulk_flow * field.flow_scale, options.conductivity, capacity, options.specific_heat
    )
    mesh = scene.mesh(CELLS_ACROSS)
    flows = exported_flows(options.results / "comsol", field)
    rows = {name: scene.measure(mesh, flow) for name, flow in flows.items()}
    fine = solve_heat(scene.cold_feed(scene.mesh(2 * CELLS_ACROSS)), flows[ON_MESH]).outlet_mean
    picture(rows, options.out / "images" / "heat.png")
    text = page(scene, mesh, rows, fine)
    (options.out / "heat.md").write_text(text)
    print(text)


@dataclass(frozen=True)
class Row:
    """What one flow does: false source (net, gross), a feed of temperature 1, a cold feed between hot walls."""

    source: tuple[float, float]
    constant: Temperature
    heated: Temperature


@dataclass(frozen=True)
class Scene:
    """A vessel with a flow [m³/s] of a material that conducts [W/(m K)] and holds [J/(m³ K)] heat."""

    name: str
    outline: Outline
    flow: float
    conductivity: float
    capacity: float
    specific_heat: float

    def mesh(self, cells_across: int) -> RZMesh:
        sections = {name: (section.z_top, section.z_bottom) for name, section in self.outline.sections.items()}
        return mesh_section(
            self.outline.wall,
            self.outline.obstacles,
            sections,
            cells_across=cells_across,
            corner_refinement=CORNERS,
        )

    def constant(self, mesh: RZMesh) -> HeatProblem:
        return HeatProblem(mesh, self.conductivity, self.capacity, {"inlet": 1.0})

    def cold_feed(self, mesh: RZMesh) -> HeatProblem:
        hot = {"wall": 1.0} | ({"obstacle": 1.0} if self.outline.obstacles else {})
        return HeatProblem(mesh, self.conductivity, self.capacity, hot | {"inlet": 0.0})

    def measure(self, mesh: RZMesh, flow: Flow) -> Row:
        problems = (self.constant(mesh), self.cold_feed(mesh))
        return Row(false_source(mesh, flow), *(solve_heat(problem, flow) for problem in problems))

    @property
    def peclet(self) -> float:
        """w D/κ at the outlet."""
        radius = self.outline.outlet_radius
        return 2 * self.flow / (np.pi * radius) * self.capacity / self.conductivity


def exported_flows(folder: Path, field: Field) -> dict[str, Flow]:
    """By how they are used: the files of the result, and those that its plain average would have given."""
    r, z, psi = grid_file(folder / "psi_grid.txt")
    r = np.sqrt(r)
    flows: dict[str, Flow] = {
        ON_MESH: Stream.on_grid(r, z, psi),
        AT_POINTS: Velocity(derivatives(r, z, psi)),
        LINEAR: velocity_files(folder),
    }
    for name, passes in ((SCALED, 0), (PAPER, 2)):
        with tempfile.TemporaryDirectory() as other:
            write_comsol(Exported(paper(field, passes), "x", 1.0, datetime.now(UTC)), Path(other))
            flows[name] = velocity_files(Path(other))
    return flows


def grid_file(path: Path) -> tuple[Array, Array, Array]:
    sections = read_sections(path)
    first, second = map(np.array, sections["Grid"])
    return first, second, sections["Data"]


def velocity_files(folder: Path) -> Velocity:
    r, z, u = grid_file(folder / "u_grid.txt")
    return Velocity.on_grid(r, z, u, grid_file(folder / "w_grid.txt")[2])


def derivatives(r: Array, z: Array, psi: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
    """u and w as import_comsol.java makes them: ψ linear in r² and z, differentiated within its cell."""

    def components(at_r: Array, at_z: Array) -> tuple[Array, Array]:
        i = np.clip(np.searchsorted(r, at_r, side="right") - 1, 0, len(r) - 2)
        j = np.clip(np.searchsorted(z, at_z, side="right") - 1, 0, len(z) - 2)
        wide, high = r[i + 1] ** 2 - r[i] ** 2, z[j + 1] - z[j]
        across, up = (at_r**2 - r[i] ** 2) / wide, (at_z - z[j]) / high
        a, b, c, d = psi[j, i], psi[j, i + 1], psi[j + 1, i], psi[j + 1, i + 1]
        return (
            -((1 - across) * (c - a) + across * (d - b)) / high / at_r,
            2 * ((1 - up) * (b - a) + up * (d - c)) / wide,
        )

    return components


def picture(rows: dict[str, Row], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shown = [ON_MESH, AT_POINTS, LINEAR, SCALED]
    figure, axes = plt.subplots(2, len(shown), figsize=(8, 11), sharex=True, sharey=True, layout="constrained")
    best = rows[ON_MESH].heated
    mesh = best.mesh
    for column, name in zip(axes.T, shown, strict=True):
        row = rows[name]
        error = shade(column[0], mesh, row.constant.values - 1, f"{name}\nfeed at 1: error", 0.1)
        if name == ON_MESH:
            heat = column[1].tripcolor(*mesh.points.T, mesh.triangles, best.values, shading="gouraud", cmap="inferno")
            column[1].set_title("cold feed, hot walls", fontsize=8)
        else:
            shade(column[1], mesh, row.heated.values - best.values, "the same: difference", 0.1)
    figure.colorbar(error, ax=axes[0], extend="both", shrink=0.6)
    figure.colorbar(heat, ax=axes[1], shrink=0.6)
    for axis in axes[-1]:
        axis.set_xlabel("r [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("z [m]")
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=90)


def shade(axis: Any, mesh: RZMesh, values: Array, title: str, most: float) -> Any:
    axis.set_aspect("equal")
    axis.set_title(title, fontsize=8)
    return axis.tripcolor(
        *mesh.points.T, mesh.triangles, values, shading="gouraud", cmap="RdBu_r", vmin=-most, vmax=most
    )


def page(scene: Scene, mesh: RZMesh, rows: dict[str, Row], fine: float) -> str:
    per_degree = scene.capacity * scene.flow
    ones = Temperature(mesh, np.ones(len(mesh.points)), 1.0)
    lines = [
        "# Heat carried by the exported field",
        "",
        f"Made by `benchmarks/heat.py` on {datetime.now(UTC):%Y-%m-%d}, from the results of `cases/{scene.name}.yaml`.",
        "Steady heat in the r–z section, ∇·(ρc U T − k ∇T) = 0 in conservative form, by a finite-element solver that",
        "knows nothing of how the field was made (`granpipe/analysis/heat.py`; it is checked against closed forms in",
        "`tests/verification/test_study_heat.py`). It reads the text files as a user's program would. Bed and voids",
        f"conduct k = {scene.conductivity:g} W/(m K), the solids hold {scene.specific_heat:g} J/(kg K); the flow",
        f"carries {per_degree:.0f} W per kelvin, and w D ρc/k at the outlet is {scene.peclet:.0f}. The mesh has",
        f"{len(mesh.points)} points; nothing leaves through its walls.",
        "",
        "- *ψ on the mesh*: `psi_grid.txt` interpolated at the nodes of quadratic elements, walls at one value, then",
        "  differentiated.",
        "- *ψ, differentiated at points*: `psi_grid.txt`, linear in r² and z, differentiated wherever the solver asks.",
        "- *u, w, linear*: `u_grid.txt` and `w_grid.txt`.",
        "- *rows scaled*: the plain average of the same run, every level scaled to the same flow, exported as u and w;",
        "  *smoothed*: the same after two passes of the 5×5 Gaussian, as `method: gaussian` has it.",
        "",
        "## A feed at temperature 1, and nothing else",
        "",
        "The temperature should be 1 everywhere. The false source is what the flow makes of nothing when it is, point",
        "of the mesh by point, sources and sinks added without their signs, over the heat carried in; in kW at",
        f"{DEGREES:g} K. Where sources and sinks alternate from point to point, as with ψ differentiated at points,",
        "conduction evens them out: the errors of the temperature are what counts.",
        "",
        "| | largest error | at r, z [m] | RMS error | error at the outlet | false source | kW |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        rms, largest = row.constant.apart(ones)
        r, z = mesh.points[np.abs(row.constant.values - 1).argmax()]
        gross = row.source[1]
        lines.append(
            f"| {name} | {largest:.1e} | {r:.2f}, {z:.2f} | {rms:.1e} | {abs(row.constant.outlet_mean - 1):.1e} "
            f"| {percent(gross)} | {gross * per_degree * DEGREES / 1000:.0f} |"
        )
    lines += [
        "",
        "## A cold feed between hot walls",
        "",
        "Feed at 0, walls and obstacles at 1. What the others differ from *ψ on the mesh*, over the volume:",
        "",
        "| | outlet mean | difference there | RMS difference | largest | range |",
        "|---|---|---|---|---|---|",
    ]
    best = rows[ON_MESH].heated
    for name, row in rows.items():
        rms, largest = row.heated.apart(best)
        values = row.heated.values
        lines.append(
            f"| {name} | {row.heated.outlet_mean:.4f} | {row.heated.outlet_mean - best.outlet_mean:+.4f} | {rms:.4f} "
            f"| {largest:.3f} | {values.min():.3f} … {values.max():.3f} |"
        )
    return "\n".join(
        [
            *lines,
            "",
            f"With elements half as large, *ψ on the mesh* gives {fine:.4f} at the outlet.",
            "",
            "![Temperatures](images/heat.png)",
            "",
            "What this means for the set-up of a model: [comsol.md](../how-to/comsol.md).",
            "",
        ]
    )


def percent(part: float) -> str:
    return f"{100 * part:.0e} %" if part < 1e-4 else f"{100 * part:.1f} %"


if __name__ == "__main__":
    main()
