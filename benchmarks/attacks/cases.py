"""Attacks on case files, through ``granpipe check``, ``plan`` and, where a fluid makes it cheap, ``run``."""

from __future__ import annotations

import copy
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from attacks.attack import Attack, Check, Ran, Right, granpipe, marked, not_wrong, refused, right, run, told, unique

Case = dict[str, Any]
Points = list[list[float]]

SILO: Case = {
    "name": "silo",
    "outline": {
        "unit": "m",
        "wall": [[1.0, 5.0], [1.0, 3.0], [0.5, 1.5], [0.5, 0.5]],
        "sections": {"a": [5, 3], "b": {"z": [3, 1.5], "regime": "mass_flow"}, "c": [1.5, 0.5]},
    },
    "material": {"density": "1000 kg/m^3", "bulk_density": "600 kg/m^3", "size": {"diameter": "4 cm"}},
    "flow_rate": "1 m^3/h",
    "model": "fluid",
    "figures": [],
    "export": ["comsol"],
}
"""A shaft, a mass-flow hopper and a pipe, as a fluid."""

SILO_VOLUME = math.pi * (2 + 0.25 + 1.5 * (1 + 0.5 + 0.25) / 3)

PIPE: Case = SILO | {"outline": {"unit": "m", "wall": [[0.5, 2.0], [0.5, 0.0]]}}

BED: Case = {
    "name": "bed",
    "outline": {"unit": "cm", "wall": [[6, 10], [6, 0]]},
    "material": {"density": "2000 kg/m^3", "size": {"diameter": "2 cm"}},
    "contact": {"friction": 0.5, "rolling_friction": 0.1},
    "flow_rate": "0.1 kg/s",
    "model": "dem",
    "dem": {"max_time": "1.2 s", "plate_speed": "0.03 m/s", "start_speed": "0.03 m/s", "ranks": 1},
    "homogenize": {"start": "0.4 s", "method": "gaussian"},
    "export": ["comsol"],
}
"""A short cylinder of a few hundred particles."""


def beverloo(outlet: float, particle: float) -> float:
    """Free discharge as bulk flow [m³/s]: 0.58 √g (D − 1.4 d)^2.5. Source: Beverloo et al. (1961)."""
    return 0.58 * math.sqrt(9.81) * (outlet - 1.4 * particle) ** 2.5


def attacks() -> list[Attack]:
    """Every attack on cases."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (
        outlines,
        obstacles,
        sections,
        floors,
        units,
        materials,
        contacts,
        flows,
        numerics,
        fluids,
        files,
        overrides,
        fluid_runs,
        known_fields,
    )
    return unique([attack for kind in kinds for attack in kind()])


# --- cases and checks -------------------------------------------------------------------------------------------------


def varied(base: Case, changes: Mapping[str, Any]) -> str:
    """The text of a case with keys changed; a key without a value (…) is left out."""
    case = copy.deepcopy(base)
    for dotted, value in changes.items():
        group, *_, key = [case, *dotted.split(".")]
        for name in dotted.split(".")[:-1]:
            group = group.setdefault(name, {})
        if value is ...:
            group.pop(key, None)
        else:
            group[key] = value
    return yaml.dump(case, Dumper=_Plain, sort_keys=False, allow_unicode=True)


class _Plain(yaml.CSafeDumper):
    """Without aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def checked(kind: str, name: str, what: Right, base: Case = SILO, /, pinned: bool = False, **changes: Any) -> Attack:
    """An attack on ``granpipe check``; ``__`` in a key stands for a dot."""
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return texted(kind, name, what, varied(base, dotted), pinned=pinned)


def texted(
    kind: str, name: str, what: Right, text: str | bytes, command: str = "check", pinned: bool = False
) -> Attack:
    """An attack by the text of the case."""
    return Attack(kind, name, granpipe(command, "case.yaml", files={"case.yaml": text}), what, pinned)


def ran(kind: str, name: str, what: Right, base: Case = SILO, /, **changes: Any) -> Attack:
    """An attack on ``granpipe run``."""
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return texted(kind, name, what, varied(base, dotted), "run")


def planned(kind: str, name: str, what: Right, base: Case = SILO, /, **changes: Any) -> Attack:
    """An attack on ``granpipe plan``."""
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return texted(kind, name, what, varied(base, dotted), "plan")


def volume(want: float, within: float = 1e-5) -> Check:
    """The volume of the vessel that is printed [m³]."""

    def check(_: Path, output: str) -> str:
        found = float(re.search(r"volume +(\S+) m³", output)[1])  # type: ignore[index]
        return "" if abs(found / want - 1) <= within else f"a volume of {found} m³ instead of {want:.6g}"

    return check


def model(want: str) -> Check:
    """The model that is planned."""

    def check(_: Path, output: str) -> str:
        found = re.search(r": model (\w+)", output)
        return "" if found and found[1] == want else f"model {found and found[1]} instead of {want}"

    return check


def says(pattern: str) -> Check:
    """What the output matches."""
    return lambda _, output: "" if re.search(pattern, output) else f"does not say {pattern!r}"


def stored(folder: Path, name: str) -> dict[str, Any]:
    """Arrays of a result's field.npz, by numpy alone."""
    with np.load(folder / "results" / name / "field.npz") as field:
        return dict(field)


def flow(want: float, name: str = "silo", plug: tuple[float, float] | None = None) -> Check:
    """Every level of the field carries this bulk flow [m³/s]; where a level and a radius are given, as a plug."""

    def check(folder: Path, _: str) -> str:
        field = stored(folder, name)
        speed = -field["flux_z"] * float(field["flow_scale"]) / float(field["bulk_packing"])
        carried = speed @ (math.pi * np.diff(field["r_edges"] ** 2))
        worst = float(np.abs(carried / want - 1).max())
        if not worst < 1e-6:
            return f"a level carries a flow that is {worst:.2g} off the one asked for"
        if plug is not None:
            z, radius = plug
            row = speed[np.abs(field["z_edges"] - z).argmin()][field["r_edges"][1:] <= radius]
            off = float(np.abs(row / (want / (math.pi * radius**2)) - 1).max())
            if not off < 0.01:
                return f"the plug at z = {z} m is {off:.2g} off"
        return ""

    return check


# --- outlines ---------------------------------------------------------------------------------------------------------


def cone(half_angle: float, outlet: float = 0.3) -> dict[str, Any]:
    """Outline and sections of a silo of radius 1 m; the half-angle [deg] from the vertical."""
    height = (1 - outlet) / math.tan(math.radians(half_angle))
    wall = [[1, 2 + height], [1, height], [outlet, 0], [outlet, -0.5]]
    names = {"a": [2 + height, height], "b": {"z": [height, 0], "regime": "mass_flow"}, "c": [0, -0.5]}
    return {"unit": "m", "wall": wall, "sections": names}


