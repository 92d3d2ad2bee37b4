"""Levers of the particle run: what each saves, and what it does to the field.

`run` simulates the test reactor with particles enlarged three times, with every lever and with each of them taken back,
two seeds each; `page` writes docs/validation/levers.md. Runs of one seed follow each other, so that a machine that
grows slower does not favour one of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from granpipe.case.reader import CaseFile, read_case
from granpipe.console import Console
from granpipe.pipeline.run import run_case

HERE = Path(__file__).resolve().parent
REACTOR = HERE.parent / "cases" / "reactor.yaml"
SEEDS = (1, 2)
COMMON = {
    "dem.coarse_grain_factor": "3",
    "dem.ranks": "1",
    "dem.statistical_error": "0.1 %",  # never reached: all runs average over the same travel
    "dem.max_time": "30 s",
    "export": "[]",
    "figures": "[]",
}
BACK = {
    "all": {},
    "start": {"dem.start_speed": "0.001 m/s", "dem.max_time": "45 s"},
}
"""What is taken back → changes of the case; without a faster start the transient is part of the time."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--only", nargs="*", choices=list(BACK), default=list(BACK))
    parser.add_argument("--seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--results", type=Path, default=Path("results-levers"))
    options = parser.parse_args()
    for seed in options.seeds:
        for name in options.only:
            with Console() as console:
                run_case(case_of(name, seed), options.results, console)


def case_of(name: str, seed: int) -> CaseFile:
    """The case with one lever taken back."""
    return read_case(REACTOR, COMMON | BACK[name] | {"name": f"levers-{name}-{seed}", "dem.seed": str(seed)})


if __name__ == "__main__":
    main()
