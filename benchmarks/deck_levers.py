"""Levers of the deck: what each costs or saves in processor time, and what it does to the particles.

`run` starts LIGGGHTS again and again at one moment of one production of the test reactor, with one deck after the
other in every round; `paths` compares the particles' paths, `contacts` what is dumped of contacts with walls; `ranks`
compares ranks beside whatever else the machine does; `sizes` times the deck with other numbers of particles. `page`
writes docs/validation/deck_levers.md from what there is.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import textwrap
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from unittest import mock

import numpy as np

from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.dem import run as dem_run
from granpipe.dem.contact import two_digits
from granpipe.dem.contacts import read_wall_contacts
from granpipe.dem.deck import DUMP_COLUMNS, Deck, render
from granpipe.dem.dump import read_snapshot
from granpipe.dem.run import Liggghts
from granpipe.dem.snapshot import Snapshot
from granpipe.dem.step import MANY_PARTICLES, SKIN, WIDE_SKIN
from granpipe.field import Array, Mask
from granpipe.geometry.extrude import write_stl
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import (
    compose_deck,
    make_walls,
    settle,
)
from granpipe.pipeline.production import copy_walls
from granpipe.pipeline.records import WallRecord
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.rates import machine
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
REACTOR = HERE.parent / "cases" / "reactor.yaml"

FLOWING = 20
"""Segments after the faster start after which decks are timed: at first nothing falls in cavities, no feed is needed,
and lists of neighbours are built a quarter as often as later."""


@dataclass(frozen=True)
class Lever:
    """One way to write the deck.

    Parameters
    ----------
    skin : of the neighbour lists in mean diameters; None: granpipe's own
    every : steps between two looks at how far particles have moved
    renamed : the same meshes under new names; like all new meshes, they begin without the history of contacts
    one_mesh : vessel and obstacles in one mesh
    cylinder : the outermost wall as a primitive of LIGGGHTS in place of its triangles
    ranks : MPI processes
    mpirun : words for mpirun in place of granpipe's own
    together : how many such runs side by side
    """

    skin: float | None = None
    every: int = 1
    renamed: bool = False
    one_mesh: bool = False
    cylinder: bool = False
    ranks: int = 1
    mpirun: tuple[str, ...] = ()
    together: int = 1


BASE, WIDE, OWN, ANEW, CYLINDER = (
    f"skin {SKIN:g} d",
    f"skin {WIDE_SKIN:g} d",
    "the deck as it is",
    "skin 0.2 d, walls anew",
    "outermost cylinder as primitive",
)
LEVERS = {
    **{f"skin {skin:g} d": Lever(skin) for skin in (0.2, 0.3, 0.4, 0.5, 0.6)},
    "skin 0.4 d, every 5": Lever(0.4, every=5),
    ANEW: Lever(0.2, renamed=True),
    "vessel and ring in one mesh": Lever(0.2, one_mesh=True),
    CYLINDER: Lever(0.2, cylinder=True),
    "all three, skin 0.4 d, every 5": Lever(0.4, 5, one_mesh=True, cylinder=True),
}
PATH_STEPS = 400
RANKS = {
    "one rank": Lever(),
    "two one-rank runs": Lever(together=2),
    "two ranks": Lever(ranks=2),
    "two ranks, that yield": Lever(
        ranks=2,
        mpirun=(
            "--map-by",
            ":OVERSUBSCRIBE",
            "--bind-to",
            "none",
            "--mca",
            "mpi_yield_when_idle",
            "1",
        ),
    ),
    "two ranks, bound to cores": Lever(
        ranks=2,
        mpirun=(
            "--map-by",
            ":OVERSUBSCRIBE",
            "--bind-to",
            "core",
            "--mca",
            "mpi_yield_when_idle",
            "0",
        ),
    ),
}


@dataclass(frozen=True)
class Timed:
    """What one start of LIGGGHTS took.

    Parameters
    ----------
    round : in which it was made
    particles : at its end, of all runs side by side
    seconds : processor time, user and system
    clock : time by the clock [s]
    builds, dangerous : of the neighbour lists
    load : processes that wanted a core when it began, as the system averages them over a minute
    """

    lever: str
    round: int
    particles: int
    steps: int
    seconds: float
    clock: float
    builds: int
    dangerous: int
    load: float

    def each(self, start: float) -> float:
        """Processor time of a particle-step [s], that of starting LIGGGHTS [s] taken off."""
        return (self.seconds - start) / (self.particles * self.steps)


@dataclass(frozen=True)
class Moment:
    """A restart file of a production, and all that LIGGGHTS needs to go on from it."""

    plan: Plan
    deck: Deck
    walls: Path
    restart: Path
    segments: int

    @contextmanager
    def continued(self, lever: Lever, folder: Path, deck: Deck) -> Iterator[Liggghts]:
        """LIGGGHTS at the next segment, in a folder that is made anew."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        copy_walls(self.walls, folder)
        shutil.copyfile(self.restart, folder / "start.restart")
        (folder / "produce.in").write_text(deck_of(self.plan, deck, lever, folder))
        number = self.segments + 1
        command = dem_run._command

        def placed(*given: object) -> list[str]:
            words = command(*given)  # type: ignore[arg-type]
            if lever.mpirun:
                words[3 : words.index("--mca") + 3] = lever.mpirun
            return words

        with (
            mock.patch.object(dem_run, "_command", placed),
            Liggghts("produce.in", folder, lever.ranks, {"first": number, "last": number}) as process,
        ):
            yield process

    def time(self, name: str, lever: Lever, number: int, folder: Path, steps: int) -> Timed:
        """Run so many steps."""
        deck = replace(self.deck, segment_steps=steps)
        load, begun, before = os.getloadavg()[0], time.monotonic(), _taken()
        with ExitStack() as stack:
            folders = [folder / str(k) for k in range(lever.together)]
            processes = [stack.enter_context(self.continued(lever, one, deck)) for one in folders]
            waiting = [process.wait() for process in processes]
            while waiting:
                waiting = [one for one in waiting if next(one, None) is not None]
        took, clock = _taken() - before, time.monotonic() - begun
        particles = sum(process.status.particles for process in processes)
        said = (folders[0] / "output.txt").read_text(errors="replace")
        builds, dangerous = (int(re.findall(rf"{what} builds = (\d+)", said)[-1]) for what in ("list", "Dangerous"))
        return Timed(name, number, particles, steps, took, clock, builds, dangerous, load)

    def paths(self, lever: Lever, folder: Path, steps: int, every: int) -> dict[int, Snapshot]:
        """Snapshots by steps gone."""
        deck = replace(self.deck, segment_steps=steps, dump_every=every)
        with self.continued(lever, folder, deck) as process:
            for _ in process.wait():
                pass
        begun = self.segments * self.deck.segment_steps
        steps_of = {int(path.name.split(".")[1]) - begun: path for path in folder.glob("snapshot.*.bin")}
        return {step: read_snapshot(path, DUMP_COLUMNS) for step, path in sorted(steps_of.items()) if step > 0}


