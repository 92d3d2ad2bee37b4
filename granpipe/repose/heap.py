"""One heap: a bed behind a gate that is lowered step by step, and the slope at which it comes to rest each time.

The bed lies on a floor between a smooth wall, which stands for the plane of symmetry of a whole heap, and a gate; it is
periodic along the heap. The gate sinks by a particle diameter, what lies above its edge runs off, the rest comes to
rest, and so on: each step is a new slope of the same heap, drained slowly and without the impact of pouring. The angle
does not depend on size, density or gravity, so lengths are in Sauter diameters d, masses in ρ d³, times in √(d/g).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.deck import DUMP_COLUMNS, MaterialDeck, render
from granpipe.dem.dump import read_snapshot
from granpipe.dem.filling import PACKING
from granpipe.dem.run import Liggghts, Limits, Status
from granpipe.dem.sizes import SizeClasses, size_classes
from granpipe.dem.snapshot import Snapshot
from granpipe.dem.step import SKIN, step_limits
from granpipe.errors import CaseError, DataError
from granpipe.field import Array

LENGTH, WIDTH, LEDGE = 14.0, 5.0, 2.5
"""Of the heap from the wall to the gate, along it, and height of the gate's edge at the end."""

DROPS, DISCARDED = 6, 2
"""Times that the heap comes to rest, the gate sinking by a diameter in between, and how many are left out at first:
they may bear the filling."""

FILL_ANGLE = math.radians(42)
"""Of the bed before the gate sinks: steeper than spheres stand."""

GATE_SPEED = 0.5

FALL_TIME, CHUNK_TIME, REST_CHUNKS = 12.0, 2.0, 30
"""In which the loose bed falls together; between two looks whether the heap is at rest, and the most looks."""

REST_ENERGY = 1e-3
"""Mean kinetic energy of a heap at rest: it could lift the particles by a thousandth of a diameter."""

LOOSE = 0.28
"""Packing of the spheres at random places from which the bed falls together."""

MOST_PARTICLES = 10_000
"""Of a heap. Sizes of one to five take some 1 400, of one to twenty some 3 600; far wider ones would take days."""

END = 2.0
"""Left out of the slope at either end: the crest is round, and the foot rests on the gate."""

_TRIES = 8  # places tried at a time
_PROBES = 4  # rays per diameter by which the surface is found


@dataclass(frozen=True)
class Pair:
    """Sliding friction μ and rolling friction μ_r between particles."""

    friction: float
    rolling: float


FILLING = Pair(1.0, 0.5)
"""While the bed falls together, so that it stays steeper than it will stand."""


@dataclass(frozen=True)
class HeapDeck(MaterialDeck):
    """All values that the template of a heap uses, in units of the heap."""

    friction_asked: tuple[float, ...]
    rolling_asked: tuple[float, ...]
    fall_steps: int
    chunk_steps: int
    rest_chunks: int
    rest_energy: float
    lower_steps: int
    gate_speed: float
    drops: int
    thermo_every: int


@dataclass(frozen=True)
class Heap:
    """A heap that is to be run: what LIGGGHTS reads.

    Parameters
    ----------
    deck : text of ``heap.in``
    bed : text of ``bed.txt``, the spheres before they fall
    steps, particles : of the run; at its start
    """

    deck: str
    bed: str
    steps: int
    particles: int


def make_heap(case: Case, pair: Pair, seed: int) -> Heap:
    """The heap of a case's particles with another friction.

    Parameters
    ----------
    seed : of sizes and places

    Raises
    ------
    CaseError : the sizes are so different that a heap would hold too many particles
    """
    classes = size_classes(case.material.size)
    classes = classes.enlarged(1 / classes.sauter_diameter)
    radius, position = _loose_bed(classes, seed)
    deck = _deck(case, pair, classes)
    return Heap(
        render(deck, "heap.in"),
        _bed_text(radius, position),
        deck.fall_steps + deck.drops * (deck.lower_steps + deck.rest_chunks * deck.chunk_steps),
        len(radius),
    )