def many_points(number: int) -> str:
    """A case whose wall is a straight pipe of so many points."""
    points = ", ".join(f"[1, {5 * (1 - k / number):.6f}]" for k in range(number))
    return varied(SILO | {"model": "auto"}, {"outline": ...}) + f"outline: {{unit: m, wall: [{points}]}}\n"


def outlines() -> Iterator[Attack]:
    """Walls of every wrong shape."""

    def wall(name: str, points: object, what: Right, pinned: bool = False, **more: Any) -> Attack:
        outline = {"unit": "m", "wall": points} | more
        return checked("outline", name, what, SILO | {"outline": outline, "model": "auto"}, pinned=pinned)

    yield wall("one point", [[1, 5]], refused("wall"))
    yield wall("no point", [], refused("wall"))
    yield wall("null", None, refused("wall"))
    yield wall("text", "silo", refused("wall"))
    yield wall("numbers", [1, 2, 3], refused("wall"))
    yield wall("three coordinates", [[1, 0, 5], [1, 0, 0]], refused("wall"))
    yield wall("names in place of numbers", [["a", 5], [1, 0]], refused("wall"))
    yield wall("no number", [[math.nan, 5], [1, 0]], refused("wall"), pinned=True)
    yield wall("infinite", [[1, math.inf], [1, 0]], refused("wall"))
    yield wall("1e300", [[1e300, 5], [1, 0]], refused(r"outline"), pinned=True)
    yield wall("1e308 high", [[1, 1e308], [1, -1e308]], refused(r"outline"))
    yield wall("1e20 m wide", [[1e20, 1e20], [1e20, 0]], refused())
    yield wall("true for a coordinate", [[True, 5], [1, 0]], refused("wall"))
    yield wall("negative radius", [[-1, 5], [-1, 0]], refused("axis"))
    yield wall("both halves", [[-1, 5], [-0.5, 0], [0.5, 0], [1, 5]], refused("axis|wall"))
    yield wall("a point on the axis", [[1, 5], [1, 2], [0, 0]], refused("axis"))
    yield wall("nearly on the axis", [[1, 5], [1, 2], [1e-12, 0]], refused())
    yield wall(
        "r and z swapped", [[5, 1], [3, 1], [1.5, 0.5], [0.5, 0.5]], right(volume(math.pi * 0.5 / 3 * (9 + 4.5 + 2.25)))
    )
    yield wall("from the bottom up", [[0.5, 0], [1, 5]], refused("top down"), pinned=True)
    yield wall("all at one height", [[1, 5], [0.5, 5]], refused("no height"))
    yield wall("twice the same point", [[1, 5], [1, 5], [1, 0]], refused("repeats"), pinned=True)
    yield wall("points 1e-13 m apart", [[1, 5], [1, 5 - 1e-13], [1, 0]], refused("repeats"))
    yield wall("rises", [[1, 5], [1, 2], [0.5, 3], [0.5, 0]], refused("rises"), pinned=True)
    yield wall("rises by 1e-3", [[1, 5], [1, 2], [0.9, 2.001], [0.5, 0]], refused("rises"))
    yield wall("crosses itself", [[1, 5], [0.3, 1], [1.2, 3], [0.2, 2], [0.5, 0]], refused("cross|rises"))
    yield wall("folds back on itself", [[1, 5], [1, 2], [1, 3], [1, 0]], refused("cross|rises|touch"))
    yield wall("a spike inwards to the axis", [[1, 5], [1, 2], [1e-3, 2], [1, 1.99], [1, 0]], refused())
    yield wall("as wide as the particles", [[0.01, 1], [0.01, 0]], refused("widen"))
    yield wall("pancake of 1 mm", [[1, 1e-3], [1, 0]], told("right", check=volume(math.pi * 1e-3)))
    yield wall("tower of 1 km", [[0.5, 1e3], [0.5, 0]], told("right|unit", check=volume(math.pi * 250)))
    yield wall("below zero", [[0.5, -3], [0.5, -5]], right(volume(math.pi * 0.5)))
    yield wall("1e6 m above zero", [[0.5, 1e6 + 2], [0.5, 1e6]], not_wrong(check=volume(math.pi * 0.5, 1e-3)))
    yield wall("1e12 m above zero", [[0.5, 1e12 + 2], [0.5, 1e12]], refused())
    arc = [[1 + 0.5 * math.cos(t), 2 * (1 - t / math.pi)] for t in np.linspace(0, math.pi, 2001).tolist()]
    exact = math.pi * 2 * (1 + 0.125)  # ∫(1 + cos(t)/2)² dz
    yield wall("2000 points of a curve", arc, right(volume(exact, 1e-5)))
    yield texted("outline", "20 000 points", refused("too much data for a case"), many_points(20_000))
    yield texted("outline", "1 Mbyte of points", refused("larger than 1 MB"), many_points(100_000))
    yield wall("levels in scientific notation", [["1e0", "5e0"], ["1e0", "0e0"]], not_wrong(check=volume(5 * math.pi)))
    yield wall(
        "units in a list", [["1 m", "5 m"], ["1 m", "0 m"]], not_wrong("outline.unit|unit", check=volume(5 * math.pi))
    )
    yield wall("a key twice as long", [[1, 5], [1, 0]], refused("outline"), wal=[[1, 5]])
    yield checked("outline", "missing", refused("outline"), SILO, outline=...)
    yield checked("outline", "empty", refused("outline"), SILO, outline={})
    yield checked("outline", "a list", refused("outline"), SILO, outline=[[1, 5], [1, 0]])


