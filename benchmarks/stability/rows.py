"""The stability suite: its rows in dimensionless groups, and a truth test that knows nothing of granpipe's own checks.

A row is a variant of one of two small scenes. Whether it is stable is judged from particle dumps alone: nothing lost,
at rest when left alone, neither sinking nor squeezed, and following the plate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from granpipe.field import Particles

REST_ENERGY = 5e-5
"""Kinetic energy that nine tenths of the particles at rest stay below, in units of m g d: 1 % of √(g d) as a speed."""

SINKING = 0.02
"""Sinking of a bed at rest during the watch, in diameters, at most."""

DENSEST = 0.68
"""Packing of spheres that do not run into each other, at most; random close packing is 0.64."""

FOLLOWING = 0.3
"""Speed of the bed on the plate, relative to the plate's: deviation at most. Beds loosen while they start, and rough
walls hold them back; one that falls or hangs is far beyond."""

LEAST_FOR_DRIFT = 20  # snapshots
DRIFT = 10.0
"""Median kinetic energy in the last third of a run over that in the first, in which the bed starts, at most."""

CHOICES = ("contact.youngs_modulus", "dem.time_step", "dem.plate_speed", "dem.facets")
"""Keys of what granpipe chooses unless the case does."""

SIMILAR = "similar"
Scene = Literal["column", "wide column", "reactor"]
Verdict = Literal["done", "flagged", "refused", "stopped"]


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Parameters
    ----------
    group : what is varied
    value : of the group
    scene : that is varied
    changes : dotted keys of the case with YAML text
    multiples : dotted keys with multiples of the scene's own measure: the Rayleigh time for times, the automatic plate
        speed, the Young's modulus at which E* is the weight of the bed
    scale : length and density of a similar scene over those of the scene
    patience : how many times longer than others the bed takes to rest: weakly damped ones slosh
    """

    group: str
    value: float
    scene: Scene = "column"
    changes: Mapping[str, str] = field(default_factory=dict)
    multiples: Mapping[str, float] = field(default_factory=dict)
    scale: tuple[float, float] = (1.0, 1.0)
    patience: float = 1.0

    @property
    def name(self) -> str:
        """Of its folder."""
        words = f"{self.scene} {self.group} {self.value:g}"
        return "".join(c if c.isalnum() or c == "." else "-" for c in words.lower())

    @property
    def similar(self) -> bool:
        """Whether the row is a scene at another scale, or the model of such scenes."""
        return self.group.startswith(SIMILAR)

    @property
    def chosen(self) -> bool:
        """Whether granpipe chooses all settings of this row."""
        return not self.similar and not any(key in {*self.changes, *self.multiples} for key in CHOICES)


@dataclass(frozen=True)
class Truth:
    """What the dumps say of a row; None where there was nothing to see.

    Parameters
    ----------
    lost : particles that were inserted and are not there
    energy : kinetic energy that nine tenths of the particles left alone stay below, in units of m g d; one that rattles
        in a hole may take long to rest
    sinking : of its centre of mass during the watch, in diameters
    packing : where it is widest filled
    following : mean speed of the bed on the plate over the plate's
    drift : kinetic energy in the last third of a run over that in the first
    broken : what LIGGGHTS said if it gave up
    """

    lost: int = 0
    energy: float | None = None
    sinking: float | None = None
    packing: float | None = None
    following: float | None = None
    drift: float | None = None
    broken: str = ""

    @property
    def faults(self) -> tuple[str, ...]:
        """Why the row is not stable; empty where it is."""
        return tuple(self._faults())

    def _faults(self) -> Iterator[str]:
        if self.broken:
            yield self.broken
        if self.lost:
            yield f"{self.lost} particles lost"
        if self.energy is not None and not self.energy <= REST_ENERGY:
            yield f"no rest: {self.energy:.1e} m g d"
        if self.sinking is not None and not self.sinking <= SINKING:
            yield f"sinks {self.sinking:.2g} d"
        if self.packing is not None and not self.packing <= DENSEST:
            yield f"squeezed to {self.packing:.2f}"
        if self.following is not None and not abs(self.following - 1) <= FOLLOWING:
            yield f"moves at {self.following:.2f} of the plate's speed"
        if self.drift is not None and not self.drift <= DRIFT:
            yield f"kinetic energy grows {self.drift:.2g} times"


def rest_truth(beds: Sequence[Particles], gravity: float, span: tuple[float, float], radius: float) -> Truth:
    """What a bed that was left alone shows.

    Parameters
    ----------
    beds : in order of time
    gravity : [m/s²]
    span : lower and upper level of a straight piece of the vessel that is full [m]
    radius : of the vessel there [m]
    """
    last = beds[-1]
    lost = missing(beds)
    if lost > len(last.id) or not len(last.id):
        return Truth(lost=lost, broken="" if lost else "no particle is left")
    diameter = 2 * float(last.radius.mean())
    energy = [0.5 * float(np.quantile(np.sum(bed.velocity**2, axis=1), 0.9)) for bed in beds]
    heights = [float(np.average(bed.position[:, 2], weights=bed.radius**3)) for bed in beds]
    return Truth(
        lost=lost,
        energy=float(np.mean(energy)) / (gravity * diameter),
        sinking=(heights[0] - heights[-1]) / diameter,
        packing=_packing(last, span, radius),
    )


