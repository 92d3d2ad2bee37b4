"""What error of a fluid is to be expected: its errors against DEM in the scenes of `benchmarks/friction_fluid.py`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NotRequired, TypedDict

import numpy as np

_DATA = Path(__file__).with_name("friction_error.json")

Rheology = Literal["viscous", "frictional"]
Kind = Literal["floor", "free surface", "hopper", "pipe"]

FEWEST_SCENES = 3
"""Scenes of a kind with which its error counts as known."""

BEYOND = 0.1
"""Part by which a scene may lie beyond the range of those whose error is known."""


class _Result(TypedDict):
    error: float
    sensitivity: NotRequired[float]


@dataclass(frozen=True)
class Scene:
    """What of a vessel and its material the error of a fluid depends on.

    Parameters
    ----------
    kind : by what is hardest to describe in it
    half_angle : of the flattest wall that is no floor, from the vertical [°]
    opening : gap of the narrowest opening over the particles' Sauter diameter
    internal, wall : friction of the bulk, and on its walls
    open_outlet : the solids leave freely, not on a plate
    """

    kind: Kind
    half_angle: float
    opening: float
    internal: float
    wall: float
    open_outlet: bool


@dataclass(frozen=True)
class _Row:
    """Line of the table: a scene, and what the fluids come to in it; a fluid that is refused there is missing."""

    scene: Scene
    results: dict[Rheology, _Result]


@dataclass(frozen=True)
class ExpectedError:
    """Error over the whole vessel against DEM of the same particles, noise taken off, in some scenes of one kind.

    Parameters
    ----------
    kind : of the scenes
    mean, least, worst : of the error
    worst_scene : where it is largest
    scenes : how many there are
    sensitivity : mean change with the friction of the walls (± 20 %) and the angle of surfaces (± 5°); None for the
        viscous fluid, which has neither
    """

    kind: Kind
    mean: float
    least: float
    worst: float
    worst_scene: str
    scenes: int
    sensitivity: float | None

    def text(self) -> str:
        """For the user."""
        bar = "" if self.sensitivity is None else f", its friction and surfaces uncertain by ± {self.sensitivity:.0%}"
        return (
            f"{self.least:.0%} to {self.worst:.0%} wrong against DEM of {self.scenes} vessels of its kind "
            f"({self.kind}){bar}"
        )


def expected_error(rheology: Rheology, scene: Scene | None) -> ExpectedError | str:
    """Of a fluid in a scene, by scenes of its kind; or why it is not known."""
    if scene is None:
        return "its error is not known: no slab is in the table of scenes"
    own = {name: row for name, row in _table().items() if row.scene.kind == scene.kind}
    results = {name: row.results[rheology] for name, row in own.items() if rheology in row.results}
    if len(results) < FEWEST_SCENES:
        return f"its error is not known: of its kind ({scene.kind}) {len(results)} vessels are in the table of scenes"
    if beyond := _beyond(scene, [row.scene for row in own.values()]):
        return f"its error is not known: the vessels of its kind ({scene.kind}) in the table of scenes {beyond}"
    errors = {name: one["error"] for name, one in results.items()}
    worst = max(errors, key=errors.__getitem__)
    changes = [one["sensitivity"] for one in results.values() if "sensitivity" in one]
    return ExpectedError(
        kind=scene.kind,
        mean=float(np.mean([*errors.values()])),
        least=min(errors.values()),
        worst=errors[worst],
        worst_scene=worst,
        scenes=len(errors),
        sensitivity=float(np.mean(changes)) if changes else None,
    )


def _beyond(scene: Scene, others: list[Scene]) -> str:
    """How others differ from a scene that lies beyond their range; empty where it does not."""
    if scene.open_outlet and not any(one.open_outlet for one in others):
        return "stand on a plate, and its outlet is open"
    steepest, narrowest = max(one.half_angle for one in others), min(one.opening for one in others)
    if scene.half_angle > steepest * (1 + BEYOND):
        return f"have walls up to {steepest:.3g}° from the vertical, it up to {scene.half_angle:.3g}°"
    if scene.opening < narrowest * (1 - BEYOND):
        return f"have openings of {narrowest:.3g} d and more, it one of {scene.opening:.3g} d"
    for name, value, known in (
        ("bulk friction", scene.internal, [one.internal for one in others]),
        ("wall friction of the bulk", scene.wall, [one.wall for one in others]),
    ):
        if not min(known) * (1 - BEYOND) <= value <= max(known) * (1 + BEYOND):
            return f"have a {name} of {min(known):.2g} to {max(known):.2g}, it {value:.2g}"
    return ""


@cache
def _table() -> dict[str, _Row]:
    table = json.loads(_DATA.read_text())
    return {name: _Row(Scene(**row["scene"]), row["results"]) for name, row in table.items()}