def obstacles() -> Iterator[Attack]:
    """Obstacles that are none, block, overlap, or stand a hair's breadth away."""

    def inside(name: str, shapes: dict[str, Any], what: Right, pinned: bool = False, **more: Any) -> Attack:
        outline = {"unit": "m", "wall": [[1, 4], [1, 0]], "obstacles": shapes} | more
        return checked("obstacle", name, what, SILO | {"outline": outline, "model": "dem"}, pinned=pinned)

    ring = [[0.7, 2], [1, 2], [1, 2.5], [0.7, 2.5]]
    free = math.pi * (4 - 0.5 * (1 - 0.49))
    yield inside("ring on the wall", {"ring": ring}, right(volume(free)))
    yield inside("the same, turned round", {"ring": ring[::-1]}, right(volume(free)), pinned=True)
    yield inside("closed twice", {"ring": [*ring, ring[0]]}, not_wrong(check=volume(free)))
    yield inside("1 mm off the wall", {"ring": [[0.7, 2], [0.999, 2], [0.999, 2.5], [0.7, 2.5]]}, refused("touch"))
    yield inside(
        "1e-11 m off the wall",
        {"ring": [[0.7, 2], [1 - 1e-11, 2], [1 - 1e-11, 2.5], [0.7, 2.5]]},
        not_wrong(check=volume(free)),
    )
    yield inside("1 mm beyond the wall", {"ring": [[0.7, 2], [1.001, 2], [1.001, 2.5], [0.7, 2.5]]}, refused("outside"))
    yield inside("crosses the wall", {"ring": [[0.7, 2], [1.5, 2.2], [0.7, 2.5]]}, refused("wall|outside"), pinned=True)
    yield inside("blocks the vessel", {"lid": [[0, 2], [1, 2], [1, 2.1], [0, 2.1]]}, refused("blocks"), pinned=True)
    yield inside(
        "two that block together",
        {"a": [[0, 2], [0.5, 2], [0.5, 2.1], [0, 2.1]], "b": [[0.5, 2], [1, 2], [1, 2.1], [0.5, 2.1]]},
        refused("blocks"),
    )
    yield inside("two in the same place", {"a": ring, "b": ring}, refused("overlaps"))
    yield inside(
        "two that overlap", {"a": ring, "b": [[0.6, 2.2], [0.8, 2.2], [0.8, 2.7], [0.6, 2.7]]}, refused("overlaps")
    )
    yield inside("one inside the other", {"a": ring, "b": [[0.8, 2.2], [0.9, 2.2], [0.85, 2.3]]}, refused("overlaps"))
    yield inside("bow tie", {"a": [[0.3, 2], [0.6, 2.5], [0.6, 2], [0.3, 2.5]]}, refused("cross"))
    yield inside("two points", {"a": [[0.3, 2], [0.6, 2.5]]}, refused("3"))
    yield inside("no area", {"a": [[0.3, 2], [0.5, 2.2], [0.4, 2.1]]}, refused("area|cross|touch"))
    yield inside("a line on the axis", {"a": [[0, 2], [0, 2.5], [0, 3]]}, refused("axis|area|cross"))
    yield inside("negative radius", {"a": [[-0.2, 2], [0.2, 2], [0, 2.5]]}, refused("axis"))
    yield inside("cone on the axis", {"a": [[0, 2], [0.4, 2], [0, 2.5]]}, right(volume(math.pi * (4 - 0.16 * 0.5 / 3))))
    yield inside("cone 1 mm off the axis", {"a": [[0.001, 2], [0.4, 2], [0.001, 2.5]]}, refused("touch|axis"))
    yield inside("above the inlet", {"a": [[0, 3.9], [0.3, 3.9], [0, 4.2]]}, refused("outside"))
    yield inside("below the outlet", {"a": [[0, -0.2], [0.3, -0.2], [0, 0.2]]}, refused("outside"))
    yield inside("gap of half a particle", {"ring": [[0.02, 2], [1, 2], [1, 2.5], [0.02, 2.5]]}, refused("d90|touch"))
    yield inside("no number", {"a": [[math.nan, 2], [0.4, 2], [0, 2.5]]}, refused("obstacles"))
    yield inside("1e300", {"a": [[1e300, 2], [0.4, 2], [0, 2.5]]}, refused())
    yield inside("a path for a name", {"../../x": ring}, refused("name|obstacles"))
    yield inside("no name", {"": ring}, refused())
    yield inside("a number for a name", {7: ring}, refused())
    yield inside("null", {"a": None}, refused())
    rings = {
        f"a{k}": [[0.9, 3.9 - k / 80], [1, 3.9 - k / 80], [1, 3.895 - k / 80], [0.9, 3.895 - k / 80]]
        for k in range(300)
    }
    yield inside("300 rings", rings, refused("300 obstacles, more than"), pinned=True)
    rings = {name: rings[name] for name in list(rings)[:100]}
    yield inside("100 rings", rings, right(volume(math.pi * (4 - 100 * 0.005 * 0.19))))


def sections() -> Iterator[Attack]:
    """Sections that do not fit."""

    def of(name: str, given: object, what: Right, pinned: bool = False) -> Attack:
        return checked("section", name, what, SILO, pinned=pinned, outline__sections=given)

    fine = {"a": [5, 3], "b": {"z": [3, 1.5], "regime": "mass_flow"}, "c": [1.5, 0.5]}
    yield of("reversed", fine | {"a": [3, 5]}, refused("upper z first"), pinned=True)
    yield of("no height", fine | {"a": [3, 3]}, refused("height"))
    yield of("beyond the inlet", fine | {"a": [6, 3]}, refused("leaves the outline"))
    yield of("overlapping", fine | {"a": [5, 2.5]}, refused("overlap"))
    yield of("in millimetres", {"a": [5000, 3000], "b": [3000, 500]}, refused("leaves the outline"))
    yield of("a gap", fine | {"a": [5, 3.1]}, told("no section covers"))
    yield of("three levels", {"a": [5, 3, 1]}, refused("sections"))
    yield of("text", fine | {"a": "upper"}, refused("sections"))
    yield of("no number", fine | {"a": [5, math.nan]}, refused("sections"))
    yield of("a list", [[5, 3], [3, 0.5]], refused("sections"))
    yield of("an unknown regime", fine | {"b": {"z": [3, 1.5], "regime": "massflow"}}, refused("mass_flow"))
    yield of("a wall factor of 2", fine | {"b": {"z": [3, 1.5], "wall_factor": 2}}, refused("wall_factor"))
    yield of("a name with a space", {"upper part": [5, 0.5]}, refused("name|sections"))


def floors() -> Iterator[Attack]:
    """Flat bottoms, nearly level floors and ledges as fluids, whatever the case calls them."""
    flat = {"unit": "mm", "wall": [[900, 1100], [900, 0], [240, 0], [240, -60]]}
    for name, changes in {"auto": {"model": "auto"}, "open outlet": {"model": "auto", "dem.outlet": "open"}}.items():
        yield texted(
            "floor", f"flat bottom, {name}", right(model("dem")), varied(SILO | {"outline": flat}, changes), "plan"
        )
    yield checked("floor", "flat bottom as a fluid", refused("solids rest on"), SILO | {"outline": flat}, pinned=True)
    for angle in (0.5, 5, 20, 29):
        case = SILO | {"outline": cone(90 - angle)}
        yield checked("floor", f"{angle}° above the horizontal, mass flow", refused("solids rest on"), case)
    steep = SILO | {"outline": cone(20)}
    yield ran("floor", "70° above the horizontal, mass flow", right(flow(1 / 3600)), steep)
    ledge = {"unit": "m", "wall": [[1, 4], [1, 2], [0.8, 2], [0.8, 0]]}
    yield checked("floor", "narrowing ledge as a fluid", refused("ledge"), SILO | {"outline": ledge})
    hair = {"unit": "m", "wall": [[1, 4], [1, 2], [0.9999, 2], [0.9999, 0]]}
    yield checked("floor", "ledge of 0.1 mm", right(volume(math.pi * (2 + 2 * 0.9999**2))), SILO | {"outline": hair})
    stairs = [[1, 6.0]]
    for k in range(50):
        stairs += [[1 - 0.01 * k, 3 - 0.0101 * k], [1 - 0.01 * (k + 1), 3 - 0.0101 * k]]
    stairs.append([0.5, 0.5])
    yield checked(
        "floor", "staircase of small ledges", refused("solids rest on"), SILO, outline={"unit": "m", "wall": stairs}
    )
    at_inlet = {"unit": "m", "wall": [[1, 4], [0.6, 4], [0.6, 0]]}
    yield checked("floor", "ledge at the inlet", refused("ledge"), SILO | {"outline": at_inlet})
    at_outlet = {"unit": "m", "wall": [[1, 4], [1, 0], [0.4, 0]]}
    yield checked("floor", "ledge at the outlet", refused("ledge"), SILO | {"outline": at_outlet})
    dish = [[1, 5.0], *([math.cos(t), 1.5 - math.sin(t)] for t in np.linspace(0, 1.2, 30).tolist())]
    dish.append([dish[-1][0], 0.0])
    yield checked("floor", "dished end", refused("solids rest on"), SILO, outline={"unit": "m", "wall": dish})
    wide = {"unit": "m", "wall": [[0.5, 4], [0.5, 2], [1, 2], [1, 0]]}
    yield texted(
        "floor", "widening, auto", right(_no_fluid), varied(SILO | {"outline": wide}, {"model": "auto"}), "plan"
    )