def run_heap(heap: Heap, folder: Path) -> Iterator[Status]:
    """Run it in a folder; a few times a second the status.

    Raises
    ------
    RunError : LIGGGHTS did not end well
    """
    (folder / "heap.in").write_text(heap.deck)
    (folder / "bed.txt").write_text(heap.bed)
    gate = LEDGE + DROPS
    (folder / "floor.stl").write_text(_stl([(0, 0, 0), (LENGTH, 0, 0), (LENGTH, WIDTH, 0), (0, WIDTH, 0)]))
    (folder / "gate.stl").write_text(
        _stl([(LENGTH, 0, 0), (LENGTH, WIDTH, 0), (LENGTH, WIDTH, gate), (LENGTH, 0, gate)])
    )
    limits = Limits.of(heap.particles, 1, heap.steps, 1.0)
    with Liggghts("heap.in", folder, 1, {}, limits) as process:
        yield from process.wait()


def read_slopes(folder: Path) -> list[float]:
    """Slope, tan of the angle, each time that the heap came to rest.

    Raises
    ------
    DataError : snapshots are missing or damaged, or the heap does not lie in its box
    """
    files = sorted(folder.glob("rest.*.bin"), key=lambda path: int(path.name.split(".")[1]))
    if len(files) != DROPS:
        raise DataError(f"{folder}: {len(files)} snapshots of a heap, {DROPS} expected")
    return [slope(read_snapshot(path, DUMP_COLUMNS)) for path in files]


def read_motion(folder: Path) -> list[float]:
    """Mean kinetic energy each time that the heap came to rest; more than `REST_ENERGY` where the wait was too short.

    Raises
    ------
    DataError : LIGGGHTS did not print it
    """
    found = re.findall(
        r"^granpipe: rested \d+ (\S+)$", (folder / "output.txt").read_text(errors="replace"), re.MULTILINE
    )
    try:
        values = [float(one) for one in found]
    except ValueError:
        values = []
    if len(values) != DROPS:
        raise DataError(f"{folder / 'output.txt'}: {len(values)} energies of a heap at rest, {DROPS} expected")
    return values


def slope(snapshot: Snapshot) -> float:
    """Slope of the surface, tan of its angle, by least squares over where rays from above first meet a particle.

    Raises
    ------
    DataError : there is a place without particles
    """
    (x, y, z), r = snapshot.position.T, snapshot.radius
    nx, ny = round((LENGTH - 2 * END) * _PROBES), round(WIDTH * _PROBES)
    at_x, at_y = END + (np.arange(nx) + 0.5) / _PROBES, (np.arange(ny) + 0.5) / _PROBES
    height = np.full((nx, ny), -np.inf)
    for one in range(len(r)):
        dx, dy = at_x - x[one], at_y - y[one]
        dy -= WIDTH * np.round(dy / WIDTH)
        near_x, near_y = np.flatnonzero(np.abs(dx) < r[one]), np.flatnonzero(np.abs(dy) < r[one])
        if len(near_x) and len(near_y):
            cap = r[one] ** 2 - dx[near_x, None] ** 2 - dy[None, near_y] ** 2
            top = np.where(cap > 0, z[one] + np.sqrt(np.maximum(cap, 0)), -np.inf)
            cells = np.ix_(near_x, near_y)
            height[cells] = np.maximum(height[cells], top)
    if not np.isfinite(height).any(axis=1).all():
        raise DataError("a heap without particles at some place")
    profile = np.where(np.isfinite(height), height, 0).sum(axis=1) / np.isfinite(height).sum(axis=1)
    return float(-np.polyfit(at_x, profile, 1)[0])