def missing(beds: Sequence[Particles]) -> int:
    """Particles that are not in the last bed: they are numbered as they are inserted."""
    return max(int(bed.id.max(initial=0)) for bed in beds) - len(beds[-1].id)


def _packing(bed: Particles, span: tuple[float, float], radius: float) -> float:
    """Solids fraction between two levels of a straight pipe; spheres are cut at the levels."""
    z, a = bed.position[:, 2], bed.radius
    low, high = (np.clip(level - z, -a, a) for level in span)
    solids = np.pi * ((a**2 * high - high**3 / 3) - (a**2 * low - low**3 / 3))
    return float(solids.sum() / (math.pi * radius**2 * (span[1] - span[0])))


def flow_truth(times: Sequence[float], beds: Sequence[Particles], speed: float, plate_z: float, outlet: float) -> Truth:
    """What a bed on a sinking plate shows; nothing where there are too few snapshots.

    Parameters
    ----------
    times : of the beds, rising [s]
    speed : of the plate, downwards [m/s]
    plate_z : level of the plate at time 0 [m]
    outlet : level of the outlet [m]
    """
    if len(beds) < 3:
        return Truth()
    energy = [float(np.average((bed.velocity**2).sum(axis=1), weights=bed.radius**3)) for bed in beds]
    third = len(beds) // 3
    return Truth(
        lost=missing(beds),
        following=_following(times, beds, speed, plate_z, outlet),
        drift=float(np.median(energy[-third:]) / np.median(energy[:third])) if len(beds) >= LEAST_FOR_DRIFT else None,
    )


def _following(
    times: Sequence[float], beds: Sequence[Particles], speed: float, plate_z: float, outlet: float
) -> float | None:
    """Mean speed of the mass between plate and outlet over the plate's, by displacement, in the second half.

    By number the small ones would count that trickle through the pores of a bed of very different sizes.
    """
    moved = mass = 0.0
    half = len(beds) // 2
    for (t0, before), (t1, after) in pairwise(list(zip(times, beds, strict=True))[half:]):
        _, i, j = np.intersect1d(before.id, after.id, return_indices=True)
        z0, z1, a = before.position[i, 2], after.position[j, 2], before.radius[i]
        on_plate = (z0 > plate_z - speed * t0 + a) & (z0 < outlet)
        moved += float(((z0 - z1) * a**3)[on_plate].sum() / (speed * (t1 - t0)))
        mass += float((a**3)[on_plate].sum())
    return moved / mass if mass else None


@dataclass(frozen=True)
class Judged:
    """A row with what granpipe said of it and what the dumps say.

    Parameters
    ----------
    said : the reason that granpipe gave
    rest, flow : what the dumps of the bed left alone, and those of granpipe's own run, say
    """

    row: Row
    verdict: Verdict
    said: str
    rest: Truth
    flow: Truth

    @property
    def faults(self) -> tuple[str, ...]:
        """Why the row is not stable; empty where it is."""
        return (*self.rest.faults, *self.flow.faults)

    @property
    def stable(self) -> bool:
        """Whether the dumps say so."""
        return not self.faults

    @property
    def wrong(self) -> str:
        """What is wrong with granpipe's word: empty where nothing is."""
        if self.row.chosen and self.verdict != "refused" and not self.stable:
            return "granpipe's own settings are not stable"
        if not self.stable and self.verdict == "done":
            return "missed"
        if self.stable and self.verdict == "stopped":
            return "false alarm"
        return ""


_SMALL = {"outline.wall": "[[0.055, 0.04], [0.055, 0]]", "dem.reservoir_height": "0.04", "dem.max_time": "0.5"}
_SMALLEST = _SMALL | {"outline.wall": "[[0.05, 0.02], [0.05, 0]]", "dem.reservoir_height": "0.03"}
"""Less and less of the column, for rows of many steps."""


def rows() -> list[Row]:
    """The whole table."""
    return list(_rows())


