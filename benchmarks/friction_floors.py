"""The frictional fluid above flat bottoms: its choices changed one by one, its mesh, and whether DEM was steady.

`law` prints the errors of some references (benchmarks/references/friction) with one choice changed; `mesh`
what coarser and finer meshes change. `steady` takes the folder of a production in the store of a DEM run and prints its
profiles over six parts of the run. `run` takes a folder and runs flat-10 in it with a faster start that takes away the
whole content (an interrupted run goes on); `funnel` packs the reference flat-10-funnel from its production: from half
the content on, where the funnel stands.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml
from friction_fluid import HERE, Reference, load, save_reference
from friction_scenes import VESSELS

from granpipe.analysis.compare import compare
from granpipe.errors import GranpipeError
from granpipe.field import Array, Field, flux_from_psi
from granpipe.fluid import frictional
from granpipe.fluid.friction_law import FrictionLaw
from granpipe.fluid.frictional_vessel import Outlet
from granpipe.pipeline import frictional_field
from granpipe.planning.bulk_friction import bulk_friction

SCENES = ("flat-10", "flat-10-funnel", "flat_bottom", "cone-26_6-0_3-10-0_5-0_1")
MESHED = (
    *("flat-10", "cone-26_6-0_3-14-0_5-0_1", "cone-15-0_1-10-0_5-0_1", "reactor", "axis_cone", "free_ring"),
    "ledged_bulge",
)
HEIGHTS = (0.1, 0.25, 0.4, 0.6, 0.8, 0.97)  # parts of the height of the grid
PARTS = 6
EDGE = 5  # cells at the wall
START = 1.25  # contents that the faster start of `run` takes away
SLOW = 0.5  # shear and sliding slower than this, in units of U/R and U, have more friction in one of the variants


@dataclass(frozen=True)
class Variant:
    """What is changed; lengths ℓ in d, the reservoir in radii of the inlet, `slow` relative."""

    internal: float | None = None
    wall: float | None = None
    regularization: float = FrictionLaw.regularization
    absolute: bool = False
    length: float = frictional_field.LENGTH
    reservoir: float = frictional_field.RESERVOIR
    cells: float = frictional_field.CELLS_ACROSS
    outlet: bool = False
    packing: bool = True
    slow: float = 0.0


VARIANTS = {
    "as it is": Variant(),
    "μ_i 0.38, μ_w 0.3": Variant(0.38, 0.3),
    "μ_w 0.4": Variant(wall=0.4),
    "μ_i, μ_w 0.6": Variant(0.6, 0.6),
    "ε 0.01": Variant(regularization=0.01),
    "ε 0.1": Variant(regularization=0.1),
    "ε absolute": Variant(absolute=True),
    "ℓ 0.01 d": Variant(length=0.01),
    "ℓ 0.3 d": Variant(length=0.3),
    "ℓ 1.3 d": Variant(length=1.3),
    "reservoir 0.5 R": Variant(reservoir=0.5),
    "reservoir 0.1 R": Variant(reservoir=0.1),
    "28 triangles": Variant(cells=28.0),
    "open outlet": Variant(outlet=True),
    "no wall packing": Variant(packing=False),
    "slow: half as much again": Variant(slow=0.5),
}


@contextmanager
def changed(variant: Variant) -> Iterator[None]:
    """The fluid with a variant's choices."""
    viscosity, drag = FrictionLaw.viscosity, FrictionLaw.drag

    def slow_viscosity(law: FrictionLaw, pressure: Array, spread: Array, rate: Array, radius: Array) -> Array:
        return viscosity(law, pressure, spread, rate, radius) * (1 + variant.slow / (1 + (spread / (SLOW * rate)) ** 2))

    def slow_drag(law: FrictionLaw, pressure: Array, slip: Array, speed: Array, radius: Array) -> Array:
        return drag(law, pressure, slip, speed, radius) * (1 + variant.slow / (1 + (slip / (SLOW * speed)) ** 2))

    with ExitStack() as stack:
        for name, value in (("LENGTH", variant.length), ("RESERVOIR", variant.reservoir)):
            stack.enter_context(patch.object(frictional_field, name, value))
        if variant.absolute:  # in units of the plate's speed over the outlet's radius
            plate = lambda levels, z: np.full_like(z, levels.flow / np.pi)  # noqa: E731
            stack.enter_context(patch.object(frictional._Levels, "rate", plate))
        if variant.outlet:
            stack.enter_context(patch.object(frictional_field, "_outlet", lambda plan: Outlet("open")))
        if not variant.packing:
            stack.enter_context(patch.object(frictional_field, "packed_along_walls", lambda field, *rest: field))
        if variant.slow:
            stack.enter_context(patch.object(FrictionLaw, "viscosity", slow_viscosity))
            stack.enter_context(patch.object(FrictionLaw, "drag", slow_drag))
        yield


