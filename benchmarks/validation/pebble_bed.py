"""Pebble bed above a funnel, after Rycroft et al. (2006): plug, wall layer, slow corner, residence times."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granpipe.field import Field
from validation.case import Case, Data, Verdict, file_name
from validation.simulate import rounded, run_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIAMETER = 60e-3
ANGLES = (30.0, 60.0)  # of the funnel, from the horizontal
RADIUS, OUTLET, STRAIGHT = 10.0, 3.5, 14.0  # of the vessel, of its outlet pipe, height of the straight part [d]
SECONDS = 14.0
PLUG = 0.10  # RMS deviation from the mean
LAYER = 5.0  # d, where 95 % of the speed of the core are reached at the latest
SPREADS = 1.2  # (P90 − P10)/P50 of the residence times in the 30° vessel over that in the 60° vessel


def funnel(angle: float) -> float:
    """Height of the funnel's upper end above the plate's level [d]; its lower end is at 1 d."""
    return 1 + (RADIUS - OUTLET) * math.tan(math.radians(angle))


def text(name: str, angle: float) -> str:
    top = funnel(angle) + STRAIGHT
    corners = ((RADIUS, top), (RADIUS, funnel(angle)), (OUTLET, 1.0), (OUTLET, 0.0))
    wall = ", ".join(f"[{r * DIAMETER:.8g}, {z * DIAMETER:.8g}]" for r, z in corners)
    levels = [f"{z * DIAMETER:.8g}" for _, z in corners]
    return f"""\
name: {name}
outline:
  unit: m
  wall: [{wall}]
  sections: {{core: [{levels[0]}, {levels[1]}], funnel: [{levels[1]}, {levels[2]}], pipe: [{levels[2]}, {levels[3]}]}}
material:
  density: 1700 kg/m^3
  size: {{diameter: {DIAMETER:g} m}}