def _taken() -> float:
    """Processor time of all that has been started and has ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def deck_of(plan: Plan, deck: Deck, lever: Lever, folder: Path) -> str:
    """The deck of a lever; meshes that it needs are written into the folder."""
    names = [name for name in deck.meshes if name != "plate"]
    meshes = deck.meshes
    if lever.renamed or lever.one_mesh or lever.cylinder:
        # a mesh of a new name: under an old one LIGGGHTS goes on with the triangles of the restart file
        groups = [names] if lever.one_mesh else [[name] for name in names]
        made = []
        for group in groups:
            corners = np.concatenate([triangles(folder / f"{name}.stl") for name in group])
            if lever.cylinder and "vessel" in group:
                corners = corners[~outermost(corners)]
            made.append("anew_" + "_".join(group))
            write_stl(corners, folder / f"{made[-1]}.stl")
        meshes = (*made, "plate")
    skin = plan.dem.skin if lever.skin is None else two_digits(lever.skin * plan.dem.classes.mean_diameter)
    text = render(replace(deck, skin=skin, meshes=meshes), "produce.in")
    text = re.sub(r"(neigh_modify +delay 0).*", rf"\1 every {lever.every}", text)
    if lever.cylinder:
        wall = (
            f"fix outermost all wall/gran {deck.contact_model} primitive type {deck.types} "
            f"zcylinder {plan.simulated.r_max:.10g} 0.0 0.0"
        )
        text = re.sub(r"(fix +walls all wall/gran.*)", rf"\1\n{wall}", text)
    return text


def triangles(path: Path) -> Array:
    """(n, 3, 3) corners in an STL file [m]."""
    found = re.findall(r"vertex +(\S+) +(\S+) +(\S+)", path.read_text())
    return np.array(found, dtype=float).reshape(-1, 3, 3)


def outermost(corners: Array) -> Mask:
    """(n,) which triangles lie in the outermost cylinder."""
    radius = np.hypot(corners[..., 0], corners[..., 1])
    return np.asarray((radius > radius.max() * (1 - 1e-6)).all(axis=1), dtype=bool)


def moment(factor: float, results: Path, flowing: int = FLOWING, youngs: str = "auto") -> Moment:
    """The production so many segments after its faster start; 0: its beginning."""
    changes = {"dem.coarse_grain_factor": f"{factor:g}", "dem.ranks": "1", "contact.youngs_modulus": youngs}
    plan = make_plan(read_case(REACTOR, changes).case, 1)
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    with Console() as console:
        context = Context(store, versions, console, 1)
        walls, bed = make_walls(plan, context), settle(plan, context)
    deck = compose_deck(plan, walls)
    last = deck.start_segments + flowing
    folder = results / f"moment-{factor:g}-{youngs}-{last}"
    if flowing == 0:
        return Moment(plan, deck, walls, bed / "settled.restart", 0)
    if not (folder / "restart").exists():
        folder.mkdir(parents=True, exist_ok=True)
        copy_walls(walls, folder)
        shutil.copyfile(bed / "settled.restart", folder / "start.restart")
        (folder / "produce.in").write_text(render(deck, "produce.in"))
        with Liggghts("produce.in", folder, 1, {"first": 1, "last": last}) as process:
            for _ in process.wait():
                pass
        (folder / f"segment.{last}.restart").replace(folder / "restart")
    return Moment(plan, deck, walls, folder / "restart", last)


def rounds(levers: dict[str, Lever], start: Moment, folder: Path, repeat: int, steps: int) -> None:
    """Time every lever in every round, in another order each, and the start of LIGGGHTS alone; what is there, stays."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, repeat + 1):
        names = ["start", *levers]
        np.random.default_rng(number).shuffle(names)
        for name in names:
            path = folder / f"{re.sub('[^a-z0-9.]+', '-', name)}-{number}.json"
            if not path.exists():
                lever, length = (
                    levers.get(name, Lever()),
                    1 if name == "start" else steps,
                )
                timed = start.time(name, lever, number, folder.parent / "work", length)
                write_json(path, asdict(timed))
                print(f"{name}: {timed}", flush=True)


