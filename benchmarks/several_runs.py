"""Several cheap runs in place of one good one: the sum of their fields that should be nearest to the truth.

`STUDY --reference RESULTS`: of the points of a study, F = Σ wᵢ Fᵢ with Σ wᵢ = 1, where what their settings add and
their noise are expected to leave the least: Σ_j s_j² (Σᵢ wᵢ x_ij)² + Σᵢ wᵢ² σᵢ². x_ij says how far setting j of run i
is from that of the truth, s_j what the study says a unit of it adds, σᵢ is the run's own noise. The truth is an earlier
run, at its own size, plate speed and stiffness, or another point of the study; neither is ever in the sum.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.analysis.compare import error_squares
from granpipe.errors import RunError
from granpipe.field import Array
from granpipe.progress import Silent
from granpipe.study.findings import Comparison, StudyPoint, load_points
from granpipe.study.reference import read_run
from granpipe.study.slopes import middles
from granpipe.sweep.folder import Folder

SIZE, SPEED, STIFFNESS = "coarse_grain_factor", "plate_speed", "youngs_modulus"
AXES = (SIZE, SPEED, STIFFNESS)


@dataclass(frozen=True)
class Point:
    """A run: how far its settings are from none, its velocity (2, nz, nr), variance (nz, nr) and processor time [s]."""

    name: str
    settings: Array
    velocity: Array
    variance: Array
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path, help="folder of a study")
    parser.add_argument("--reference", type=Path, required=True, help="results of an earlier run")
    parser.add_argument("--truth", help="a point of the study to compare with, in place of the reference")
    parser.add_argument("--of", nargs="+", action="append", required=True, help="names of points that are summed")
    options = parser.parse_args()
    for row in rows(options.study, options.reference, options.truth, options.of):
        print(f"| {' | '.join(row)} |", flush=True)


def rows(study: Path, reference: Path, truth: str | None, sums: Sequence[Sequence[str]]) -> Iterator[list[str]]:
    """Runs, their processor time, expected error, error with the truth's noise taken off, and the sum's own noise."""
    found = [point for point in load_points(Folder(study), Silent()) if not point.too_short]
    comparison = Comparison(found[0].plan.case, found, read_run(reference))
    points = {one.name: point_of(one) for one in (*found, comparison.reference) if one.setting}
    against = points[truth or comparison.reference.name]
    added = what_is_added(comparison, found)
    weight = np.where(comparison.reference.field.bulk, comparison.reference.field.grid.ring_area, 0.0)
    size = (weight * (against.velocity**2).sum(axis=0)).sum()
    for names in sums:
        if against.name in names:
            raise RunError(f"{against.name} is the truth; it cannot be in the sum")
        some = [points[name] for name in names]
        noise = np.array([(weight * one.variance).sum() / size for one in some])
        apart = np.array([one.settings - against.settings for one in some]) * added
        expected = np.diag(noise) + apart @ apart.T
        parts = np.linalg.solve(expected, np.ones(len(some)))
        parts /= parts.sum()
        off = sum(part * one.velocity for part, one in zip(parts, some, strict=True)) - against.velocity
        left = (weight * (off**2).sum(axis=0)).sum() / size - (weight * against.variance).sum() / size
        yield [
            " + ".join(f"{part:.2f} {one.name}" for part, one in zip(parts, some, strict=True)),
            f"{sum(one.seconds for one in some) / 60:.1f} min",
            f"{np.sqrt(parts @ expected @ parts):.1%}",
            f"{np.sqrt(max(0.0, left)):.1%}",
            f"{np.sqrt(parts**2 @ noise):.1%}",
        ]


def point_of(one: StudyPoint) -> Point:
    """Plate speeds are counted by √(g d): what they add goes with the inertial number."""
    settings = np.array([one.setting[axis] for axis in AXES])
    settings[1] /= np.sqrt(one.diameter)
    return Point(one.name, settings, middles(one.field), error_squares(one.field), one.seconds)


def what_is_added(comparison: Comparison, found: Sequence[StudyPoint]) -> Array:
    """(axes,) of each setting, a unit of it: E of what the study says that the settings of its case add."""
    base = found[0]
    parts = comparison.effect(base, {}).contributions
    above = point_of(base).settings.copy()
    above[0] -= comparison.reference.setting[SIZE]
    if missing := [axis for axis, height in zip(AXES, above, strict=True) if axis not in parts or height <= 0]:
        raise RunError(f"the study does not tell what {', '.join(missing)} adds to its case")
    return np.array([parts[axis]["whole"].value for axis in AXES]) / above


if __name__ == "__main__":
    main()