def _no_fluid(folder: Path, output: str) -> str:
    return "" if model("fluid")(folder, output) else "a fluid below a widening"


# --- numbers ----------------------------------------------------------------------------------------------------------


def units() -> Iterator[Attack]:
    """Units that are wrong, missing or forgotten, and decimal commas."""
    big = {"unit": ..., "wall": [[250, 800], [250, 300], [125, 100], [125, 0]]}
    big.pop("unit")
    yield checked(
        "unit",
        "millimetres forgotten",
        told("outline.unit: mm"),
        SILO,
        outline=big,
        material__size={"diameter": "5 mm"},
        pinned=True,
    )
    yield checked(
        "unit",
        "millimetres forgotten, dem",
        not_wrong("outline.unit: mm"),
        BED,
        outline=big,
        model="dem",
        dem={},
        homogenize={},
        material__size={"diameter": "5 mm"},
    )
    small = {"unit": "mm", "wall": [[1.0, 5.0], [1.0, 0.0]]}
    yield checked("unit", "metres read as millimetres", refused("outline.unit"), SILO, outline=small, pinned=True)
    for unit in ("kg", "m^2", "parsek", "", "1", "m m", "../m", "m/s"):
        yield checked("unit", f"unit {unit!r}", refused("unit"), SILO, outline__unit=unit)
    yield checked(
        "unit",
        "inch",
        right(volume(math.pi * 5 * 0.0254**3 * 1e6)),
        SILO,
        outline={"unit": "inch", "wall": [[100, 500], [100, 0]]},
    )
    for key, value in {
        "contact.friction": "0,3",
        "dem.max_time": "8,5",
        "material.size.diameter": "2,5 cm",
        "flow_rate": "0,1 kg/s",
    }.items():
        yield checked(
            "unit",
            f"decimal comma in {key}",
            refused(r"0\.3|8\.5|2\.5|0\.1|decimal"),
            BED,
            pinned=True,
            **{key.replace(".", "__"): value},
        )
    text = varied(BED, {}).replace("contact:\n  friction: 0.5\n  rolling_friction: 0.1", "contact: {friction: 0,3}")
    yield texted("unit", "friction: 0,3 in braces", refused("decimal point|0.3"), text, pinned=True)
    text = varied(BED, {"dem": ...}) + "dem: {max_time: 8,5}\n"
    yield texted("unit", "max_time: 8,5 in braces", refused(r"8\.5|decimal"), text)
    yield checked("unit", "thousands", refused(), SILO, material__density="1'000 kg/m^3")
    yield checked("unit", "density in m", refused("density"), SILO, material__density="1000 m")
    yield checked("unit", "g/cm^3", right(volume(SILO_VOLUME), "600 kg/m³"), SILO, material__density="1 g/cm^3")
    yield checked("unit", "density without unit", right(volume(SILO_VOLUME), "600 kg/m³"), SILO, material__density=1000)
    yield checked("unit", "°C", refused("density"), SILO, material__density="1000 °C")
    yield checked(
        "unit", "fullwidth digits", not_wrong(check=volume(SILO_VOLUME)), SILO, material__density="１０００ kg/m^3"
    )
    yield checked("unit", "a minus of typography", refused(), SILO, contact={"friction": "−0.3"})
    yield checked(
        "unit",
        "fractions 40, 60",
        refused("%"),
        SILO,
        material__size={
            "diameter": {"sieve": {"edges": ["2 cm", "4 cm", "6 cm"], "fractions": [40, 60]}},
            "by": "mass",
        },
        pinned=True,
    )


def materials() -> Iterator[Attack]:
    """Materials and sizes that cannot be."""

    def sized(name: str, size: object, what: Right, pinned: bool = False) -> Attack:
        return checked("material", name, what, SILO, pinned=pinned, material__size=size)

    for value in (0, -1, math.nan, math.inf, 1e300, 0.5, 1e6, "x", None, [1000], True):
        yield checked("material", f"density {value}", refused("density"), SILO, material__density=value)
    for value in (0, -600, 1000, 1200, 50, math.nan, 1e300):
        yield checked("material", f"bulk density {value}", refused("bulk_density"), SILO, material__bulk_density=value)
    yield checked("material", "no bulk density", refused("bulk density"), SILO, material__bulk_density=..., pinned=True)
    yield checked(
        "material",
        "no bulk density, mass flow",
        refused("bulk density"),
        SILO,
        material__bulk_density=...,
        flow_rate="1 t/h",
    )
    for value in ("0 cm", "-1 cm", "1e300 m", "11 m", ".nan"):
        yield sized(f"diameter {value}", {"diameter": value}, refused())
    yield sized("particles of 3 m", {"diameter": "3 m"}, refused("no particle passes"))
    yield sized("a dust of 1 nm", {"diameter": "1 nm"}, told("cohe"), pinned=True)
    yield sized("both radius and diameter", {"radius": "2 cm", "diameter": "4 cm"}, refused("radius|diameter"))
    yield sized("neither", {}, refused("radius|diameter"))
    yield sized("a bare number", "4 cm", refused("size"))
    normal = {"mean": "3 cm", "std": "1 cm", "min": "1 cm", "max": "5 cm"}
    yield sized("min above max", {"diameter": {"normal": normal | {"min": "6 cm"}}}, refused("min|max"))
    yield sized(
        "mean outside",
        {"diameter": {"normal": normal | {"mean": "9 cm"}}},
        not_wrong("mean|size|classes", check=says("valid")),
    )
    yield sized("std 0", {"diameter": {"normal": normal | {"std": 0}}}, refused("std"))
    yield sized(
        "all in a sliver", {"diameter": {"normal": normal | {"std": "1 nm"}}}, not_wrong(check=says("⌀ 0.0[23]"))
    )
    yield sized("0 classes", {"diameter": {"normal": normal}, "classes": 0}, refused("classes"))
    yield sized("1000 classes", {"diameter": {"normal": normal}, "classes": 1000}, refused("classes"))
    edges = ["2 cm", "4 cm", "6 cm"]
    for name, sieve in {
        "falling edges": {"edges": edges[::-1], "fractions": ["40 %", "60 %"]},
        "equal edges": {"edges": ["2 cm", "2 cm", "6 cm"], "fractions": ["40 %", "60 %"]},
        "too few fractions": {"edges": edges, "fractions": ["100 %"]},
        "fractions of 90 %": {"edges": edges, "fractions": ["30 %", "60 %"]},
        "a negative fraction": {"edges": edges, "fractions": ["-30 %", "130 %"]},
        "all fractions 0": {"edges": edges, "fractions": [0, 0]},
    }.items():
        yield sized(f"sieve: {name}", {"diameter": {"sieve": sieve}, "by": "mass"}, refused("sieve"))
    yield checked(
        "material",
        "wall friction angle 90°",
        refused("wall_friction_angle"),
        SILO,
        material__wall_friction_angle="90 deg",
    )
    yield checked("material", "a bare angle", refused("deg"), SILO, material__internal_friction_angle=30)


