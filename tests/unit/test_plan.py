"""The planner: which model and stages, settings by rule, and what it refuses or marks."""

from __future__ import annotations

from pathlib import Path

import pytest

from granpipe.case import load_case
from granpipe.errors import CaseError
from granpipe.plan import Plan, make_plan

CASES = Path(__file__).parents[2] / "cases"


def plan_of(path: Path, **overrides: str) -> Plan:
    return make_plan(load_case(path, {key.replace("__", "."): value for key, value in overrides.items()}))


def test_the_papers_run_is_planned_at_its_own_numbers() -> None:
    plan = plan_of(CASES / "reactor_paper.yaml")
    assert plan.dem.time_step == 1e-5
    assert plan.dem.youngs_modulus == 4.7e9
    assert plan.dem.duration == pytest.approx(200, rel=0.01)
    assert 100_000 < plan.dem.particles < 150_000  # the paper: about 134 000
    assert plan.particle_steps == pytest.approx(2.7e12, rel=0.25)


def test_a_mass_flow_hopper_between_straight_sections_needs_no_dem() -> None:
    plan = plan_of(CASES / "hopper.yaml", model="auto")
    assert plan.model == "fluid"
    assert plan.settings is None


def test_the_reactor_needs_dem_and_the_plan_says_where() -> None:
    plan = plan_of(CASES / "reactor.yaml", model="auto")
    assert plan.model == "dem"
    produce = next(stage for stage in plan.stages if stage.name == "produce")
    assert "widens" in produce.reason
    assert "ring" in produce.reason


def test_particles_too_large_for_an_opening_are_refused_with_the_ratio(tiny: Path) -> None:
    with pytest.raises(CaseError, match=r"only 3 times the particles' d90"):
        plan_of(tiny, material__size__diameter="4 cm")


def test_a_time_step_of_the_case_outside_the_stable_range_is_marked(tiny: Path) -> None:
    assert plan_of(tiny).breaches == ()
    (breach,) = plan_of(tiny, dem__time_step="4e-4").breaches
    assert "Rayleigh" in breach


def test_the_automatic_step_is_a_fifth_of_the_rayleigh_time_or_a_little_less(tiny: Path) -> None:
    dem = plan_of(tiny).dem
    assert 0.18 < dem.time_step / dem.rayleigh_time <= 0.2


def test_the_automatic_plate_speed_stays_below_a_tenth_of_the_free_discharge(tiny: Path) -> None:
    plan = plan_of(tiny, dem__plate_speed="auto")
    assert plan.breaches == ()
    faster = plan_of(tiny, dem__plate_speed=str(1.5 * plan.dem.plate_speed))
    assert any("inertia" in breach for breach in faster.breaches)


def test_snapshots_and_segments_follow_the_plates_travel(tiny: Path) -> None:
    dem = plan_of(tiny).dem
    travel = dem.plate_speed * dem.time_step
    assert travel * dem.dump_every == pytest.approx(0.1 * 0.02, rel=0.02)
    assert dem.segment_steps == dem.dump_every
    assert dem.duration == pytest.approx(1.2, rel=0.2)


def test_a_long_run_has_longer_segments_but_no_more_of_them(tiny: Path) -> None:
    dem = plan_of(tiny, dem__max_time="120", dem__reservoir_height="0.1").dem
    assert dem.segments <= 256
    assert dem.duration == pytest.approx(120, rel=0.02)


def test_replicas_share_the_cores(tiny: Path) -> None:
    assert plan_of(tiny, dem__replicas="1000").dem.ranks == 1


def test_more_ranks_than_cores_are_refused(tiny: Path) -> None:
    with pytest.raises(CaseError, match="cores"):
        plan_of(tiny, dem__ranks="4000")


def test_the_plan_names_what_it_leaves_out(tiny: Path) -> None:
    left = {
        stage.name for stage in plan_of(tiny, contact__rolling_model="none", contact__rolling_friction="0").left_out
    }
    assert {"rolling model", "size classes", "obstacle meshes"} <= left
