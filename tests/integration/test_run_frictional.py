"""The route of the frictional fluid: what it tells beside its field."""

from dataclasses import replace

import numpy as np
import pytest

from granpipe.analysis.compare import compare
from granpipe.case.reader import resolve
from granpipe.case.yamlfile import parse_yaml
from granpipe.export.quantities import at_process_scale
from granpipe.pipeline.frictional_field import frictional_field
from granpipe.planning.plan import Plan, make_plan

HOPPER = """
name: hopper
outline: {unit: mm, wall: [[60, 160], [60, 90], [30, 30], [30, 0]]}
material: {density: 2500, bulk_density: 1400, size: {diameter: 6 mm}}
contact: {friction: 0.5, rolling_friction: 0.1, wall: {friction: 0.3}}
flow_rate: 0.2 kg/s
model: fluid
fluid: {rheology: frictional}
"""


def plan_of(text: str) -> Plan:
    data, places = parse_yaml(text, "hopper.yaml")
    return make_plan(resolve(data, places, {}).case)


def test_the_change_with_friction_is_kept_as_sensitivity_and_is_no_noise() -> None:
    plan = plan_of(HOPPER)
    assert plan.friction is not None
    made = frictional_field(plan, plan.friction)
    field = made.field
    assert field.flux_r_se is None
    assert field.flux_z_se is None
    slower = replace(field, flow_scale=0.9 * field.flow_scale)
    whole, *_ = compare(field, slower, {}, 0.006)
    assert whole.noise == 0
    assert whole.noise_free == whole.upper == pytest.approx(0.1)

    gates = {gate.name: gate for gate in made.gates}
    assert gates["change of a frictional fluid's field with a coarser mesh"].value == made.figures["mesh"]
    assert 1e-4 < made.figures["mesh"] < 0.02

    told = made.figures["sensitivity"]["wall friction ± 20 %"]
    bulk = np.where(field.bulk, field.grid.ring_area, 0)
    speed = 0.5 * (field.flux_z[1:] + field.flux_z[:-1]) / field.bulk_packing
    relative = np.sqrt((bulk * field.extra["sensitivity"] ** 2).sum() / (bulk * speed**2).sum())
    assert 0.01 < told < 0.2
    assert 0.9 * told < relative < 1.5 * told  # of two ways the larger one, cell by cell
    scaled = at_process_scale(slower, "sensitivity")
    np.testing.assert_allclose(scaled, 0.9 * at_process_scale(field, "sensitivity"))
