"""The route of the frictional fluid: what it tells beside its field."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granpipe.analysis.compare import compare
from granpipe.case.reader import resolve
from granpipe.case.yamlfile import parse_yaml
from granpipe.errors import CaseError
from granpipe.export.quantities import at_process_scale
from granpipe.field import Field, Grid, divergence, flux_from_psi, level_flow
from granpipe.pipeline.context import Context
from granpipe.pipeline.frictional_field import frictional_field
from granpipe.pipeline.hybrid_field import hybrid_field
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent
from granpipe.system.store import Store

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


PIPE = """
name: pipe
outline:
  unit: cm
  wall: [[6, 24], [6, 10], [8.5, 10], [8.5, 0]]
  sections: {{pipe: [24, 10], chamber: [10, 0]}}
material: {{density: 2000, size: {{diameter: 6 mm}}}}
contact: {{friction: 0.3, rolling_friction: 0.1, wall: {{friction: 0.3}}}}
flow_rate: 1 kg/s
model: hybrid
fluid: {{rheology: frictional, known_field: {known}}}
homogenize: {{cell: 5 mm}}
"""
CORE = 0.06


def core_flow(path: Path) -> Field:
    """A field of the pipe and its chamber: a plug as wide as the pipe, and rest beside it."""
    grid = Grid.covering(0.085, 0.0, 0.24, 0.005)
    packing, flow = 0.6, 1.0 / (2000 * 0.6)
    row = -packing * flow / (2 * np.pi) * np.minimum(grid.r_edges / CORE, 1.0) ** 2
    psi = np.tile(row, (len(grid.z_edges), 1))
    inside = np.where((grid.z_centres[:, None] < 0.1) | (grid.r_centres < CORE), 1.0, 0.0)
    flux_r, flux_z = flux_from_psi(psi, grid)
    field = Field(grid, inside, inside > 0, flux_r, flux_z, flow, packing, 1.0, psi=psi)
    field.save(path)
    return field


def test_a_hybrid_joins_a_frictional_fluid_to_what_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    less = lambda plan, friction: [("wall friction", replace(friction, wall=0.8 * friction.wall))]  # noqa: E731
    monkeypatch.setattr("granpipe.pipeline.frictional_field._changed", less)  # one way is enough here
    known = core_flow(tmp_path / "field.npz")
    plan = plan_of(PIPE.format(known=tmp_path / "field.npz"))
    assert plan.wall_factors == ()
    assert plan.friction is not None
    made = hybrid_field(plan, Context(Store(tmp_path / "store"), {}, Silent(), 1))
    field = made.field
    z = field.grid.z_edges
    np.testing.assert_allclose(level_flow(field.flux_z, field.grid), 1.0 / 2000, rtol=1e-12)
    assert np.abs(divergence(field.flux_r, field.flux_z, field.grid)).max() < 1e-12

    below = z <= 0.1  # the chamber, as it is known
    np.testing.assert_allclose(field.flux_z[below], known.flux_z[below], atol=1e-9)
    (span,) = plan.followed
    above = z > span.cut_top + 1e-9  # beyond the margin: the fluid, whose wall layer the plug does not have
    profile = -field.flux_z[above][-1, :12] / (1.0 / 2000 / (np.pi * CORE**2))
    assert profile[0] > 1.02
    assert profile[-1] < 0.9
    sensitivity = field.extra["sensitivity"]
    assert sensitivity[field.grid.z_centres < 0.1].max() == 0
    assert sensitivity[field.grid.z_centres > span.cut_top].max() > 0


def test_nothing_is_joined_where_particles_fill_the_whole_vessel(tmp_path: Path) -> None:
    core_flow(tmp_path / "field.npz")
    short = PIPE.format(known=tmp_path / "field.npz").replace("24", "15")
    with pytest.raises(CaseError, match="nothing is left for a frictional fluid"):
        plan_of(short)