def _deck(case: Case, pair: Pair, classes: SizeClasses) -> HeapDeck:
    tall = LEDGE + 0.5 * DROPS + LENGTH * math.tan(FILL_ANGLE)
    youngs = contact.softened_modulus(0.5 * PACKING * tall, PACKING * tall, case.contact.poisson)
    youngs = contact.two_digits_up(youngs * contact.wall_stiffening(classes.largest / classes.smallest))
    skin = contact.two_digits(SKIN * classes.mean_diameter)
    step = _time_step(case, classes, youngs, skin)
    model = f"model hertz tangential history rolling_friction {case.contact.rolling_model}"
    lower, chunk = round(1 / GATE_SPEED / step), round(CHUNK_TIME / step)
    return HeapDeck(
        contact_model=model,
        types=2,
        youngs_modulus=youngs,
        poisson=case.contact.poisson,
        restitution=(case.contact.restitution,) * 4,
        friction=(FILLING.friction, 0.0, 0.0, 0.0),
        rolling_model=True,
        rolling_friction=(FILLING.rolling, 0.0, 0.0, 0.0),
        friction_asked=(pair.friction, 0.0, 0.0, 0.0),
        rolling_asked=(pair.rolling, 0.0, 0.0, 0.0),
        characteristic_velocity=None,
        gravity=1.0,
        time_step=step,
        skin=skin,
        fall_steps=round(FALL_TIME / step),
        chunk_steps=chunk,
        rest_chunks=REST_CHUNKS,
        rest_energy=REST_ENERGY,
        lower_steps=lower,
        gate_speed=1 / (lower * step),
        drops=DROPS,
        thermo_every=chunk,
    )


def _time_step(case: Case, classes: SizeClasses, youngs: float, skin: float) -> float:
    """By the rules of `granpipe.dem.settings`; the fastest particle falls through the loose bed."""
    speed = math.sqrt(2 * _loose_height(0.0))
    limits = step_limits(case.contact, case.contact.restitution, classes.smallest, 1.0, youngs, speed, skin)
    return contact.two_digits(min(limits.values()))


def _loose_height(x: float) -> float:
    """Of the spheres before they fall, at a distance from the wall."""
    return PACKING / LOOSE * (LEDGE + DROPS + (LENGTH - x) * math.tan(FILL_ANGLE))


def _loose_bed(classes: SizeClasses, seed: int) -> tuple[Array, Array]:
    """Radii (n,) and places (n, 3) at random, none touching another, the largest placed first."""
    random = np.random.default_rng(seed)
    high, low = _loose_height(0.0), _loose_height(LENGTH)
    number = round(LOOSE * 0.5 * LENGTH * (high + low) * WIDTH / classes.mean_volume)
    if number > MOST_PARTICLES:
        raise CaseError(
            f"a heap of these sizes holds {number:.3g} particles, {MOST_PARTICLES} at the most; leave out the finest",
            ("material", "size"),
        )
    radius = np.sort(random.choice(classes.radius, number, p=classes.number_share))[::-1]
    place = np.empty((number, 3))
    for i, r in enumerate(radius):
        for _ in count():
            x, y = random.uniform(r, LENGTH - r, _TRIES), random.uniform(0, WIDTH, _TRIES)
            z = random.uniform(r, high, _TRIES)
            wanted = np.stack([x, y, z], axis=1)[z < high + (low - high) * x / LENGTH]
            apart = wanted[:, None] - place[:i]
            apart[..., 1] -= WIDTH * np.round(apart[..., 1] / WIDTH)
            free = (np.sum(apart**2, axis=2) > (radius[:i] + r) ** 2).all(axis=1)
            if free.any():
                place[i] = wanted[free.argmax()]
                break
    return radius, place


def _bed_text(radius: Array, place: Array) -> str:
    low, high = -(LEDGE + DROPS), _loose_height(0.0) + 2
    lines = ["", "", f"{len(radius)} atoms", "2 atom types", f"0 {LENGTH + 1.5:g} xlo xhi", f"0 {WIDTH:g} ylo yhi"]
    lines += [f"{low - 2:g} {high:g} zlo zhi", "", "Atoms", ""]
    for number, (r, (x, y, z)) in enumerate(zip(radius, place, strict=True), start=1):
        lines.append(f"{number} 1 {2 * r:.6f} 1.0 {x:.6f} {y:.6f} {z:.6f}")
    return "\n".join([*lines, ""])


def _stl(corners: list[tuple[float, float, float]]) -> str:
    """A rectangle as two triangles."""
    lines = ["solid wall"]
    for triangle in ((corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])):
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x:g} {y:g} {z:g}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid wall", ""])