def read_rounds(folder: Path) -> list[Timed]:
    return [read_json(path, Timed) for path in sorted(folder.glob("*.json"))]


def apart(one: Snapshot, other: Snapshot) -> float:
    """Largest distance of a particle in one from itself in the other [m]."""
    ids, mine, theirs = np.intersect1d(one.id, other.id, return_indices=True)
    if len(ids) != len(one) or len(ids) != len(other):
        return float("inf")
    return float(np.linalg.norm(one.position[mine] - other.position[theirs], axis=1).max())


def paths(names: list[str], start: Moment, path: Path, folder: Path) -> None:
    """Largest distance of a particle from itself with the first lever [m], by lever and steps gone."""
    of = {name: start.paths(LEVERS[name], folder, PATH_STEPS, PATH_STEPS // 8) for name in names}
    first = of[names[0]]
    steps = [*first][::2]
    found = {name: {str(step): apart(first[step], of[name][step]) for step in steps} for name in names[1:]}
    write_json(path, found)
    print(found)


def contacts(start: Moment, path: Path, folder: Path) -> None:
    """Number of contacts with walls that LIGGGHTS tells of, by lever: all, and those in the outermost cylinder."""
    deck, found = (
        replace(start.deck, wall_contacts=True, segment_steps=100, dump_every=50),
        {},
    )
    for name in (BASE, ANEW, CYLINDER):
        with start.continued(LEVERS[name], folder, deck) as process:
            for _ in process.wait():
                pass
        places = read_wall_contacts(max(folder.glob("contacts.*.txt"))).end
        outer = np.hypot(places[:, 0], places[:, 1]) > 0.98 * start.plan.simulated.r_max
        found[name] = [len(places), int(outer.sum())]
    write_json(path, found)
    print(found)


@dataclass(frozen=True)
class Cost:
    """What a lever costs over all rounds.

    Parameters
    ----------
    ratio : its processor time over that of the first lever
    error : standard error of that
    each : processor time of a particle-step [s]
    """

    ratio: float
    error: float
    each: float
    rows: tuple[Timed, ...]


def costs(rows: list[Timed], first: str) -> dict[str, Cost]:
    """Of each lever, by rounds that have all of them; the scatter is that of all levers together."""
    start = np.mean([row.seconds for row in rows if row.lever == "start"])
    by_lever: dict[str, dict[int, Timed]] = {}
    for row in rows:
        if row.lever != "start":
            by_lever.setdefault(row.lever, {})[row.round] = row
    common = sorted(set.intersection(*(set(of) for of in by_lever.values())))
    each = np.array([[of[number].each(float(start)) for number in common] for of in by_lever.values()])
    logs = np.log(each)
    rest = logs - logs.mean(axis=1, keepdims=True) - logs.mean(axis=0, keepdims=True) + logs.mean()
    scatter = np.sqrt((rest**2).sum() / max(1, (len(each) - 1) * (len(common) - 1)))
    base = logs[[*by_lever].index(first)].mean()
    error = float(scatter * np.sqrt(2 / len(common)))
    return {
        name: Cost(
            float(np.exp(log - base)),
            error,
            float(np.exp(log)),
            tuple(of[number] for number in common),
        )
        for (name, of), log in zip(by_lever.items(), logs.mean(axis=1), strict=True)
    }


def page(results: Path) -> str:
    version = program_versions(results / ".store" / "programs.json")["liggghts"]
    number = re.search(r"\d+(\.\d+)+", version)
    return "\n".join(
        [
            "# Levers of the deck",
            "",
            *_paragraph(
                "Made by `benchmarks/deck_levers.py` (`run`, `paths`, `contacts`, `ranks`, `sizes`, then `page`) on "
                f"{datetime.now(UTC):%Y-%m-%d}; LIGGGHTS {number[0] if number else version}, {machine()}. Decks are "
                f"tried on one moment of the test reactor, {FLOWING} segments after the faster start; every round has "
                "all of them, in another order each. Figures are processor time of LIGGGHTS, user and system, its "
                "start taken off: clock times would tell of other programs. Errors are one standard error, by the "
                "scatter of all decks over the rounds; a saving below 0 is a cost."
            ),
            *_verdict_section(results),
            *_cost_section(results),
            *_path_section(results),
            *_contact_section(results),
            *_rank_section(results),
            *_size_section(results),
        ]
    )


def _paragraph(text: str) -> list[str]:
    return [*textwrap.wrap(text, 116, break_on_hyphens=False), ""]


def _verdict_section(results: Path) -> list[str]:
    every = [costs(read_rounds(folder), BASE) for folder in sorted(results.glob("run-*"))]
    found, *_ = (one for one in every if CYLINDER in one)
    soft = [one for one in every if CYLINDER not in one]
    ranks = costs(read_rounds(min(results.glob("ranks-*"))), "one rank")

    def saved(name: str, base: str = BASE, at: dict[str, Cost] = found) -> str:
        ratio = at[name].ratio / at[base].ratio
        return f"{100 * (1 - ratio):.1f} ± {100 * ratio * at[name].error:.1f} %"

    def slower(name: str) -> str:
        return f"{_speed(ranks['one rank']) / _speed(ranks[name]):.1f}"

    rows = [
        (
            f"neighbour {WIDE}, soft particles, so that a step needs more than {SKIN:g} d",
            ", ".join(saved(WIDE, at=one) for one in soft),
            "rounding, below",
            f"with {MANY_PARTICLES:g} particles and more",
        ),
        (f"neighbour {WIDE} otherwise", saved(WIDE), "rounding, below", "no: nothing is saved"),
        (
            "besides, particles looked at every 5 steps",
            saved("skin 0.4 d, every 5", WIDE),
            "rounding, below; a contact may be seen up to 4 steps late",
            "no: the force of a contact that is seen late begins with a jump",
        ),
        (
            "vessel and ring in one mesh",
            saved("vessel and ring in one mesh", ANEW),
            "none: the same triangles",
            "no: nothing is saved",
        ),
        (
            CYLINDER,
            saved(CYLINDER, ANEW),
            "a round wall in place of facets; its contacts are in no dump, below",
            "no: wall pressure and stress would lack that wall, so that cases that ask for them would need other walls",
        ),
        (
            "all of these",
            saved("all three, skin 0.4 d, every 5", ANEW),
            "as above",
            "the skin, where it saves",
        ),
        (
            "two ranks, beside others",
            f"{slower('two ranks')} times as slow by the clock as one rank, "
            f"{ranks['two ranks'].ratio:.0f} times the processor time",
            "none",
            "yes: with `dem.ranks: auto` a run counts only cores that nobody else keeps busy",
        ),
        (
            "two one-rank replicas, beside others",
            f"{1 / float(slower('two one-rank runs')):.1f} times the particle-steps of one rank",
            "two fillings in place of one",
            "as a case says (`dem.replicas`)",
        ),
        (
            "[faster start](levers.md) of the plate",
            "0.96 ± 0.08 in place of 1.25·10⁹ particle-steps to 5 %",
            "0.0 % (< 1.8 %)",
            "yes",
        ),
        (
            "[onset](onset.md) by the error of the field",
            "in the reactor 66 of 70 ends of runs give a field in place of 56, on 14 blocks in place of 12",
            "less is left out",
            "yes",
        ),
        (
            "[less left out](onset.md#after-the-faster-start) after the faster start",
            "0.4 diameters of travel: 5 and 9 % of the reactor's production, own size and 1.75 times as large",
            "9.3 in place of 9.5 % from its own particles",
            "yes",
        ),
        (
            "[filling](filling.md) with a packed bed",
            "36 % of the steps of filling, 60 % with the material's own particles",
            "surfaces as before",
            "yes",
        ),
        (
            "[plate and reservoir](filling.md#beyond-the-ends-of-the-vessel) as near as straight ends allow",
            "18 % of the particles of the material's own size",
            "none seen: 7.1 ± 0.3 in place of 6.8 ± 0.4 % from the limit, enlarged 1.5 times",
            "yes",
        ),
        (
            "[softness](dem_settings.md) chosen by overlap",
            "10 times from E = 10⁹ Pa",
            "3.4 % (< 5.5 %)",
            "yes",
        ),
        (
            "[mass scaling](mass_scaling.md)",
            "1.6 and 1.7 times for one travel of the plate",
            "1.8 % (< 2.4 %)",
            "yes",
        ),
        (
            "[walls set back](set_back.md)",
            "coarser particles for nearly the same error: in the reactor twice as large in place of 1.5 times",
            "less error in three vessels, no more in a hopper",
            "yes",
        ),
    ]
    return [
        "| lever | what it saves | what it does to the field | adopted |",
        "|---" * 4 + "|",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
    ]


def _speed(cost: Cost) -> float:
    """Particle-steps a second by the clock, the geometric mean of the rounds."""
    return float(np.exp(np.mean([np.log(row.particles * row.steps / row.clock) for row in cost.rows])))


def _command(made: Path) -> str:
    """What made a file or folder of the results."""
    what, factor, *youngs = made.name.removesuffix(".json").split("-")
    return " ".join([what, "--factor", factor, *(f"--youngs {one}" for one in youngs)])


def _cost_section(results: Path) -> list[str]:
    lines = [
        "## Processor time",
        "",
        *_paragraph(
            "Lists of neighbours are built when a particle has gone half the skin. The fastest ones are those that "
            "fall: the feed onto the bed, and solids in cavities. By LIGGGHTS' own log (`logs/` of a run) building "
            "lists takes a quarter of the time of the reactor enlarged 1.25 times, in a skin of 0.2 d. In a wider one "
            "they are built less often, and are longer. (Until 2026-11-30 decks were timed before anything fell, and "
            "a wider skin saved nothing.)"
        ),
    ]
    for folder in sorted(results.glob("run-*")):
        found = costs(read_rounds(folder), BASE)
        row = found[BASE].rows[0]
        lines += [
            f"`{_command(folder)}`: {row.particles} particles, {row.steps} steps, {len(found[BASE].rows)} rounds, "
            "one rank.",
            "",
            "| deck | µs a particle-step | over the first | neighbour builds | dangerous |",
            "|---" * 5 + "|",
            *(
                f"| {name} | {1e6 * one.each:.3f} | {one.ratio:.3f}"
                f"{'' if name == BASE else f' ± {one.error * one.ratio:.3f}'} | {one.rows[0].builds} | "
                f"{max(row.dangerous for row in one.rows)} |"
                for name, one in ((name, found[name]) for name in LEVERS if name in found)
            ),
            "",
        ]
    return lines


def _path_section(results: Path) -> list[str]:
    lines = []
    for path in sorted(results.glob("paths-*.json")):
        found = read_json(path, dict[str, dict[str, float]])
        steps = [*next(iter(found.values()))]
        lines += [
            "## Paths",
            "",
            *_paragraph(
                f"`{_command(path)}`: largest distance of any particle from itself "
                f"with a {BASE.replace('skin', 'skin of')}, in m, so many steps after the same moment. It is rounding "
                "at first; later some particle is off by less than a thousandth of a diameter, which does not grow. "
                "What it met differently was not looked into."
            ),
            f"| deck | {' | '.join(f'{step} steps' for step in steps)} |",
            "|---" * (1 + len(steps)) + "|",
            *(f"| {name} | {' | '.join(f'{of[step]:.1e}' for step in steps)} |" for name, of in found.items()),
            "",
        ]
    return lines


def _contact_section(results: Path) -> list[str]:
    lines = []
    for path in sorted(results.glob("contacts-*.json")):
        lines += [
            "## Contacts with walls",
            "",
            *_paragraph(
                f"`{_command(path)}`: what LIGGGHTS' `compute wall/gran/local` "
                "tells of 50 to 100 steps later, by which wall pressure and stress are made. It takes meshes only."
            ),
            "| deck | contacts with walls | of them in the outermost cylinder |",
            "|---" * 3 + "|",
            *(
                f"| {name} | {all_} | {outer} |"
                for name, (all_, outer) in read_json(path, dict[str, list[int]]).items()
            ),
            "",
        ]
    return lines


def _rank_section(results: Path) -> list[str]:
    lines = []
    for folder in sorted(results.glob("ranks-*")):
        found = costs(read_rounds(folder), "one rank")
        yielding = found["two ranks, that yield"].ratio / found["two ranks"].ratio
        loads = [row.load for one in found.values() for row in one.rows]
        lines += [
            "## Ranks on a busy machine",
            "",
            *_paragraph(
                f"`{_command(folder)}`, beside what else the machine did (load "
                f"average {min(loads):.1f} to {max(loads):.1f} on {os.cpu_count()} cores, part of it at a higher "
                "priority). Speed is by the clock, in particle-steps a second. Idle cores were not to be had; "
                "`granpipe calibrate` tells what two ranks gain there. On a busy machine no way of starting two ranks "
                "comes near one: neither ranks that yield while they wait nor ranks bound to cores. Ranks that yield "
                f"take {yielding:.0%} of the processor time from the others that ranks that wait take, and are no "
                "slower."
            ),
            "| way | µs a particle-step | over one rank | speed, each round | their geometric mean |",
            "|---" * 5 + "|",
        ]
        for name, one in ((name, found[name]) for name in RANKS if name in found):
            each = ", ".join(f"{row.particles * row.steps / row.clock / 1e6:.3f}" for row in one.rows)
            lines.append(f"| {name} | {1e6 * one.each:.2f} | {one.ratio:.2f} | {each} M | {_speed(one) / 1e6:.3f} M |")
        lines.append("")
    return lines


def _size_section(results: Path) -> list[str]:
    lines = [
        "## Numbers of particles",
        "",
        "`sizes --factor …`: the settled bed of the test reactor when the plate begins to sink, one rank.",
        "",
        "| coarse_grain_factor | particles | wall triangles | M particle-steps a second of one core |",
        "|---" * 4 + "|",
    ]
    for folder in sorted(results.glob("sizes-*"), reverse=True):
        rows = read_rounds(folder)
        (one,) = costs(rows, OWN).values()
        walls = WallRecord.read(moment(float(folder.name.removeprefix("sizes-")), results, 0).walls)
        start = float(np.mean([row.seconds for row in rows if row.lever == "start"]))
        rates = [1e-6 / row.each(start) for row in one.rows]
        lines.append(
            f"| {folder.name.removeprefix('sizes-')} | {one.rows[0].particles} | {sum(walls.triangles.values())} | "
            f"{np.mean(rates):.2f} ({min(rates):.2f} to {max(rates):.2f}) |"
        )
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "paths", "contacts", "ranks", "sizes", "page"])
    parser.add_argument("--factor", type=float, default=3.0, help="dem.coarse_grain_factor")
    parser.add_argument("--youngs", default="auto", help="contact.youngs_modulus")
    parser.add_argument("--levers", nargs="*", choices=list(LEVERS), default=list(LEVERS))
    parser.add_argument("--repeat", type=int, default=4)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--results", type=Path, default=Path("results-deck-levers"))
    options = parser.parse_args()
    results, factor = options.results, options.factor
    if options.what == "page":
        text = page(results)
        (HERE.parent / "docs" / "validation" / "deck_levers.md").write_text(text)
        print(text)
    elif options.what == "sizes":
        rounds(
            {OWN: Lever()},
            moment(factor, results, 0),
            results / f"sizes-{factor:g}",
            options.repeat,
            options.steps,
        )
    else:
        start = moment(factor, results, youngs=options.youngs)
        of = f"{factor:g}" if options.youngs == "auto" else f"{factor:g}-{options.youngs}"
        if options.what == "paths":
            paths(
                options.levers,
                start,
                results / f"paths-{of}.json",
                results / "work",
            )
        elif options.what == "contacts":
            contacts(start, results / f"contacts-{of}.json", results / "work")
        else:
            levers = RANKS if options.what == "ranks" else {name: LEVERS[name] for name in options.levers}
            rounds(
                levers,
                start,
                results / f"{options.what}-{of}",
                options.repeat,
                options.steps,
            )


if __name__ == "__main__":
    main()
