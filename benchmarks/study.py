"""Writes the pages of docs/ about a study from its folder, and keeps what `--total-error` needs of it.

`make study` makes the study of the smoke scene, and `make study-reactor` that of the test reactor, and then calls this.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ("case", "made", "granpipe", "machine", "fill_angle_deg", "distance", "unknown", "options")
"""Of study.json, for those who run the same scene or another without a study."""

HOW_TO_READ = """\
# Error against run time

`granpipe study CASE` runs cheaper and more expensive variants of a case, one setting at a time, and measures the
accuracy and the time of each. `--hours` limits the wall time by the plans' forecasts (the most expensive points are
dropped and listed), `--axis` chooses settings, with values (`--axis plate_speed=0.05,0.1`) or the usual ones,
`--point` adds a point with several changes (`--point dem.coarse_grain_factor=1,dem.plate_speed=0.05`), `--on slurm`
runs the points on a cluster, `--against CASE` forecasts the time of another case at the measured rate. What is done
is not repeated; but a point with finer particles makes the common grid finer, and then production starts anew.
Everything goes to `results/<case>-study`: `report.html`, charts, `options.csv`, `points.csv`, `study.json`. A study
with other axes replaces them, but keeps what was run. `granpipe sweep status results/<case>-study` shows its points,
`granpipe sweep cancel` ends them. Points outside granpipe's own rules are marked, as their runs would be; the study's
own status is 0 all the same. A scene without particles has only its finite elements to compare: their error is not
that of the fluid as a model.

`granpipe run CASE --total-error 5%` uses the cheapest settings that the study rates within 5 %, and ends when noise and
systematic error together make 5 %: the noise of every section may be √(5 %² − systematic²), of a proven setting with
the 95 % bounds of both, on at least 20 effective blocks. It states the expected error and, after the run, the measured
one with its bound. The average begins as the study's did: where the data show, or where the case said, for then what
was left of the transient is in the errors that the study measured. Without a study of the case, a study that comes with
granpipe is used if it is of the same vessel and material. For any other case its settings are taken over as a guess:
the same narrowest opening over d90, and plate speed over the automatic one.

`--reference RESULTS` counts all errors from an earlier run of the same vessel and material, in place of the finest
point: from one with the material's own particles, the error of particle size is measured and not extrapolated. Its
results folder is enough (velocity, standard errors and effective blocks, cells, and the particle size, plate speed,
stiffness and time step that it was made with; any flow rate). What its settings add to the limit follows from the
slopes of the points, zero along the size where its particles are the material's; its noise is in every bound.
Where its cells are smaller than the study's, it is brought onto these by its stream function, which changes a smeared
flow by 0.5 to 1.2 % (`pytest tests/unit/test_regrid.py`); with cells more than a quarter larger it is refused, and so
is a run of another scene or model. Where its results tell their processor time, it is an option of its own. A folder
with no more than that is made by `python benchmarks/reactor_limit.py pack RESULTS`.

## How to read it

- A **point** is one DEM run (or a hybrid, or a fluid). All points have one grid, as fine as the smallest particles
  need it: deposits are exact on any cell, so fields of different particles are compared face by face. One that is too
  short for a field with an error bar goes on by an eighth of its time, up to four times.
- An **option** is a point, a method, and a length of its average. Shorter averages, larger cells and other methods
  are made from the same segments without running anything. Their time is LIGGGHTS's processor time for each rank up to
  there, filling included: the wall time on cores that nothing else uses. Replicas count for as many cores as they are.
- **Statistical** is the standard error of the option's own average, **systematic** the difference of the point's
  whole average from the limit: the material's own size, no plate speed, no softness, no time step, no mass scaling.
  The limit is the field of the reference (that of `--reference`, or else finest particles, then slowest plate, then
  longest run) less what its settings add: one sum of fields, in which each point's noise counts once, and all noise is
  taken off. The squares of both parts add to the error. The 95 % bound includes how well either is known; by it an
  error is *proven*.
- **Unresolved** differences are smaller than their own uncertainty: only the bound is stated.
- The **budget** goes on to the limit of each axis: the material's own size, no speed, no softness, no step, no
  mass scaling. Along an axis the field is F₀ + c xᵖ, c fitted face by face. p is 1, and 2 only where three points or
  more leave more than twice their noise with 1 and less with 2: of two powers that fit, the first is the farther from
  the limit. What all settings together let expect stands beside what was measured.
