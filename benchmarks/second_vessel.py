"""A silo with a cone on its axis: runs by granpipe's rules against the material's own particles on a slow plate.

`page --truth RESULTS RESULTS -- RESULTS …` takes the mean of the first for the truth, compares the others with it and
writes docs/validation/second_vessel.md. The page says how the runs were made.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from math import hypot
from pathlib import Path

from reactor_limit import differences, pack, result
from set_back import told

from granpipe.pipeline.averages import statistical_errors
from granpipe.study.reference import EarlierRun, read_run

HERE = Path(__file__).resolve().parent

HEAD = """\
# A second vessel: a silo with a cone on its axis

Made by `benchmarks/second_vessel.py` on {made}.

The settings that gave the [test reactor](reactor_limit.md) its field, in a vessel that they were not chosen for:
`cases/gallery/axis_cone.yaml` with the reactor's size distribution, its mean radius 6 mm. The truth has true masses, a
slow plate and stiff particles, in two fillings; the others are what `--total-error 10%` and `5%` make of the case
without a study of it, by the settings of the reactor's, in two other fillings.

```text
SIZE='material.size={{radius: {{normal: {{mean: 6 mm, std: 2 mm, min: 3 mm, max: 9 mm}}}}, by: number, classes: 6}}'
granpipe run cases/gallery/axis_cone.yaml --set "$SIZE" --set dem.ranks=1 --set name=cone_truth_seed1 \\
    --set dem.seed=1 --set dem.mass_scaling=none --set dem.plate_speed=0.012 --set contact.youngs_modulus=1e7 \\
    --set 'dem.max_time=16 s' --set 'dem.statistical_error=0.5 %'
granpipe run cases/gallery/axis_cone.yaml --set "$SIZE" --set dem.ranks=1 --set name=cone_total_10_seed2 \\
    --set dem.seed=2 --total-error 10%
```

Errors are as on the reactor's page: *beyond noise* with the noise of both taken off, ± its standard error, or “<” its
95 % bound where noise explains it; *in all* with the noise that the run told, and its 95 % bound.

**What it says** (runs of 2026-12-01). The promised total error held in all four, each by its 95 % bound, and so it did
in the reactor's study: with `--total-error 10%` 5.5 and 5.4 %, all noise counted (bounds 6.1 and 5.8), in 60 and 43 s;
with `5%` 3.2 and 3.0 % (3.7 and 3.4) in 3 min 10 s and 2 min 27 s. granpipe had said 8.1 and 8.0 % (at most 8.8 and
8.7), and 3.0 and 2.9 % (4.3 and 4.1). All pass all gates. The plate at 0.060 m/s of the first is farther from the
truth, which has 0.012 m/s, than that at 0.015 m/s of the others: what is beyond noise goes with it, and lies beside the
cone and above it. The particles are as large as the material's, for the gap beside the cone is narrower than the
reactor's throat. The truth has a speed, a softness and noise of its own.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["page"])
    parser.add_argument("--truth", nargs=2, type=Path, required=True, metavar="RESULTS")
    parser.add_argument("folders", nargs="+", type=Path, metavar="RESULTS")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "second_vessel.md")
    options = parser.parse_args()
    text = page(options.truth, options.folders)
    options.out.write_text(text)
    print(text)


def page(truths: Sequence[Path], folders: Sequence[Path]) -> str:
    """The page: the truth, its two fillings against each other, and all runs against their mean."""
    with tempfile.TemporaryDirectory() as scratch:
        pack(truths, Path(scratch) / "truth")
        truth, first = read_run(Path(scratch) / "truth"), read_run(truths[0])
        lines = [*described(truth), *rows(truth, folders), "", "The two fillings of the truth against each other:", ""]
        lines += rows(first, truths[1:])
    return "\n".join([HEAD.format(made=f"{datetime.now(UTC):%Y-%m-%d}"), *lines, ""])


def described(truth: EarlierRun) -> Iterator[str]:
    dem, levels = truth.plan.dem, truth.plan.case.outline.levels
    noise = ", ".join(f"{name} {100 * v:.1f}" for name, v in statistical_errors(truth.field, levels).items())
    yield (
        f"**The truth**: {dem.particles} particles of {1000 * dem.classes.sauter_diameter:.3g} mm (Sauter diameter), "
        f"plate {dem.plate_speed:.3g} m/s, E {dem.youngs_modulus:.2g} Pa; {truth.travel:.2f} m of plate travel in two "
        f"fillings. Its own statistical error, %: {noise}."
    )
    yield ""


def rows(truth: EarlierRun, folders: Sequence[Path]) -> Iterator[str]:
    """A table of runs against a truth, %."""
    sections = ["whole", *truth.plan.case.outline.levels]
    yield f"| beyond noise, % | {' | '.join(sections)} | told by the run, whole | in all | processor time |"
    yield "|---" * (len(sections) + 4) + "|"
    for folder in folders:
        run = result(folder, truth)
        found, noise = differences(truth, run), run.statistical["whole"]
        whole = found["whole"]
        total = f"{100 * hypot(noise, whole.noise_free):.1f} (< {100 * hypot(noise, whole.upper):.1f})"
        cells = " | ".join(told(found[name]) for name in sections)
        yield f"| {folder.name} | {cells} | {100 * noise:.1f} | {total} | {run.seconds} |"


if __name__ == "__main__":
    main()