def law() -> None:
    for name in SCENES:
        reference = load(HERE / "references" / "friction", name)
        plan = reference.plan
        own = bulk_friction(plan.case)
        for title, variant in VARIANTS.items():
            internal, wall = variant.internal or own.internal, variant.wall or own.wall
            friction = replace(own, internal=internal, wall=min(wall, internal))
            try:
                with changed(variant):
                    solved = frictional_field.solve_plan(
                        plan, friction, reference.field.bulk_packing, variant.regularization, variant.cells
                    )
            except GranpipeError as error:
                print(f"{name:<26}{title:<26} {error}")
                continue
            found = compare(reference.field, solved.field, plan.case.outline.levels, 1.0)
            errors = {one.name: np.sqrt(max(one.observed**2 - reference.noise[one.name] ** 2, 0)) for one in found}
            print(
                f"{name:<26}{title:<26}", ", ".join(f"{key} {value:.1%}" for key, value in errors.items()), flush=True
            )


def mesh() -> None:
    for name in MESHED:
        reference = load(HERE / "references" / "friction", name)
        friction, packing = bulk_friction(reference.plan.case), reference.field.bulk_packing
        made = {
            n: frictional_field.solve_plan(reference.plan, friction, packing, cells_across=n).field
            for n in (10, 14, 28)
        }
        coarse, fine = (compare(made[14], made[n], {}, 1.0)[0].observed for n in (10, 28))
        print(f"{name:<26} 10 triangles {coarse:.1%}, 28 triangles {fine:.1%}", flush=True)


def steady(folder: Path) -> None:
    segments = [np.load(path) for path in sorted(folder.glob("segment-*/sums.npz"))]
    r = segments[0]["r_edges"]
    area, levels = np.pi * (r[1:] ** 2 - r[:-1] ** 2), len(segments[0]["z_edges"]) - 1
    print(f"{'height':<8}{'from s':>8}{'to s':>8}{'middle':>8}{'wall':>8}   (speeds over the mean)")
    for height in HEIGHTS:
        for part in np.array_split(np.arange(len(segments)), PARTS):
            flow = sum(segments[i]["flow_z"][int(height * levels)] for i in part)
            mean = flow.sum() / area.sum()
            middle, wall = (flow[cut].sum() / area[cut].sum() / mean for cut in (slice(EDGE), slice(-EDGE, None)))
            begin, end = float(segments[part[0]]["start"]), float(segments[part[-1]]["stop"])
            print(f"{height:<8.2f}{begin:>8.2f}{end:>8.2f}{middle:>8.2f}{wall:>8.2f}")


def run(folder: Path) -> None:
    """flat-10 with a start as long as its content: how far a funnel has formed is a matter of travel, not of time."""
    from granpipe.cli import main as granpipe
    from granpipe.dem import duration, settings

    case = next(vessel for vessel in VESSELS if vessel.name == "flat-10")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "flat-10.yaml").write_text(replace(case, time=9.0).text())
    changes = {"START_TURNOVER": START, "LEAST_TURNOVER": START + 0.5, "ROOM": 1.5}
    with ExitStack() as stack:
        for name, value in changes.items():
            stack.enter_context(patch.object(duration, name, value))
        stack.enter_context(patch.object(settings, "START_TURNOVER", START))
        granpipe(["run", str(folder / "flat-10.yaml"), "--results", str(folder)])


def funnel(folder: Path) -> None:
    """The second half of the segments of the start so far; half the difference of its own halves is its noise."""
    references = HERE / "references" / "friction"
    reference = load(references, "flat-10")
    segments = [np.load(path) for path in sorted(folder.glob("segment-*/sums.npz"))]
    half, end = len(segments) // 2, len(segments)
    first, second, whole = (
        _averaged(reference, segments[low:high])
        for low, high in ((half, (half + end) // 2), ((half + end) // 2, end), (half, end))
    )
    apart = {one.name: one.observed / 2 for one in compare(first, second, reference.plan.case.outline.levels, 1.0)}
    print(
        f"from {segments[half]['start']:.2f} to {segments[-1]['stop']:.2f} s; halves differ by {2 * apart['whole']:.1%}"
    )
    save_reference(references / "flat-10-funnel", whole, apart)
    case = yaml.safe_load((references / "flat-10.yaml").read_text()) | {"name": "flat-10-funnel"}
    (references / "flat-10-funnel.yaml").write_text(yaml.safe_dump(case, sort_keys=False))


def _averaged(reference: Reference, segments: list[Any]) -> Field:
    """The average flow through each level, scaled to the flow of the reference."""
    field = reference.field
    flow = sum(one["flow_z"] for one in segments)
    part = np.concatenate([np.zeros((len(flow), 1)), np.cumsum(flow, axis=1)], axis=1)
    psi = part / -part[:, -1:] * field.bulk_flow * field.bulk_packing / (2 * np.pi)
    flux_r, flux_z = flux_from_psi(psi, field.grid)
    return replace(field, flux_r=flux_r, flux_z=flux_z, psi=psi)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["law", "mesh", "steady", "run", "funnel"])
    parser.add_argument(
        "folder", type=Path, nargs="?", help="steady, funnel: a folder produce-… of the store; run: a folder"
    )
    options = parser.parse_args()
    if options.what in ("law", "mesh"):
        {"law": law, "mesh": mesh}[options.what]()
    elif options.folder is None:
        parser.error(f"{options.what} needs a folder")
    else:
        {"steady": steady, "run": run, "funnel": funnel}[options.what](options.folder)


if __name__ == "__main__":
    main()