def _rows() -> Iterator[Row]:
    for model in ("epsd2", "cdt", "none"):
        friction = "0" if model == "none" else "0.1"
        kind = {"contact.rolling_model": model, "contact.rolling_friction": friction}
        for share in (0.05, 0.1, 0.16, 0.2, 0.24, 0.3, 0.4, 0.6, 0.8, 1.2):
            yield Row(f"dt/T_R, {model}", share, changes=kind, multiples={"dem.time_step": share})
    for restitution, shares in (("0.06", (0.05, 0.09, 0.13, 0.2)), ("0.9", (0.2, 0.28, 0.36, 0.44))):
        for share in shares:
            kind = {"contact.restitution": restitution}
            yield Row(f"dt/T_R, e = {restitution}", share, changes=kind, multiples={"dem.time_step": share})
    for share in (0.16, 0.4, 0.8):
        yield Row("dt/T_R, epsd2", share, "reactor", multiples={"dem.time_step": share})
    for ratio in (5, 20, 100, 500, 2000, 10_000):
        yield Row("E*/(ρgH)", ratio, multiples={"contact.youngs_modulus": ratio})
    for ratio in (20, 100):
        yield Row("E*/(ρgH)", ratio, "reactor", multiples={"contact.youngs_modulus": ratio})
    for modulus in ("5e6", "5e7", "4.7e9"):
        yield Row("E in Pa", float(modulus), changes=_SMALL | {"contact.youngs_modulus": modulus})
    for scene, factors in (("column", (0.1, 1, 3, 10, 100)), ("reactor", (0.3, 3, 30))):
        for factor in factors:
            yield Row("plate speed over the automatic", factor, scene, multiples={"dem.plate_speed": factor})  # type: ignore[arg-type]
    yield from _materials()
    yield from _shapes()
    yield Row("ranks", 1, "reactor", {"dem.ranks": "1"})
    yield Row("ranks", 2, "reactor", {"dem.ranks": "2"})
    yield Row("steps", 1e6, changes=_SMALLEST, multiples={"dem.plate_speed": 0.005, "dem.max_time": 1.7e5})
    for scale in ((1.0, 1.0), (0.005, 1.0), (15.0, 1.0), (1.0, 0.01), (1.0, 20.0)):
        yield Row(f"{SIMILAR}, density ×{scale[1]:g}, length ×", scale[0], "reactor", scale=scale)


def _materials() -> Iterator[Row]:
    for restitution in (0.06, 0.3, 0.7, 0.99, 1.0):
        patience = 5.0 if restitution >= 0.99 else 1.0
        yield Row("restitution", restitution, changes={"contact.restitution": str(restitution)}, patience=patience)
    yield Row("restitution, no friction", 1, changes={"contact.restitution": "1", "contact.friction": "0"})
    for friction in (0.0, 0.05, 0.73, 1.2):
        patience = 5.0 if friction == 0 else 1.0
        longer = {"dem.max_time": "3.6"} if friction > 1 else {}  # the start takes longer to pass through the bed
        yield Row("friction", friction, changes={"contact.friction": str(friction)} | longer, patience=patience)
    for model in ("epsd2", "cdt"):
        for rolling in (0.05, 0.5):
            changes = {"contact.rolling_model": model, "contact.rolling_friction": str(rolling)}
            yield Row(f"rolling friction, {model}", rolling, changes=changes)
    for poisson in (0.0, 0.2, 0.5):
        yield Row("Poisson's ratio", poisson, changes={"contact.poisson": str(poisson)})
    for ratio in (2, 3, 5, 10):
        yield Row("size ratio", ratio, changes={"material.size": _two_sizes(0.02, ratio)})


def _two_sizes(diameter: float, ratio: float) -> str:
    """As many small spheres as large ones."""
    small, large = diameter / ratio, diameter
    edges = [0.99 * small, 1.01 * small, 0.99 * large, 1.01 * large]
    return f"{{diameter: {{sieve: {{edges: {edges}, fractions: [0.5, 0, 0.5]}}}}, by: number}}"


def _shapes() -> Iterator[Row]:
    for ratio in (2, 3, 4, 5.5, 8, 20):
        radius = 0.01 * ratio
        yield Row("D/d", ratio, "wide column", {"outline.wall": f"[[{radius}, 0.1], [{radius}, 0]]"})
    for factor in (1, 2, 3, 4):
        yield Row("coarse graining", factor, "wide column", {"dem.coarse_grain_factor": str(factor)})
    for facets in (8, 16, 32, 128):
        yield Row("facets per turn", facets, changes={"dem.facets": str(facets)})
    hat = {"outline.obstacles": "{hat: [[0, 0.08], [0, 0.02], [0.08, 0.02]]}"}
    yield Row("apex of a cone on the axis", 1, "wide column", hat)
    yield Row("apex of the hopper on the axis", 1, changes={"outline.wall": "[[0.06, 0.1], [0.06, 0.08], [0, 0]]"})


def subset(all_rows: Iterable[Row]) -> list[Row]:
    """The few rows of a quick check: the automatic settings, a breach of each kind, a refusal."""
    wanted = {
        ("dt/T_R, epsd2", 0.4, "column"),
        ("E*/(ρgH)", 20, "column"),
        ("restitution", 0.3, "column"),
        ("restitution, no friction", 1, "column"),
    }
    return [row for row in all_rows if (row.group, row.value, row.scene) in wanted]
