"""Writes docs/study.md and its charts from the folder of a study: how to read one, and what that one found.

`make study` makes the study of the smoke scene; `benchmarks/study.py results/smoke-study` the page.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

HERE = Path(__file__).resolve().parent
HEAD = """\
# Error against run time

`granpipe study CASE` runs cheaper and dearer variants of a case, one setting at a time, and tells what each costs in
accuracy and in time. `--hours` limits the wall time by the plans' forecasts (the dearest points are dropped and
named), `--axis` chooses settings, `--on slurm` runs the points on a cluster, `--against CASE` forecasts the time of
another case at the measured rate. What is done is not repeated; but a point with finer particles makes the common
grid finer, and then production starts anew. Everything goes to `results/<case>-study`: `report.html`, charts,
`options.csv`, `points.csv`, `study.json`.

`granpipe run CASE --total-error 5%` takes the cheapest setting of the case's study whose error is at most that; it
says what it expects and, afterwards, what it got.

## How to read it

- A **point** is one DEM run (or a hybrid, or a fluid). All points have one grid, as fine as the smallest particles
  need it: deposits are exact on any cell, so fields of different particles are compared face by face.
- An **option** is a point, a method, and a length of its average. Shorter averages, larger cells and other methods
  are made from the same segments without running anything. Their time is that of the stages up to there, as measured
  when they ran; replicas count for as many cores as they are.
- **Statistical** is the standard error of the option's own average, **systematic** the difference of the point's
  whole average from the reference (finest particles, then slowest plate, then longest run), the noise of both taken
  off. Their squares add to the error. The 95 % bound includes how well either is known; by it an error is *proven*.
- **Unresolved** is what is smaller than its own uncertainty: the bound alone is stated.
- The **budget** goes on to the limit of each axis: the material's own size, no speed, no softness, no step. Along an
  axis the field is F₀ + c xᵖ, c fitted face by face, p of first order with two points, of first or second with more.
  What all settings together let expect stands beside what was measured.
- Points have the seed of the case: beds that are filled alike lie less far apart than others would. The axis `seed` is
  another filling, the axis `ranks` a third one on two ranks; what they differ from the case beyond the noise, no error
  bar of a single run sees.
- The reference is not the truth. Its own row of the budget tells what is known to be missing.

## The smoke scene

The page below is the study that `make study` makes of `cases/smoke.yaml`, copied here by `benchmarks/study.py`. The
scene is too small and too short for its numbers to mean much; they show what a study looks like.

![Error against time](images/study.png)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path, help="folder of the study")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs")
    parser.add_argument("--note", default="", help="about how it was made, to stand above the tables")
    options = parser.parse_args()
    report = (options.study / "report.md").read_text().replace("\n## ", "\n### ")
    (options.out / "study.md").write_text(
        "\n\n".join([HEAD.rstrip(), *filter(None, [options.note]), report.rstrip()]) + "\n"
    )
    shutil.copyfile(options.study / "error_time.png", options.out / "images" / "study.png")


if __name__ == "__main__":
    main()
