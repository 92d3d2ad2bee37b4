"""Hybrids with either fluid: a reference (benchmarks/references/friction) is followed in the sections that need DEM.

Prints the errors of the sections that the fluid makes alone, the noise of the reference taken off, and the difference
at the seams. The truth of the free sections is the same reference, of which the hybrid sees nothing there.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from friction_fluid import HERE, load

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.errors import GranpipeError
from granpipe.pipeline.context import Context
from granpipe.pipeline.hybrid_field import hybrid_field
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.system.store import Store


def measure(references: Path, name: str, rheology: str, folder: Path) -> str:
    """The errors of one hybrid, as a line."""
    reference = load(references, name)
    reference.field.save(folder / f"{name}.npz")
    changes = {
        "model": "hybrid",
        "fluid.rheology": rheology,
        "fluid.known_field": str(folder / f"{name}.npz"),
        "homogenize.cell": repr(float(reference.field.grid.cell)),
    }
    plan = make_plan(read_case(references / f"{name}.yaml", changes).case)
    made = hybrid_field(plan, Context(Store(folder / "store"), {}, Silent(), 1))
    levels = plan.case.outline.levels
    simulated = {section for span in plan.followed for section in span.sections}
    found = compare(reference.field, replace(made.field, flux_r_se=None, flux_z_se=None), levels, 1.0)
    parts = [
        f"{one.name} {np.sqrt(max(one.observed**2 - reference.noise[one.name] ** 2, 0)):.1%}"
        for one in found
        if one.name not in simulated
    ]
    seams = [
        f"{where} of {span} {value:.1%}"
        for span, differences in made.figures["difference_from_what_is_followed"].items()
        for where, value in differences.items()
        if where != "sections"
    ]
    return ", ".join([*parts, *seams])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["reactor", "blast_furnace"], help="references")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in options.names:
            for rheology in ("viscous", "frictional"):
                try:
                    told = measure(HERE / "references" / "friction", name, rheology, Path(folder))
                except GranpipeError as error:
                    told = str(error)
                print(f"{name:<16}{rheology:<12} {told}", flush=True)


if __name__ == "__main__":
    main()