contact: {{friction: 0.7, rolling_friction: 0, wall: {{friction: 0.7, rolling_friction: 0}}}}
flow_rate: 1 kg/s
model: dem
dem: {{max_time: {SECONDS:g} s, ranks: 1}}
homogenize: {{fields: [residence_time]}}
export: []
figures: []
"""


def vessel(folder: Path, angle: float) -> Data:
    """One vessel: profiles of the speed of the pebbles, and their residence times."""
    name = file_name("pebbles", angle)
    field, figures = run_scene(name, text(name, angle), folder)
    found = figures["residence_time_s"]
    return {
        "angle": angle,
        "failed": figures["failed"],
        "seconds": figures["averaged_to_s"] - figures["averaged_from_s"],
        "radius": rounded(field.grid.r_centres / DIAMETER),
        "profiles": {
            "plug": rounded(speed(field, funnel(angle) + 1.0 * RADIUS, 4.0)),
            "corner": rounded(speed(field, funnel(angle) - 1.0, 1.0)),
        },
        "residence": rounded([found[name] for name in ("P10", "P50", "P90")]),
    }


def speed(field: Field, height: float, band: float) -> np.ndarray:
    """Downward speed of the solids, flux over packing, in a band of heights around `height` [d]."""
    z = field.grid.z_centres / DIAMETER
    rows = np.abs(z - height) <= 0.5 * band
    assert field.packing_fraction is not None
    flux = -0.5 * (field.flux_z[:-1] + field.flux_z[1:])[rows].sum(axis=0)
    packing = field.packing_fraction[rows].sum(axis=0)
    return np.asarray(np.divide(flux, packing, out=np.zeros_like(flux), where=packing > 0))


def measures(one: Data) -> dict[str, float]:
    """Figures of one vessel; speeds relative to the mean of the core at the same height."""
    radius = np.asarray(one["radius"])
    area = radius * ((radius > 0) & (radius < RADIUS))

    def mean(profile: np.ndarray, where: np.ndarray) -> float:
        return float((profile * area)[where].sum() / area[where].sum())

    plug, corner = (np.asarray(one["profiles"][name]) for name in ("plug", "corner"))
    core = radius < RADIUS - LAYER
    level = mean(plug, core)
    deviation = math.sqrt(mean((plug / level - 1) ** 2, core))
    slow = np.flatnonzero((plug < 0.95 * level) & (radius < RADIUS) & (radius > RADIUS - 1.2 * LAYER))
    layer = RADIUS - float(radius[slow[0]]) if len(slow) else 0.0
    edge = RADIUS - 1.0 / math.tan(math.radians(one["angle"])) - 1.0  # one diameter from the funnel's wall
    at_wall = (radius > edge) & (radius < edge + 1.0)
    at_axis = radius < OUTLET
    low, half, high = one["residence"]
    return {
        "plug": deviation,
        "wall": mean(plug, (radius > RADIUS - 1) & (radius < RADIUS)) / level,
        "layer": layer,
        "corner": mean(corner, at_wall) / mean(corner, at_axis),
        "spread": (high - low) / half,
    }


def judge(data: Data) -> list[Verdict]:
    verdicts = []
    found = {one["angle"]: measures(one) for one in data.values()}
    for angle, one in found.items():
        at = f"funnel of {angle:g}°"
        verdicts.append(
            Verdict(
                f"plug above, {at}", "RMS deviation at most 10 %", f"{100 * one['plug']:.1f} %", one["plug"] <= PLUG
            )
        )
        verdicts.append(
            Verdict(
                f"layer along the wall, {at}", "slower there, at most 5 d thick",
                f"{one['layer']:.1f} d; within 1 d of the wall {100 * one['wall']:.0f} % of the core's speed",
                one["wall"] < 1 and one["layer"] <= LAYER,
            )
        )  # fmt: skip
    if len(found) == len(ANGLES):
        flat, steep = (found[angle] for angle in ANGLES)
        verdicts.append(
            Verdict(
                "pebbles in the corner between vessel and funnel, over the axis", "slower at 30° than at 60°",
                f"{100 * flat['corner']:.0f} %, {100 * steep['corner']:.0f} %",
                flat["corner"] < steep["corner"],
            )
        )  # fmt: skip
        ratio = flat["spread"] / steep["spread"]
        verdicts.append(
            Verdict(
                "width of the residence times, (P90 − P10)/P50", "at 30° at least 1.2 times that at 60°",
                f"{flat['spread']:.2f}, {steep['spread']:.2f}: {ratio:.2f} times", ratio >= SPREADS,
            )
        )  # fmt: skip
    return verdicts


def draw(data: Data, figure: Figure) -> None:
    axes = figure.add_subplot()
    for colour, one in zip(("C0", "C1"), data.values(), strict=False):
        radius = np.asarray(one["radius"])
        for name, style in (("plug", "-"), ("corner", "--")):
            profile = np.asarray(one["profiles"][name])
            inside = (radius < RADIUS) & (profile > 0)
            label = {"plug": "one radius above the funnel", "corner": "1 d below its upper end"}[name]
            axes.plot(radius[inside], 1e3 * profile[inside], colour + style, label=f"{one['angle']:g}°, {label}")
    axes.set(xlabel="r/d", ylabel="speed of the pebbles in the simulation, mm/s", ylim=(0, None))
    axes.legend(fontsize=7)


CASE = Case(
    name="pebble_bed",
    title="A pebble bed above a funnel",
    about=f"""
        Spheres of one size with friction 0.7 and no rolling resistance sink through a cylinder into a funnel of 30° or
        60° from the horizontal. Rycroft et al. had 440 000 pebbles in a vessel 58 d wide; here it is
        {2 * RADIUS:g} d wide and its outlet {2 * OUTLET:g} d, so that wall and outlet weigh more: what is compared is
        what they describe, not their numbers. Their abstract could be looked up (vessel 3.5 m wide, pebbles of 6 cm,
        funnels of 30° and 60°); that the speed is uniform far above the funnel, falls in a layer some pebbles thick
        along the wall, that the corner of the 30° funnel is slow and its residence times spread more widely, is
        written from memory, not verified. Speeds are those of the solids, flux over packing; times those of the mean
        streamlines, without mixing.
    """,
    source="Rycroft, Grest, Landry & Bazant, Phys. Rev. E 74, 021306 (2006), cond-mat/0602395.",
    criterion="""
        One vessel radius above the funnel the speed deviates from its mean by at most 10 % RMS farther than 5 d from
        the wall, is lower within 1 d of the wall, and 95 % of the core's at most 5 d from it; 1 d below the funnel's
        upper end pebbles at the wall are slower, over those at the axis, at 30° than at 60°; (P90 − P10)/P50 of
        the residence times is at 30° at least 1.2 times that at 60°.
    """,
    pieces={file_name(angle): partial(vessel, angle=angle) for angle in ANGLES},
    judge=judge,
    draw=draw,
)
