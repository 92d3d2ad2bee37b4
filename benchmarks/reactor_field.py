"""Surfaces and voids of a result: where the final field has them, and where the plain average of the same run has them.

Reads a results folder (method psi); writes docs/validation/reactor_field.md and its picture.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from methods import paper, plain
from scipy import ndimage

from granpipe.analysis.surfaces import bulk_edge, crossings, displacement, speed, stagnant_area, void_area
from granpipe.case.reader import load_case
from granpipe.field import Array, Field, Grid, Mask, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.smooth import flowing_faces, seen_packing

HERE = Path(__file__).resolve().parent
PACKINGS = (0.03, 0.1, 0.25, 0.5)  # of the reference packing
SPEEDS = (0.1, 0.25, 0.5, 1.0)  # of the mean over the widest level
NEAR = 2.0  # diameters from the edge of the bulk
RAW, PSI, SMOOTHED = "plain average", "ψ fit", "rows scaled, 2 Gaussian passes"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation")
    options = parser.parse_args()
    case, field = load_case(options.results / "case.yaml"), Field.load(options.results / "field.npz")
    outline = Outline.from_case(case)
    scene = Scene(case.name, outline, field, sauter_diameter(options.results / "plan.json"))
    picture(scene, options.out / "images" / "reactor_surfaces.png")
    text = page(scene)
    (options.out / "reactor_field.md").write_text(text)
    print(text)


def sauter_diameter(path: Path) -> float:
    dem = json.loads(path.read_text())["dem"]
    radius, share = np.array(dem["radii_m"]), np.array(dem["number_shares"])
    return float(2 * (share @ radius**3) / (share @ radius**2))


@dataclass(frozen=True)
class Scene:
    """A result, and what its plain average and the article's way would be."""

    name: str
    outline: Outline
    field: Field
    diameter: float

    @property
    def fields(self) -> dict[str, Field]:
        return {RAW: plain(self.field), PSI: self.field, SMOOTHED: paper(self.field, 2)}

    @property
    def surfaces(self) -> dict[str, tuple[float, float]]:
        """Lower and upper end [m] of the sections that hold a void of more than a particle's size."""
        ranges = {name: (section.z_bottom, section.z_top) for name, section in self.outline.sections.items()}
        return {name: ends for name, ends in ranges.items() if void_area(self.field, ends) > self.diameter**2}

    @property
    def inside(self) -> Mask:
        return np.asarray(self.field.inside_fraction > 1 - 1e-9)

    @property
    def packing(self) -> Array:
        field = self.field
        assert field.packing_fraction is not None
        volume = field.packing_fraction * field.inside_fraction * field.grid.cell_volume
        return seen_packing(volume, field.inside_fraction, field.grid, self.diameter)

    def packing_line(self, part: float) -> Array:
        return self.near(crossings(self.packing, part * self.field.bulk_packing, self.field.grid, self.inside))

    def speed_line(self, field: Field, part: float) -> Array:
        widest = float((field.inside_fraction @ field.grid.ring_area).max())
        mean = field.bulk_flow * field.flow_scale / widest
        return self.near(crossings(speed(field), part * mean, field.grid, self.inside))

    def near(self, points: Array) -> Array:
        """Those within two diameters of a void."""
        grid, void = self.field.grid, ~self.field.bulk & (self.field.inside_fraction > 0)
        rows = np.clip((points[:, 1] - grid.z_edges[0]) / grid.cell, 0, grid.shape[0] - 1).astype(int)
        columns = np.clip(points[:, 0] / grid.cell, 0, grid.shape[1] - 1).astype(int)
        to_void = ndimage.distance_transform_edt(~void) * grid.cell
        return points[to_void[rows, columns] < NEAR * self.diameter]

    def apart(self, one: Array, other: Array, ends: tuple[float, float]) -> float:
        """RMS distance of two lines within a section, both ways [d]."""
        own = [line[(line[:, 1] > ends[0]) & (line[:, 1] < ends[1])] for line in (one, other)]
        there, back = displacement(own[0], other), displacement(own[1], one)
        return float(np.sqrt(0.5 * (there**2 + back**2))) / self.diameter

    def edge_from(self, line: Array, ends: tuple[float, float]) -> float:
        """RMS distance from the edge of the bulk, within a section, to a line [d]."""
        edge = bulk_edge(self.field)
        return displacement(edge[(edge[:, 1] > ends[0]) & (edge[:, 1] < ends[1])], line) / self.diameter

    def void_flux(self, field: Field) -> float:
        """Mean |F| over the void cells, over the mean over the bulk."""
        volume = field.inside_fraction * field.grid.cell_volume
        void, bulk = volume * ~field.bulk, volume * field.bulk
        return float((speed(field) * void).sum() / void.sum() / ((speed(field) * bulk).sum() / bulk.sum()))

    def cut_off(self) -> tuple[float, float]:
        """Largest part of a level's flow in the plain average that passes where the bulk does not reach; its z [m]."""
        field, raw = self.field, self.fields[RAW]
        kept = raw.flux_z * flowing_faces(field.bulk, field.inside_fraction)[1]
        part = 1 - level_flow(kept, field.grid) / level_flow(raw.flux_z, field.grid)
        return float(part.max()), float(field.grid.z_edges[part.argmax()])


