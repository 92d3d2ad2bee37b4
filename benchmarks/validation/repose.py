"""The free surface below a widening against the angle of repose of heaps."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import free_surface
import numpy as np

from granpipe.system.jsonfile import read_json
from validation.case import Case, Data, Verdict, file_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRICTIONS = ((0.3, 0.05), (0.5, 0.1), (0.73, 0.21))
FILLINGS = (60.0, 80.0)
SECONDS = 1.5
TOLERANCE = 5.0  # degrees


def widening(folder: Path, friction: float, rolling: float, filling: float) -> Data:
    """The angle of the flowing surface [°] and its standard error, of one filling."""
    scene = free_surface.Scene(friction, rolling, filling)
    if not (folder / f"{scene.name}.json").exists():
        free_surface.run(scene, folder, SECONDS, flow=True)
    angle, error = read_json(folder / f"{scene.name}.json")["angles"]["flowing"]
    return {"friction": friction, "rolling": rolling, "filling": filling, "angle": angle, "error": error}


def zhou(friction: float, rolling: float) -> float:
    """Angle of repose [°] of Zhou et al. 2002, 68.61 μ_pp^0.27 μ_pw^0.22 μ_r,pp^0.06 μ_r,pw^0.12 d^−0.2.

    d and the arms μ_r of rolling resistance in mm: LIGGGHTS' coefficient times the reduced radius, d/4 between
    particles and d/2 on a wall.
    """
    d = free_surface.DIAMETER
    sliding = friction**0.27 * friction**0.22
    return float(68.61 * sliding * (rolling * d / 4) ** 0.06 * (rolling * d / 2) ** 0.12 * d**-0.2)


def angles(data: Data) -> dict[tuple[float, float], tuple[float, float]]:
    """(μ, μ_r) → mean of the fillings and its standard error [°]."""
    found = {}
    for pair in FRICTIONS:
        ones = [(one["angle"], one["error"]) for one in data.values() if (one["friction"], one["rolling"]) == pair]
        if ones:
            values, errors = np.array(ones).T
            found[pair] = float(values.mean()), float(np.sqrt((errors**2).sum()) / len(errors))
    return found


def judge(data: Data) -> list[Verdict]:
    verdicts = []
    for (friction, rolling), (angle, error) in angles(data).items():
        expected = zhou(friction, rolling)
        off = abs(angle - expected)
        passed = True if off <= TOLERANCE else (False if off - 1.96 * error > TOLERANCE else None)
        label = f"angle, μ = {friction:g}, μ_r = {rolling:g}"
        verdicts.append(Verdict(label, f"{expected:.1f}°", f"{angle:.1f} ± {1.96 * error:.1f}°", passed))
    return verdicts


def draw(data: Data, figure: Figure) -> None:
    axes = figure.add_subplot()
    for (friction, rolling), (angle, error) in angles(data).items():
        axes.errorbar(zhou(friction, rolling), angle, 1.96 * error, fmt="o", label=f"μ {friction:g}, μ_r {rolling:g}")
    line = np.array([15.0, 40.0])
    axes.plot(line, line, "k-", lw=0.8)
    axes.fill_between(line, line - TOLERANCE, line + TOLERANCE, color="0.9")
    axes.set(xlabel="angle of repose by Zhou et al., °", ylabel="free surface below a widening, °")
    axes.legend(fontsize=8)


CASE = Case(
    name="repose",
    title="The free surface below a widening",
    about="""
        Below a sudden widening of 7 d a free surface forms while the core flows ([its own page](free_surface.md)).
        Its angle, the mean of two ways of filling, stands beside the correlation that Zhou et al. fitted to heaps of
        coarse spheres, measured and simulated, of 2 to 10 mm. ±: 95 %, from 8 sectors of each filling.
    """,
    source="""
        Zhou, Xu, Yu & Zulli, Powder Technology 125, 45 (2002), with rolling resistance as a length in mm. The formula
        is written from memory, not verified: no text of it could be looked up.
    """,
    criterion="""
        Within 5° of the correlation, about the scatter of heaps from one way of building them to another. (The angles
        had been measured before this criterion was written.)
    """,
    pieces={
        file_name(friction, rolling, filling): partial(widening, friction=friction, rolling=rolling, filling=filling)
        for friction, rolling in FRICTIONS
        for filling in FILLINGS
    },
    judge=judge,
    draw=draw,
)
