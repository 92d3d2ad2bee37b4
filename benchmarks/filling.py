"""What a run does before it averages: filling, settling, and the part of production that is left out.

`shares RESULTS/CASE …` tells of finished runs which part of their steps that was, `starts RESULTS/CASE …` from which
segment on their mean flow would be known best. `run` fills two scenes in other ways than granpipe does, and tells the
steps that each takes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest import mock

import numpy as np

from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.dem.deck import Deck
from granpipe.dem.packing import Bed
from granpipe.field import Array
from granpipe.homogenize.average import Sums
from granpipe.homogenize.statistics import LEAST_BLOCKS, effective_samples, standard_error
from granpipe.pipeline import dem_stages
from granpipe.pipeline.averages import after_transient
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import finished_productions, settle
from granpipe.pipeline.production import Production
from granpipe.pipeline.provenance import Provenance
from granpipe.pipeline.records import SettleRecord
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

CHAMBER = """\
name: chamber
outline:
  unit: m
  wall: [[0.5, 2.7], [0.5, 1.7], [1.156, 1.7], [1.156, 0]]
  sections: {throat: [2.7, 1.7], chamber: [1.7, 0]}
material: {density: 1000 kg/m^3, size: {diameter: 20 cm}}
contact: {friction: 0.73, rolling_friction: 0.21, restitution: 0.43}
flow_rate: 1 m^3/h
model: dem
dem: {ranks: 1}
"""
"""The test reactor's throat and the chamber below it, with larger particles."""

WAYS = {"packed, as it is": (True, None), "packed, up to 60°": (True, 60.0), "dropped in, up to 60°": (False, 60.0)}
"""Whether a packed bed is placed at first; filling angle [°], or None for the own one."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "shares", "starts"])
    parser.add_argument("folders", nargs="*", type=Path, help="results folders of finished runs")
    parser.add_argument("--results", type=Path, default=Path("results-filling"))
    options = parser.parse_args()
    told = {"shares": lambda folder: [share(folder)], "starts": starts}
    lines = (
        ways(options.results)
        if options.what == "run"
        else (line for folder in options.folders for line in told[options.what](folder))
    )
    for line in lines:
        print(line, flush=True)


def ways(results: Path) -> Iterator[str]:
    """Rows of a table: scene, way, particles at first and at rest, steps and processor time [s] until then, insertions
    that fell short.
    """
    results.mkdir(parents=True, exist_ok=True)
    (results / "chamber.yaml").write_text(CHAMBER)
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    for scene in (results / "chamber.yaml", Path("cases/reactor.yaml")):
        plan = make_plan(read_case(scene).case, 1)
        for name, (packed, angle) in WAYS.items():
            with Console() as console, filled(packed, angle):
                folder = settle(plan, Context(store, versions, console, 1))
            record = SettleRecord.read(folder)
            yield (
                f"| {plan.case.name} | {name} | {placed(folder)} | {record.particles} | {record.steps} | "
                f"{record.processor_seconds:.0f} | {record.short_insertions} |"
            )


@contextmanager
def filled(packed: bool, angle: float | None) -> Iterator[None]:
    """Meanwhile vessels are filled in another way."""
    compose = dem_stages.compose_bed

    def composed(plan: Plan, walls: Path, deck: Deck) -> Bed:
        bed = compose(plan, walls, deck)
        return bed if packed else Bed(bed.position[:0], bed.number[:0])

    with ExitStack() as patches:
        patches.enter_context(mock.patch.object(dem_stages, "compose_bed", composed))
        if angle is not None:
            patches.enter_context(mock.patch.object(dem_stages, "filling_angle", return_value=np.radians(angle)))
        # the beds of all ways have one key
        patches.enter_context(mock.patch.object(dem_stages, "_VERSION", f"{dem_stages._VERSION}, packed {packed}"))
        yield


def placed(folder: Path) -> int:
    """Particles at the first step: the first row of LIGGGHTS' table."""
    rows = map(str.split, (folder / "output.txt").read_text(errors="replace").splitlines())
    return next(int(row[1]) for row in rows if len(row) == 4 and row[0] == "0" and row[1].isdigit())


def share(folder: Path) -> str:
    """Row of a table: steps of filling and settling, of production, those averaged, and what came before in all."""
    plan, production = finished(folder)
    settled = SettleRecord.read(production.settled).steps
    numbers = dict(Provenance.read(folder).numbers)
    step = plan.dem.time_step
    produced, averaged = (numbers["averaged_to_s"] - begin for begin in (0.0, numbers["averaged_from_s"]))
    every = settled + produced / step
    return (
        f"| {plan.case.name} | {settled} | {produced / step:.0f} | {averaged / step:.0f} | "
        f"{1 - averaged / step / every:.0%} |"
    )


def finished(folder: Path) -> tuple[Plan, Production]:
    """The plan of a finished run, and its production in the store beside its results."""
    plan = make_plan(read_case(folder / "case.yaml").case, 1)
    store = Store(folder.parent / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    return plan, finished_productions(plan, store, versions)[0]


def starts(folder: Path) -> Iterator[str]:
    """Rows of a table, for more and more of a run: its end [s], where its average begins [s] and the error of its mean
    flow, then the same for the start in its first half that gives the least error.
    """
    plan, production = finished(folder)
    segments = [*production.sums()]
    first = plan.dem.segments_left_out
    flows = np.array([_flows(one) for one in segments])
    for count in range(max(27, first + 2 * LEAST_BLOCKS), len(segments) + 1, 6):
        begun = after_transient(segments[:count], plan)[0].start
        errors = {
            segments[begin].start: _error(flows[begin:count])
            for begin in range(first, (first + count) // 2 + 1)
            if count - begin >= LEAST_BLOCKS
        }
        best = min(errors, key=errors.__getitem__)
        yield (
            f"| {plan.case.name} | {segments[count - 1].stop:.1f} | {begun:.1f} | {errors[begun]:.1%} | {best:.1f} | "
            f"{errors[best]:.1%} |"
        )


def _flows(sums: Sums) -> Array:
    """Flow through every face, each scaled so that its square counts by area."""
    flux_r, flux_z = sums.mean_flux
    scaled = flux_r * np.sqrt(sums.grid.side_area), flux_z * np.sqrt(sums.grid.ring_area)
    return np.concatenate([one.ravel() for one in scaled])


def _error(flows: Array) -> float:
    """Relative standard error of the mean of (n, faces) correlated flows."""
    effective = effective_samples(flows, np.zeros(len(flows), dtype=int))
    return float(np.linalg.norm(standard_error(flows, effective)) / np.linalg.norm(flows.mean(axis=0)))


if __name__ == "__main__":
    main()