def picture(scene: Scene, path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fields, grid = scene.fields, scene.field.grid
    figure, axes = plt.subplots(2, len(scene.surfaces), figsize=(11, 9), layout="constrained", squeeze=False)
    for (packing, flow), (name, ends) in zip(axes.T, scene.surfaces.items(), strict=True):
        shown = shade(packing, grid, scene.packing, f"section {name}: plain packing", "cividis")
        dots(packing, scene.packing_line(0.5), "w", "half the reference packing")
        dots(packing, scene.packing_line(PACKINGS[0]), "c", f"{PACKINGS[0]:.0%} of it")
        dots(packing, bulk_edge(scene.field), "r", "edge of the bulk")
        moving = shade(
            flow, grid, speed(fields[RAW]), "plain average: speed; where it is a quarter of the mean", "viridis"
        )
        for colour, (method, field) in zip("wrm", fields.items(), strict=True):
            dots(flow, scene.speed_line(field, 0.25), colour, method)
        for axis in (packing, flow):
            voids = bulk_edge(scene.field)
            voids = voids[(voids[:, 1] > ends[0]) & (voids[:, 1] < ends[1])]
            margin = 3 * scene.diameter
            axis.set(
                xlim=(voids[:, 0].min() - margin, grid.r_edges[-1]),
                ylim=(voids[:, 1].min() - margin, voids[:, 1].max() + margin),
                aspect="equal",
            )
            axis.legend(fontsize=7, loc="upper right", facecolor="0.6")
    figure.colorbar(shown, ax=axes[0])
    figure.colorbar(moving, ax=axes[1], label="m/s")
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=90)


def shade(axis: Any, grid: Grid, values: Array, title: str, colours: str) -> Any:
    axis.set_title(title, fontsize=8)
    return axis.pcolormesh(grid.r_edges, grid.z_edges, values, cmap=colours)


def dots(axis: Any, points: Array, colour: str, label: str) -> None:
    axis.plot(*points.T, ".", color=colour, markersize=4, label=label)


def page(scene: Scene) -> str:
    fields, surfaces = scene.fields, scene.surfaces
    cut, level = scene.cut_off()
    lines = [
        "# Voids and surfaces in the field of the test reactor",
        "",
        f"Made by `benchmarks/reactor_field.py` on {datetime.now(UTC):%Y-%m-%d} from the results of",
        f"`cases/{scene.name}.yaml`; d is the Sauter diameter, {1000 * scene.diameter:.0f} mm, cells are",
        f"{1000 * scene.field.grid.cell:.0f} mm. Sections with a void: {', '.join(surfaces)}.",
        "",
        "## Flux in voids",
        "",
        "Mean speed over the cells that are not bulk, over the mean over the bulk.",
        "",
        "| | |",
        "|---|---|",
        *(f"| {name} | {100 * scene.void_flux(field):.2g} % |" for name, field in fields.items()),
        "",
        f"Of the plain average's flow through the worst level, z = {level:.2f} m, {100 * cut:.1f} % passes where the",
        "bulk does not reach.",
        "",
        "## How sharp the packing is",
        "",
        "RMS distance from the edge of the bulk to the line where the packing of the plain average, seen through a",
        "window half a particle wide, is a part of φ_ref. The surface moves, and the layer that slides down it is thin",
        "in solids: from next to nothing to half of φ_ref is most of a particle.",
        "",
        "| φ/φ_ref | " + " | ".join(f"section {name}" for name in surfaces) + " |",
        "|---" * (1 + len(surfaces)) + "|",
    ]
    for part in PACKINGS:
        line = scene.packing_line(part)
        lines.append(
            f"| {part:.0%} | " + " | ".join(f"{scene.edge_from(line, e):.2f} d" for e in surfaces.values()) + " |"
        )
    lines += [
        "",
        "## Where the flow ends",
        "",
        "RMS distance between the lines where the speed is a part of the mean over the widest level, within two",
        "diameters of a void: in the plain average, and in what a method makes of it.",
        "",
        "| speed / mean | "
        + " | ".join(f"{method}: section {name}" for method in (PSI, SMOOTHED) for name in surfaces)
        + " |",
        "|---" * (1 + 2 * len(surfaces)) + "|",
    ]
    for part in SPEEDS:
        own = scene.speed_line(fields[RAW], part)
        apart = [
            scene.apart(own, scene.speed_line(fields[method], part), ends)
            for method in (PSI, SMOOTHED)
            for ends in surfaces.values()
        ]
        lines.append(f"| {part:g} | " + " | ".join(f"{distance:.2f} d" for distance in apart) + " |")
    lines += [
        "",
        "## Areas in the r–z section",
        "",
        "Void; and at rest, slower than 2 % of that mean speed.",
        "",
        "| section | void [m²] | " + " | ".join(f"at rest, {name} [m²]" for name in fields) + " |",
        "|---" * (2 + len(fields)) + "|",
    ]
    for name, section in scene.outline.sections.items():
        ends = (section.z_bottom, section.z_top)
        rest = " | ".join(f"{stagnant_area(field, ends):.3f}" for field in fields.values())
        lines.append(f"| {name} | {void_area(scene.field, ends):.3f} | {rest} |")
    return "\n".join([*lines, "", "![Surfaces](images/reactor_surfaces.png)", ""])


if __name__ == "__main__":
    main()
