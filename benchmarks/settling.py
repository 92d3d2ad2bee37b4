"""When filling ends: at rest, or after the time of a free fall, before a faster start.

`run` makes three small vessels with a faster start, two seeds each, both ways; `page` tells the steps of settling, and
the difference of the fields.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.dem import deck as decks
from granpipe.field import Field
from granpipe.homogenize.average import Sums
from granpipe.pipeline import dem_stages
from granpipe.pipeline.averages import averaged_field, steady_segments
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.records import SettleRecord
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

SEEDS = (1, 2)
WAYS = {"at rest": False, "as it is": True}
"""Whether filling may end after a free fall."""
SCENE = """\
name: {name}
outline:
  unit: cm
  wall: {wall}
  sections: {{above: [{top}, {middle}], below: [{middle}, {bottom}]}}
material: {{density: 1000 kg/m^3, size: {{diameter: 2 cm}}}}
contact: {{friction: 0.5, rolling_friction: 0.1, youngs_modulus: 2 MPa}}
flow_rate: 100 kg/h
model: dem
dem: {{max_time: {time} s, seed: {seed}, ranks: 1, start_speed: {start} m/s, plate_speed: {plate} m/s}}
export: []
figures: []
"""
VESSELS: dict[str, dict[str, Any]] = {
    "hopper": {"wall": "[[12, 40], [12, 14], [6, 4], [6, 0]]", "top": 40, "middle": 14, "bottom": 0},
    "chamber": {
        "wall": "[[10, 36], [10, 20], [7, 14], [7, 12], [10, 12], [10, 0]]", "top": 36, "middle": 12, "bottom": 0,
    },
    "pipe": {"wall": "[[9, 40], [9, 0]]", "top": 40, "middle": 15, "bottom": 0},
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--time", type=float, default=6.0, help="simulated time [s]")
    parser.add_argument("--results", type=Path, default=Path("results-settling"))
    options = parser.parse_args()
    if options.what == "page":
        for line in page(options.results, options.time):
            print(line)
        return
    for vessel in VESSELS:
        for seed in SEEDS:
            for way in WAYS:
                with Console() as console, ends(WAYS[way]):
                    run_case(case_of(vessel, seed, options.time, options.results), options.results / way, console)


def case_of(vessel: str, seed: int, time: float, results: Path) -> CaseFile:
    """The case of one run."""
    results.mkdir(parents=True, exist_ok=True)
    name = f"{vessel}{seed}"
    path = results / f"{name}.yaml"
    path.write_text(SCENE.format(name=name, seed=seed, time=time, start=0.1, plate=0.03, **VESSELS[vessel]))
    return read_case(path)


@contextmanager
def ends(early: bool) -> Iterator[None]:
    """Filling may end after a free fall, or not before the bed is at rest."""
    made = decks.make_deck

    def chosen(*given: Any) -> decks.Deck:
        deck = made(*given)
        return deck if early else replace(deck, fall_steps=0)

    with mock.patch.object(dem_stages, "make_deck", chosen):
        yield


def page(results: Path, time: float) -> Iterator[str]:
    """Rows of a table: vessel; steps of settling both ways, of each seed; sections and their differences."""
    for vessel in VESSELS:
        steps: dict[str, list[int]] = {}
        fields: dict[str, Field] = {}
        for way, early in WAYS.items():
            with ends(early):
                runs = [_run(case_of(vessel, seed, time, results), results / way) for seed in SEEDS]
            steps[way] = [settled for _, _, settled in runs]
            segments = [replace(sums, run=number) for number, (_, steady, _) in enumerate(runs) for sums in steady]
            plan = runs[0][0]
            fields[way] = averaged_field(plan.case, plan.outline, segments, plan.dem.classes.sauter_diameter).field
        first, second = fields.values()
        for one in compare(first, second, plan.case.outline.levels, plan.dem.classes.sauter_diameter):
            told = " | ".join(", ".join(map(str, counts)) for counts in steps.values())
            shares = f"{one.observed:.1%} | {one.noise:.1%} | {one.noise_free:.1%} | {one.upper:.1%}"
            yield f"| {vessel} | {told} | {one.name} | {shares} |"


def _run(file: CaseFile, results: Path) -> tuple[Plan, list[Sums], int]:
    """Plan, averaged segments and steps of filling and settling of a finished run."""
    plan = make_plan(file.case, 1)
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    (production,) = finished_productions(plan, store, versions)
    return plan, steady_segments([*production.sums()], plan), SettleRecord.read(production.settled).steps


if __name__ == "__main__":
    main()