def contacts() -> Iterator[Attack]:
    """Contact parameters out of range."""
    for key, values in {
        "friction": (-0.1, 11, math.nan, math.inf, "x", None),
        "restitution": (0, 1.3, -1),
        "poisson": (-0.1, 0.6),
        "youngs_modulus": (0, -1, 1, 1e20, math.nan),
        "rolling_friction": (-1, 100),
        "model": ("hertzian",),
        "rolling_model": ("cd", 3),
    }.items():
        for value in values:
            if (key, value) == ("friction", None):
                continue
            yield checked("contact", f"{key} {value}", refused(key), BED, **{f"contact__{key}": value})
    yield checked("contact", "far too soft", told("overlap"), BED, contact__youngs_modulus=2e3, pinned=True)
    yield checked(
        "contact",
        "neither friction nor loss",
        refused(),
        BED,
        contact={"friction": 0, "rolling_friction": 0, "restitution": 1},
    )
    yield checked(
        "contact", "hooke without a velocity", refused("characteristic_velocity"), BED, contact__model="hooke"
    )


def flows() -> Iterator[Attack]:
    """Flow rates that are none, and more than falls freely."""
    for value in (
        0,
        1,
        -1,
        "1",
        "1 kg",
        "0 m^3/h",
        "-1 m^3/h",
        "1e9 t/h",
        "nan m^3/h",
        "inf kg/s",
        "1 m^3",
        "1e300 m^3/h",
    ):
        yield checked("flow", f"flow rate {value!r}", refused("flow_rate"), BED, flow_rate=value)
    free = beverloo(0.12, 0.02)
    yield checked(
        "flow",
        "1.05 times what falls freely",
        refused("free discharge"),
        BED,
        pinned=True,
        flow_rate=f"{1.05 * free:.9f} m^3/s",
    )
    yield checked("flow", "half of what falls freely", told("50 ?%"), BED, flow_rate=f"{0.5 * free:.9f} m^3/s")
    yield checked(
        "flow", "a twentieth of it", right(volume(math.pi * 0.06**2 * 0.1)), BED, flow_rate=f"{0.05 * free:.9f} m^3/s"
    )
    yield checked(
        "flow",
        "more than falls freely, as a fluid",
        refused("free discharge"),
        SILO,
        flow_rate=f"{2 * beverloo(1.0, 0.04):.6f} m^3/s",
    )
    ring = {"unit": "m", "wall": [[1, 4], [1, 0]], "obstacles": {"c": [[0, 1.8], [0.85, 1.8], [0, 3]]}}
    slot = math.pi * 1.85 * (0.15 - 1.4 * 0.02) ** 1.5 * math.sqrt(9.81)
    yield checked(
        "flow",
        "more than falls through a ring gap",
        refused("free discharge"),
        BED,
        outline=ring,
        dem={},
        homogenize={},
        flow_rate=f"{1.5 * slot:.6f} m^3/s",
    )
    yield checked("flow", "missing", refused("flow_rate"), BED, flow_rate=...)


def numerics() -> Iterator[Attack]:
    """Settings of DEM, averaging and exports that are impossible or inaccurate."""
    for key, values in {
        "dem.time_step": (0, -1, "2 s", math.nan, "1 kg"),
        "dem.max_time": (0, "1e300 s", "-1 s"),
        "dem.plate_speed": (0, "-1 m/s", "50 m/s", math.inf),
        "dem.coarse_grain_factor": (0.5, 1000, "x"),
        "dem.replicas": (0, 1.5, 1e9),
        "dem.seed": (-1, 2**31, 1.5),
        "dem.facets": (7, 9, 1000),
        "dem.ranks": (0, 10**6),
        "dem.statistical_error": (0, 1, "200 %", -0.1),
        "dem.reservoir_height": (0, "-1 m", "1e9 m"),
        "dem.outlet": ("closed",),
        "dem.keep_snapshots": (True,),
        "homogenize.cell": (0, "1 nm", "-1 cm"),
        "homogenize.smoothing_passes": (101, -1, 1.5),
        "homogenize.method": ("mean",),
        "homogenize.start": ("2 s", "-1 s"),
        "homogenize.fields": (["temperature"], ["wall_slip", "wall_slip"], "wall_slip"),
        "export": (["excel"], "comsol", 3),
        "figures": (["rz", "rz"], [1]),
        "model": ("cfd", 1),
        "name": ("../x", "a b", ".store", "", "x" * 65, "ü", "-x"),
    }.items():
        for value in values:
            yield checked(
                "setting", f"{key} {value}", refused(key.split(".")[-1]), BED, **{key.replace(".", "__"): value}
            )
    yield checked(
        "setting", "a time step of 1 ms", not_wrong("time_step", check=says("never")), BED, dem__time_step="1 ms"
    )
    yield checked(
        "setting",
        "a time step twice too long",
        told("time_step"),
        BED,
        dem__time_step="5e-4 s",
        contact__youngs_modulus="10 MPa",
    )
    yield checked(
        "setting", "a plate that is too fast", told("plate_speed"), BED, dem__plate_speed="0.2 m/s", pinned=True
    )
    yield checked("setting", "a run far too short", told("max_time"), BED, dem__max_time="0.5 s")
    yield checked(
        "setting", "cells wider than the vessel", told("will be marked"), BED, homogenize__cell="10 m", pinned=True
    )
    yield checked("setting", "8 facets", told("facets"), BED, dem__facets=8)
    yield checked("setting", "openings of 3.5 coarse particles", told("d90|times"), BED, dem__coarse_grain_factor=1.7)
    yield checked("setting", "openings of 2 coarse particles", refused("d90"), BED, dem__coarse_grain_factor=3)
    yield checked(
        "setting", "an unknown key", refused("coarse_grain_factor"), BED, dem__coarse_grain_facter=2, pinned=True
    )
    yield checked("setting", "an unknown group", refused("unknown|known"), BED, thermal={"conductivity": 1})
    yield planned(
        "setting",
        "a billion particles",
        not_wrong(check=says(r"\de\+|years|days|GB|TB")),
        BED,
        outline={"unit": "m", "wall": [[5, 20], [5, 0]]},
        dem={},
        homogenize={},
    )


