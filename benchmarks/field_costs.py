"""What each of `homogenize.fields` costs: CPU time per snapshot beside that of the averaging itself.

    python benchmarks/field_costs.py [particles]

A bed of overlapping spheres of two sizes in a cylinder moves on by a tenth of a diameter. What LIGGGHTS takes for the
steps between two snapshots is counted with `RATE` particle-steps per second on one core. What it takes to write the
contacts is not in the table.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import cKDTree

from granpipe.case.reader import load_case
from granpipe.dem.contacts import Contacts, read_pair_contacts
from granpipe.dem.settings import RATE
from granpipe.dem.sizes import size_classes
from granpipe.field import Grid
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Collector
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.stress import contact_stress
from granpipe.pipeline.extra_fields import ExtraSums

DIAMETER, RADII = 0.02, np.array([0.009, 0.011])
STEPS = {"smoke": 265, "reactor": 1499}
"""Case → time steps between two snapshots, as `granpipe plan` chooses them."""
REPEATS = 3


@dataclass
class Bed:
    """Particles as a snapshot has them."""

    id: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray


def bed(count: int) -> tuple[Bed, Outline, Grid]:
    """About so many spheres on a disturbed lattice in a cylinder twice as high as wide, 2 % overlap or so."""
    step = DIAMETER * 0.98
    width = (count / np.pi * 2) ** (1 / 3) * step / 2
    side = np.arange(-int(width / step) - 1, int(width / step) + 2)
    layers = np.arange(int(4 * width / step))
    place = np.array(np.meshgrid(side, side, layers)).reshape(3, -1).T * step
    place = place[np.hypot(*place[:, :2].T) < width - 0.5 * step]
    rng = np.random.default_rng(0)
    place += rng.normal(0, 0.02 * DIAMETER, place.shape)
    velocity = np.column_stack([rng.normal(0, 1e-3, (len(place), 2)), np.full(len(place), -0.02)])
    outline = Outline.of([(width, 4 * width), (width, 0.0)], {})
    grid = Grid.covering(width, 0.0, 4 * width, DIAMETER / 4)
    return Bed(np.arange(1, len(place) + 1), place, velocity, rng.choice(RADII, len(place))), outline, grid


def seconds(work: Callable[[], object]) -> float:
    """Least CPU time of some repeats, after one for the compiler [s]."""
    work()
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return min(times)


def pair_file(spheres: Bed, path: Path) -> int:
    """Write the touching pairs as LIGGGHTS dumps them; return their number."""
    pairs = cKDTree(spheres.position).query_pairs(2 * RADII.max(), output_type="ndarray")
    gap = np.linalg.norm(spheres.position[pairs[:, 0]] - spheres.position[pairs[:, 1]], axis=1)
    pairs = pairs[gap < spheres.radius[pairs].sum(axis=1)] + 1
    force = np.random.default_rng(1).normal(0, 1, (len(pairs), 3))
    head = f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ENTRIES\n{len(pairs)}\nITEM: BOX BOUNDS ff ff ff\n" + 3 * "-1 1\n"
    rows = "".join(f"{i} {j} {x:g} {y:g} {z:g} \n" for (i, j), (x, y, z) in zip(pairs, force, strict=True))
    path.write_text(f"{head}ITEM: ENTRIES c_pairs[1] c_pairs[2] c_pairs[4] c_pairs[5] c_pairs[6]\n{rows}")
    return len(pairs)


def main() -> None:
    """Print the table."""
    spheres, outline, grid = bed(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
    later = Bed(spheres.id, spheres.position + 0.1 * spheres.velocity, spheres.velocity, spheres.radius)
    case = load_case(Path(__file__).parents[1] / "cases" / "smoke.yaml")
    classes = size_classes(case.material.size)
    classes = type(classes)(RADII, np.array([0.5, 0.5]))

    def asking(*fields: str) -> ExtraSums:
        asked = case.model_copy(update={"homogenize": case.homogenize.model_copy(update={"fields": fields})})
        return ExtraSums(asked, outline, classes, grid)

    def averaged(*fields: str) -> None:
        collector = Collector(grid, "displacement", extras=asking(*fields).extras)
        collector.add(0.0, spheres)
        collector.add(0.1, later)

    count = len(spheres.id)
    base = seconds(averaged)
    costs = {name: seconds(lambda n=name: averaged(n)) - base for name in ("size_classes", "wall_slip")}
    costs |= {
        name: seconds(lambda n=name: asking(n).seen(spheres))
        for name in ("granular_temperature", "coordination", "mixing")
    }
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pairs.0.txt"
        pairs = pair_file(spheres, path)
        bins, none = Bins.of(grid, DIAMETER), Contacts(*np.zeros((3, 0, 3)))

        def stress() -> None:
            found = read_pair_contacts(path, spheres.id, spheres.position).within_friction(0.5)
            contact_stress(bins, found, none, spheres, 1000.0)

        costs["stress"] = seconds(stress)
        size = path.stat().st_size
    print(f"{count} particles, {pairs} contacts ({size / 1e6:.1f} MB a snapshot), grid {grid.shape}")
    runs = {name: steps * count / RATE for name, steps in STEPS.items()}
    print(
        f"| what | s a snapshot |{''.join(f' of a run like {name} |' for name in runs)}\n|---|---|{len(runs) * '---|'}"
    )
    for name, cost in {"averaging itself": base, **costs}.items():
        print(f"| {name} | {cost:.3f} |{''.join(f' {100 * cost / run:.1f} % |' for run in runs.values())}")


if __name__ == "__main__":
    main()
