"""Cases of small vessels by their walls, in mm, for tests of the planner."""

from __future__ import annotations

import math

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import parse_yaml
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan

FLAT = "[[90, 110], [90, 0], [24, 0], [24, -6]]"
SIZE = "{diameter: 2 mm}"


def case_of(wall: str, *, size: str = SIZE, bulk: str = "bulk_density: 1500", **changes: str) -> Case:
    """A case in mm of spheres of 2500 kg/m³, with dotted keys (`__` for the dot) changed."""
    text = f"""
name: vessel
outline: {{unit: mm, wall: {wall}}}
material: {{density: 2500, {bulk}, size: {size}}}
flow_rate: 0.1 g/s
"""
    data, places = parse_yaml(text, "vessel.yaml")
    return resolve(data, places, {key.replace("__", "."): value for key, value in changes.items()}).case


def plan_of(wall: str, **changes: str) -> Plan:
    return make_plan(case_of(wall, **changes))


def hopper(half_angle: float) -> str:
    """Shaft, hopper of this half-angle [deg] from the vertical and outlet pipe."""
    height = 66 / math.tan(math.radians(half_angle))
    return f"[[90, {height + 200}], [90, {height}], [24, 0], [24, -6]]"


def said(half_angle: float) -> dict[str, str]:
    """The sections of such a hopper, which the case calls mass flow."""
    height = 66 / math.tan(math.radians(half_angle))
    return {"outline__sections": f"{{a: [{height + 200}, {height}], b: {{z: [{height}, 0], regime: mass_flow}}, "
            "c: [0, -6]}"}  # fmt: skip
