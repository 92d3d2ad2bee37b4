"""Levers of the particle run: what each saves, and what it does to the field.

`run` simulates with the lever and without it, several seeds each, one after the other, so that a machine that grows
slower favours neither; `page` writes docs/validation/levers.md from what there is.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.pipeline.run import run_case

HERE = Path(__file__).resolve().parent
CASES = HERE.parent / "cases"
COMMON = {
    "dem.ranks": "1",
    "dem.statistical_error": "0.1 %",  # never reached: every run is as long as it is told to be
    "homogenize.start": "auto",
    "export": "[]",
    "figures": "[]",
}


@dataclass(frozen=True)
class Scene:
    """A vessel with the changes of its case, and the time of production [s] with a faster start and without it."""

    case: str
    changes: dict[str, str]
    faster: float
    plain: float
    seeds: tuple[int, ...]


SCENES = {
    "smoke": Scene("smoke", {}, 6.0, 8.0, (1, 2, 3, 4)),
    "reactor": Scene("reactor", {"dem.coarse_grain_factor": "3"}, 30.0, 45.0, (1, 2)),
}
WAYS = ("faster", "plain")
"""A run with a faster start, and one whose plate has one speed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--scene", choices=list(SCENES), default="smoke")
    parser.add_argument("--ways", nargs="*", choices=WAYS, default=WAYS)
    parser.add_argument("--seeds", nargs="*", type=int)
    parser.add_argument("--results", type=Path, default=Path("results-levers"))
    options = parser.parse_args()
    for seed in options.seeds or SCENES[options.scene].seeds:
        for way in options.ways:
            with Console() as console:
                run_case(case_of(options.scene, way, seed), options.results, console)


def case_of(scene: str, way: str, seed: int) -> CaseFile:
    """The case of one run."""
    chosen = SCENES[scene]
    changes = COMMON | chosen.changes | {"name": f"levers-{scene}-{way}-{seed}", "dem.seed": str(seed)}
    changes["dem.max_time"] = repr(getattr(chosen, way))
    if way == "plain":
        changes["dem.start_speed"] = "0.001 m/s"
    return read_case(CASES / f"{chosen.case}.yaml", changes)


if __name__ == "__main__":
    main()