def fluids() -> Iterator[Attack]:
    """Settings of the fluid."""

    def fluid(name: str, given: object, what: Right, pinned: bool = False) -> Attack:
        return checked("fluid", name, what, SILO, fluid=given, pinned=pinned)

    yield fluid(
        "annulus outside the outlet",
        {"outlet_profile": "annular", "annulus": ["30 cm", "60 cm"]},
        refused("outlet has a radius"),
        pinned=True,
    )
    yield fluid("annulus reversed", {"outlet_profile": "annular", "annulus": ["40 cm", "30 cm"]}, refused("annulus"))
    yield fluid("annulus of no width", {"outlet_profile": "annular", "annulus": ["40 cm", "40 cm"]}, refused("annulus"))
    yield fluid(
        "annulus narrower than a particle",
        {"outlet_profile": "annular", "annulus": ["40 cm", "41 cm"]},
        refused("annul"),
    )
    yield fluid("negative annulus", {"outlet_profile": "annular", "annulus": ["-10 cm", "30 cm"]}, refused("annulus"))
    yield fluid("annulus of one number", {"outlet_profile": "annular", "annulus": ["30 cm"]}, refused("annulus"))
    yield fluid("annular without annulus", {"outlet_profile": "annular"}, refused("annulus"))
    yield fluid("annulus without annular", {"annulus": ["10 cm", "40 cm"]}, refused("annul"))
    for key, values in {
        "order": (1, 5, 2.5, "x"),
        "walls": ("fixed",),
        "solids": (0,),
        "outlet_profile": ("plug",),
        "rheology": ("bingham",),
        "force_factor": (0, -1, 1e15, math.nan),
        "known_field": (7, ""),
    }.items():
        for value in values:
            yield fluid(f"{key} {value}", {key: value}, refused(key))
    yield fluid("text", "viscous", refused("fluid"))
    for name, angle in {"88°": "88 deg", "89.999°": "89.999 deg", "0.01°": "0.01 deg"}.items():
        yield checked(
            "fluid",
            f"frictional, surfaces at {name}",
            not_wrong(check=says("valid")),
            SILO,
            material__repose_angle=angle,
            fluid={"rheology": "frictional"},
        )
    yield checked("fluid", "hybrid without particles", refused("hybrid|DEM"), SILO, model="hybrid")
    yield checked(
        "fluid",
        "frictional hybrid",
        refused("frictional|rheology"),
        SILO,
        model="hybrid",
        fluid={"rheology": "frictional"},
    )
    mixed = {"a": [5, 3], "b": {"z": [3, 1.5], "model": "dem"}, "c": [1.5, 0.5]}
    yield checked("fluid", "a section of particles in a fluid", refused("model"), SILO, outline__sections=mixed)


# --- files and overrides ----------------------------------------------------------------------------------------------