- What a plate's speed adds depends on the particles: the axis `finest_speed` has the finest ones at every plate speed,
  and the limit goes by these where they are run. On a free surface it should go with v/d^1.5, the flow rate of the
  layer over d √(g d) ([GDR MiDi 2004](../theory/index.md#references)); in the test reactor 0.024 m/s add 5.2 % with the
  material's own particles, 3.2 % with ones twice as large.
- With `--reference`, settings are also recommended **by the reference alone**: by the difference from it as it is,
  without what its own plate, softness and step add.
- Points have the seed of the case. The axis `seed` is another filling, the axis `ranks` a third one on two ranks;
  what they differ from the case beyond the noise, no error bar of a single run sees. `--axis fillings` repeats the
  points along all axes that have a limit in the fillings of the axis `seed`, `--axis
  fillings=youngs_modulus,plate_speed` those of some: then all of them tell what a setting does. Where fields of equal
  settings lie farther apart than their noise lets expect, noise counts as so much larger in the limit and in what the
  axes tell; the report says by how much. Of options that differ in their filling alone the worst counts,
  in the front as in what is recommended, and only where each filling that ran as long has a field by then.
- The reference is not the truth. Its own row of the budget shows its known errors, and the page says which axes the
  study could not tell.
"""

SMOKE = """\
## The smoke scene

This is what `make study` makes of `cases/smoke.yaml` with particles of 1.8 cm, copied here by `benchmarks/study.py`.
The scene is too small and too short for its numbers to mean much; they show what a study looks like. That of a real
vessel is [study_reactor.md](study_reactor.md).
"""

REACTOR = """\
# The test reactor: error against run time

This is what `make study-reactor` makes of `cases/reactor.yaml`, copied here by `benchmarks/study.py`; how to read it
stands in [study.md](study.md). The case has the material's particles, 3 ± 1 cm in radius, enlarged twice; points have
them enlarged less or not, another plate speed at equal travel, another filling, or are a fluid alone. With particles
enlarged 2.5 times and more the throat is narrower than five times d90, which granpipe marks. Errors count from [runs
with the material's own particles](reactor_limit.md), the mean of two fillings.
"""

README_BLOCK = "<!-- by benchmarks/study.py -->\n", "<!-- until here -->"
"""Between these the README has the recommended settings of the reactor's study."""

PAGES = {"smoke": ("study", f"{HOW_TO_READ}\n{SMOKE}"), "reactor": ("study_reactor", REACTOR)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path, help="folder of the study")
    parser.add_argument("--note", default="", help="about how it was made, to stand above the tables")
    options = parser.parse_args()
    stored = json.loads((options.study / "study.json").read_text())
    page, head = PAGES[stored["case"]["name"]]
    docs = ROOT / "docs" / "validation"
    charts = []
    for chart, title in (("error_time", "Error against time"), ("effects", "What each change costs and does")):
        shutil.copyfile(options.study / f"{chart}.png", docs / "images" / f"{page}_{chart}.png")
        charts.append(f"![{title}](images/{page}_{chart}.png)")
    report = (options.study / "report.md").read_text().replace("\n## ", "\n### ")
    (docs / f"{page}.md").write_text(
        "\n\n".join([head.rstrip(), *charts, *filter(None, [options.note]), report.rstrip()]) + "\n"
    )
    if page == "study_reactor":
        kept = json.dumps({key: stored[key] for key in KEPT}, separators=(",", ":"))
        (ROOT / "granpipe" / "templates" / "studies" / "reactor.json").write_text(kept + "\n")
        readme = ROOT / "README.md"
        readme.write_text(with_settings(readme.read_text(), report))


def with_settings(readme: str, report: str) -> str:
    """The README with the recommended settings of a study's report."""
    begin, end = README_BLOCK
    before, _, rest = readme.partition(begin)
    _, _, after = rest.partition(end)
    tables = []
    for title in ("Recommended settings", "Settings by the reference alone"):
        _, found, text = report.partition(f"### {title}\n")
        tables += [text.partition("\n### ")[0].strip()] if found else []
    return before + begin + "\n\n".join(tables) + "\n" + end + after


if __name__ == "__main__":
    main()