def files() -> Iterator[Attack]:
    """Files that are no case, in other codings, or without end."""
    fine = varied(SILO, {})
    valid = right(volume(SILO_VOLUME))
    yield texted("file", "UTF-16", refused("UTF-8"), fine.encode("utf-16"), pinned=True)
    yield texted("file", "UTF-16 without a mark", refused(), fine.encode("utf-16-le"))
    yield texted("file", "UTF-32", refused(), fine.encode("utf-32"))
    yield texted("file", "Latin-1", refused("UTF-8"), ("# Größe\n" + fine).encode("latin-1"), pinned=True)
    yield texted("file", "a mark of UTF-8", valid, fine.encode("utf-8-sig"))
    yield texted("file", "lines of Windows", valid, fine.replace("\n", "\r\n"))
    yield texted("file", "lines of old Macs", not_wrong(check=volume(SILO_VOLUME)), fine.replace("\n", "\r"))
    yield texted("file", "tabs", refused("a tab"), fine.replace("  ", "\t"), pinned=True)
    yield texted("file", "a non-breaking space", refused(), fine.replace("density: 1", "density:\u00a01"))
    yield texted("file", "empty", refused("empty|case"), "")
    yield texted("file", "comments only", refused(), "# name: silo\n")
    yield texted("file", "a list", refused(), "- name: silo\n")
    yield texted("file", "a number", refused(), "3\n")
    yield texted("file", "two documents", refused(), fine + "---\n" + fine)
    yield texted("file", "a key twice", refused("twice|line"), fine + "model: dem\n", pinned=True)
    yield texted("file", "JSON", valid, json.dumps(SILO))
    yield texted("file", "cut", refused(), fine[: len(fine) // 2])
    yield texted("file", "a page of HTML", refused(), "<html><body>404 not found</body></html>")
    yield texted("file", "a ZIP", refused(), b"PK\x03\x04" + bytes(range(256)) * 4)
    yield texted("file", "zeros", refused(), bytes(5000))
    yield texted(
        "file", "a python object", refused(), fine.replace("name: silo", "name: !!python/object/apply:os.system [id]")
    )
    yield texted("file", "a merge key", not_wrong(check=volume(SILO_VOLUME)), "base: &b {density: 1}\n" + fine)
    yield texted("file", "2 MB of comments", refused("1 MB"), "# x\n" * 500_000 + fine)
    yield Attack("file", "missing", granpipe("check", "none.yaml"), refused("none.yaml"))
    yield Attack("file", "a folder", granpipe("check", "."), refused())
    yield Attack("file", "/dev/null", granpipe("check", "/dev/null"), refused())
    yield Attack("file", "/dev/zero", granpipe("check", "/dev/zero"), refused("device"))
    yield Attack(
        "file", "a pipe that nobody writes", granpipe("check", "p", files={"p": os.mkfifo}), refused("pipe|file")
    )
    yield Attack(
        "file", "a link to itself", granpipe("check", "p", files={"p": lambda path: path.symlink_to(path)}), refused()
    )
    yield Attack("file", "a name with a line feed", granpipe("check", "a\nb.yaml", files={"a\nb.yaml": fine}), valid)
    yield Attack("file", "an empty name", granpipe("check", ""), refused())


def overrides() -> Iterator[Attack]:
    """``--set`` with what does not fit."""

    def set_(name: str, text: str, what: Right, command: str = "check", pinned: bool = False) -> Attack:
        act = granpipe(command, "case.yaml", "--set", text, files={"case.yaml": varied(SILO, {})})
        return Attack("override", name, act, what, pinned)

    yield set_("no value", "dem.seed", refused("key=value"))
    yield set_("no key", "=3", refused("key=value"))
    yield set_("an unknown key", "dem.sed=3", refused("seed"), pinned=True)
    yield set_("a key of a number", "flow_rate.x=3", refused("flow_rate"))
    yield set_("a broken value", "material.size={", refused())
    yield set_("an empty value", "flow_rate=", refused())
    yield set_("a python object", "name=!!python/object/apply:os.system [id]", refused())
    yield set_("a path for a name", "name=../../x", refused("name"))
    yield set_("a wall", "outline.wall=[[0.5, 3], [0.5, 1]]", refused("sections|section"))
    yield set_("an index", "outline.wall.0=[1, 6]", not_wrong(check=volume(SILO_VOLUME + math.pi)))
    yield set_("a decimal comma", "contact.friction=0,3", refused("0.3|decimal"))
    yield set_("a hundred levels", "a" + ".a" * 100 + "=1", refused())
    yield set_("the density alone", "material.density=1100", right(volume(SILO_VOLUME)))
    yield set_("a density below the bulk's", "material.density=500", refused("bulk_density"))
    yield set_("a flow beyond free discharge", "flow_rate=1e9 t/h", refused("free discharge"))


# --- runs of the fluid ------------------------------------------------------------------------------------------------


def fluid_runs() -> Iterator[Attack]:
    """Whole runs whose field is known at least in part."""
    q = 1 / 3600
    yield ran("run", "pipe", right(flow(q, plug=(1.0, 0.5))), PIPE)
    yield ran("run", "pipe, t/h", right(flow(1000 / 3600 / 600, plug=(1.0, 0.5))), PIPE, flow_rate="1 t/h")
    yield ran(
        "run",
        "pipe, twice the bulk density",
        right(flow(1000 / 3600 / 800)),
        PIPE,
        flow_rate="1 t/h",
        material__density="1600 kg/m^3",
        material__bulk_density="800 kg/m^3",
    )
    tiny = {"unit": "um", "wall": [[500, 2000], [500, 0]]}
    yield ran(
        "run",
        "pipe of 1 mm",
        told("unit", check=flow(1e-9 / 3600, plug=(1e-3, 5e-4))),
        PIPE,
        outline=tiny,
        material__size={"diameter": "4 um"},
        flow_rate="1e-9 m^3/h",
    )
    huge = {"unit": "km", "wall": [[0.5, 2], [0.5, 0]]}
    yield ran(
        "run", "pipe of 1 km", told("unit", check=flow(1.0, plug=(1000, 500))), PIPE, outline=huge, flow_rate="1 m^3/s"
    )
    yield ran(
        "run",
        "pancake",
        told("unit", check=flow(q, plug=(0.0025, 0.5))),
        PIPE,
        outline={"unit": "m", "wall": [[0.5, 0.005], [0.5, 0]]},
    )
    yield ran(
        "run",
        "tower",
        told("unit", check=flow(q, plug=(50, 0.5))),
        PIPE,
        outline={"unit": "m", "wall": [[0.5, 100], [0.5, 0]]},
    )
    yield ran(
        "run",
        "silo below zero",
        right(flow(q)),
        SILO,
        outline={
            "unit": "m",
            "wall": [[1.0, -10.0], [1.0, -12.0], [0.5, -13.5], [0.5, -14.5]],
            "sections": {"a": [-10, -12], "b": {"z": [-12, -13.5], "regime": "mass_flow"}, "c": [-13.5, -14.5]},
        },
    )
    yield ran("run", "frictional silo", right(flow(q)), SILO, fluid={"rheology": "frictional"})
    yield ran(
        "run",
        "annular outlet",
        right(_annulus(q, 0.1, 0.4)),
        SILO,
        fluid={"outlet_profile": "annular", "annulus": ["10 cm", "40 cm"]},
    )
    yield ran(
        "run",
        "an annulus of the least width",
        marked("cells|annul"),
        SILO,
        fluid={"outlet_profile": "annular", "annulus": ["20 cm", "41 cm"]},
        homogenize={"cell": "8 cm"},
    )
    yield ran("run", "cells as wide as the outlet", marked("cells"), SILO, homogenize={"cell": "50 cm"})
    yield ran(
        "run",
        "a fluid round an obstacle",
        marked("obstacle"),
        SILO,
        outline={"unit": "m", "wall": [[1, 4], [1, 0]], "obstacles": {"c": [[0, 2], [0.4, 2], [0, 3]]}},
    )
    yield ran(
        "run",
        "a fluid below a widening",
        marked("widens"),
        SILO,
        outline={"unit": "m", "wall": [[0.5, 4], [0.5, 2], [1, 2], [1, 0]]},
    )
    yield ran(
        "run",
        "walls at rest",
        not_wrong(check=flow(q)),
        SILO,
        outline__sections={
            "a": {"z": [5, 3], "wall_factor": 0},
            "b": {"z": [3, 1.5], "wall_factor": 0, "regime": "mass_flow"},
            "c": {"z": [1.5, 0.5], "wall_factor": 0},
        },
    )
    yield ran("run", "particles of any kind ignored", right(flow(q)), SILO, dem={"max_time": "3 s"})


def _annulus(want: float, inner: float, outer: float) -> Check:
    """At the outlet all flows within the annulus."""

    def check(folder: Path, output: str) -> str:
        if wrong := flow(want)(folder, output):
            return wrong
        field = stored(folder, "silo")
        middle = 0.5 * (field["r_edges"][1:] + field["r_edges"][:-1])
        part = -field["flux_z"][0] * np.diff(field["r_edges"] ** 2)
        cell = float(field["r_edges"][1])
        beside = float(np.abs(part[(middle < inner - cell) | (middle > outer + cell)]).sum() / part.sum())
        return "" if beside < 0.01 else f"{beside:.1%} of the flow leaves beside the annulus"

    return check


# --- fields that a hybrid follows -------------------------------------------------------------------------------------

NECK: Points = [[0.5, 4], [0.5, 2], [1, 2], [1, 0]]
PACKING = 0.6

HYBRID: Case = {
    "name": "silo",
    "outline": {"unit": "m", "wall": NECK, "sections": {"pipe": [4, 2], "chamber": [2, 0]}},
    "material": {"density": "2500 kg/m^3", "bulk_density": "1500 kg/m^3", "size": {"diameter": "8 cm"}},
    "flow_rate": "1 m^3/h",
    "model": "hybrid",
    "fluid": {"known_field": "field.npz"},
    "figures": [],
    "export": ["comsol"],
}


def neck_field(
    folder: Path, wall: Points = NECK, core: float = 1.0, by: tuple[float, float] = (0.0, 0.0), cell: float = 0.025
) -> dict[str, Any]:
    """A field of a vessel by a fluid on slipping walls, as arrays: a plug in its pipe, or one with a fast core.

    Parameters
    ----------
    by : how far what is drawn is off in r and z [m]
    """
    from granpipe.field import Grid, flux_from_psi
    from granpipe.fluid.fictitious import solve_fluid, to_field
    from granpipe.fluid.wall_speed import WallLaw
    from granpipe.geometry.outline import Outline
    from granpipe.geometry.section import mesh_section

    outline = Outline.of(np.array(wall, dtype=float) + by, {})
    grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, cell)
    solution = solve_fluid(mesh_section(outline.wall, {}, {}), WallLaw(walls="slip", solids="slip"), 1.0)
    field = to_field(solution, grid, outline.inside_fraction(grid), PACKING)
    assert field.psi is not None
    psi = field.psi[:, -1:] * (1 - (1 - field.psi / field.psi[:, -1:]) ** core)
    flux_r, flux_z = flux_from_psi(psi, grid)
    replace(field, psi=psi, flux_r=flux_r, flux_z=flux_z).save(folder / "field.npz")
    with np.load(folder / "field.npz") as arrays:
        return dict(arrays)


def known_fields() -> Iterator[Attack]:
    """Hybrids that follow a field with something wrong in it."""
    q = 1 / 3600

    def follow(
        name: str,
        what: Right,
        change: Callable[[dict[str, Any]], dict[str, Any]] = lambda one: one,
        case: Mapping[str, Any] | None = None,
        **made: Any,
    ) -> Attack:
        def act(folder: Path) -> Ran:
            np.savez(folder / "field.npz", **change(neck_field(folder, **made)))
            (folder / "case.yaml").write_text(varied(HYBRID, case or {}))
            return run(("run", "case.yaml"), folder)

        return Attack("known field", name, act, what)

    def times(factor: float, *names: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
        return lambda one: one | {name: one[name] * factor for name in names}

    def spoilt(name: str, value: float) -> Callable[[dict[str, Any]], dict[str, Any]]:
        def change(one: dict[str, Any]) -> dict[str, Any]:
            array = np.array(one[name])
            array[len(array) // 3, array.shape[1] // 3] = value
            return one | {name: array}

        return change

    fluxes = ("psi", "flux_r", "flux_z")
    yield follow("the vessel's own", told("provenance", check=flow(q)))
    yield follow("at ten times the flow", told("provenance", check=flow(q)), times(10, *fluxes, "bulk_flow"))
    yield follow("on coarser cells", told("provenance", check=flow(q)), cell=0.05)
    yield follow("upwards", refused("flow|sign"), times(-1, *fluxes))
    yield follow("upwards, and says so", refused("flow"), times(-1, *fluxes, "bulk_flow"))
    yield follow("a thousandfold", refused("field.npz: not a field"), times(1000, *fluxes))
    yield follow("ψ alone doubled", refused("psi is not the stream function"), times(2, "psi"))
    yield follow("fluxes alone doubled", refused("field.npz: not a field"), times(2, "flux_r", "flux_z"))
    yield follow("packing of 0.9", refused(), times(1.5, "bulk_packing"))
    yield follow("packing of 0", refused(), times(0, "bulk_packing"))
    yield follow("no flow", refused(), times(0, "bulk_flow"))
    yield follow("a flow scale of 0", not_wrong(check=flow(q)), times(0, "flow_scale"))
    yield follow("millimetres", refused(), times(1e3, "r_edges", "z_edges"))
    yield follow("ψ with a hole", refused(), spoilt("psi", math.nan))
    yield follow("ψ with a peak", not_wrong(), spoilt("psi", 1.0))
    yield follow("ψ infinite", refused(), spoilt("psi", math.inf))
    yield follow("no ψ", refused("stream function"), lambda one: {k: v for k, v in one.items() if k != "psi"})
    yield follow("upside down", refused(), lambda one: one | {k: one[k][::-1] for k in fluxes})
    yield follow(
        "in x and z",
        refused(),
        lambda one: {k.replace("r_edges", "x_edges").replace("flux_r", "flux_x"): v for k, v in one.items()},
    )
    yield follow("a chamber 2 cm narrower", refused("another vessel"), wall=[[0.5, 4], [0.5, 2], [0.98, 2], [0.98, 0]])
    yield follow("a plain cylinder", refused("another vessel"), wall=[[1, 4], [1, 0]])
    yield follow("shifted by 10 cm in z", refused("vessel|covers"), by=(0.0, 0.1))
    yield follow("shifted by 10 cm downwards", refused("vessel|covers"), by=(0.0, -0.1))
    yield follow("shifted by 2 cm in r", refused("another vessel"), by=(0.02, 0.0))
    yield follow("shifted by 5 m in z", refused("covers"), by=(0.0, 5.0))
    yield follow(
        "edges shifted by half a cell in z",
        refused("vessel|covers"),
        lambda one: one | {"z_edges": one["z_edges"] + 0.0125},
    )
    yield follow("cut below", refused("covers"), wall=[[0.5, 4], [0.5, 2], [1, 2], [1, 0.5]])
    yield follow("a core twice as fast", marked("seam"), core=2.0)
    yield follow("a core four times as fast", marked("seam"), core=4.0)
    yield follow(
        "half the flow at the bottom",
        refused("field.npz: not a field"),
        lambda one: one | {k: one[k] * np.linspace(0.5, 1, len(one[k]))[:, None] for k in fluxes},
    )
    case = {"case.yaml": varied(HYBRID, {})}
    for name, content in {
        "text": "not a field",
        "nothing": "",
        "a ZIP that is cut": b"PK\x03\x04" + bytes(100),
    }.items():
        act = granpipe("run", "case.yaml", files=case | {"field.npz": content})
        yield Attack("known field", f"file: {name}", act, refused("field.npz"))
    yield Attack("known field", "file: missing", granpipe("run", "case.yaml", files=case), refused("field.npz"))
    for name, target in {"a folder": ".", "/dev/zero": "/dev/zero"}.items():
        text = varied(HYBRID, {"fluid.known_field": target})
        yield Attack("known field", f"file: {name}", granpipe("run", "case.yaml", files={"case.yaml": text}), refused())
    act = granpipe("run", "case.yaml", files=case | {"field.npz": os.mkfifo})
    yield Attack("known field", "file: a pipe", act, refused("field.npz"))
