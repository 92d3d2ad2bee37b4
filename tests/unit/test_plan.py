"""The planner: which model and stages, settings by rule, and what it refuses or marks."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from granpipe.case.reader import load_case, read_case
from granpipe.errors import CaseError
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent, duration_text

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
    plan = plan_of(CASES / "reactor.yaml", model="dem")
    produce = next(stage for stage in plan.stages if stage.name == "produce")
    assert "widens" in produce.reason
    assert "ring" in produce.reason


SIEVED = "{{diameter: {{sieve: {{edges: [{}, 8 mm, 9 mm], fractions: [30 %, 40 %, 30 %]}}}}, by: mass}}"


def test_the_plan_says_how_the_vessel_is_filled(tiny: Path) -> None:
    for how, finest in {"packed bed": "4 mm, 5 mm", "drop in": "1 mm, 1.2 mm"}.items():
        plan = plan_of(tiny, material__size=SIEVED.format(finest))
        assert how in next(stage.reason for stage in plan.stages if stage.name == "settle")


def test_particles_too_large_for_an_opening_are_refused_with_the_ratio(tiny: Path) -> None:
    with pytest.raises(CaseError, match=r"only 3 times the particles' d90"):
        plan_of(tiny, material__size__diameter="4 cm")


def test_a_time_step_of_the_case_outside_the_stable_range_is_marked(tiny: Path) -> None:
    assert plan_of(tiny).breaches == ()
    rayleigh = plan_of(tiny).dem.rayleigh_time
    assert plan_of(tiny, dem__time_step=repr(0.15 * rayleigh)).breaches == ()
    (breach,) = plan_of(tiny, dem__time_step=repr(0.3 * rayleigh)).breaches
    assert "Rayleigh" in breach


def test_the_automatic_step_is_what_damped_contacts_allow_and_a_fifth_of_the_rayleigh_time_at_most(tiny: Path) -> None:
    strong, usual, weak = (plan_of(tiny, contact__restitution=e).dem for e in ("0.1", "0.43", "0.95"))
    assert strong.time_step / strong.rayleigh_time < 0.105
    assert 0.15 < usual.time_step / usual.rayleigh_time < 0.18
    assert 0.18 < weak.time_step / weak.rayleigh_time <= 0.2
    assert plan_of(tiny, contact__wall="{restitution: 0.1}").dem.time_step < usual.time_step


def test_fast_particles_in_a_thin_skin_shorten_the_automatic_step(tiny: Path) -> None:
    """Soft particles of a tall vessel: what falls through it would jump over the skin in a fifth of a Rayleigh time."""
    wall = "[[6, 800], [6, 0]]"
    dem = plan_of(tiny, outline__wall=wall, contact__youngs_modulus="1e6").dem
    assert dem.time_step < 0.15 * dem.rayleigh_time
    assert dem.time_step * (2 * 9.81 * 8) ** 0.5 < 0.5 * dem.skin


def test_youngs_modulus_follows_the_weight_of_the_bed(tiny: Path) -> None:
    light, heavy = (
        plan_of(tiny, material__density=rho, flow_rate="0.1 kg/s").dem.youngs_modulus for rho in ("200", "20000")
    )
    assert heavy == pytest.approx(100 * light, rel=0.1)
    assert plan_of(tiny, contact__wall="{friction: 0}").dem.youngs_modulus > plan_of(tiny).dem.youngs_modulus


def test_a_modulus_of_the_case_that_is_far_too_soft_is_marked(tiny: Path) -> None:
    auto = plan_of(tiny).dem.youngs_modulus
    assert plan_of(tiny, contact__youngs_modulus=repr(0.9 * auto)).breaches == ()
    (breach,) = plan_of(tiny, contact__youngs_modulus=repr(0.1 * auto)).breaches
    assert "overlaps" in breach


def test_a_mixture_of_ten_to_one_is_stiffer_so_that_the_large_do_not_press_the_small_through_walls(tiny: Path) -> None:
    """Few small ones: the bed is that of the large ones, and its stress the same to 2 %."""
    size = "{{diameter: {{sieve: {{edges: {}, fractions: {}}}}}, by: mass}}"
    large = {"material__size": size.format("[20 mm, 20.2 mm]", "[1]")}
    mixed = {"material__size": size.format("[2 mm, 2.02 mm, 20 mm, 20.2 mm]", "[0.01, 0, 0.99]")}
    one, both = (plan_of(tiny, **sizes).dem for sizes in (large, mixed))
    assert both.youngs_modulus / one.youngs_modulus == pytest.approx(6.325, rel=0.1)  # two digits each
    (breach,) = plan_of(tiny, **mixed, contact__youngs_modulus=repr(both.youngs_modulus / 4)).breaches
    assert "through walls" in breach


def test_particles_that_neither_rub_nor_lose_energy_are_refused(tiny: Path) -> None:
    with pytest.raises(CaseError, match="never come to rest") as refusal:
        plan_of(tiny, contact__restitution="1", contact__friction="0")
    assert refusal.value.key == ("contact", "restitution")
    plan_of(tiny, contact__restitution="1")
    plan_of(tiny, contact__friction="0")


def test_the_automatic_plate_speed_stays_below_a_tenth_of_the_free_discharge(tiny: Path) -> None:
    plan = plan_of(tiny, dem__plate_speed="auto")
    assert plan.breaches == ()
    free = 0.58 * 9.81**0.5 * (0.12 - 1.4 * 0.02) ** 2.5 / (3.14159 * 0.06**2)
    assert 0.09 < plan.dem.plate_speed / free <= 0.1
    faster = plan_of(tiny, dem__plate_speed=str(1.5 * plan.dem.plate_speed))
    assert any("inertia" in breach for breach in faster.breaches)


def test_a_small_opening_beside_a_wide_one_slows_the_plate(tiny: Path) -> None:
    """A free ring leaves a wide way inside and a narrow one outside; what the narrow one can let through counts."""
    changes = {"outline__wall": "[[30, 30], [30, 0]]"}
    open_pipe = plan_of(tiny, dem__plate_speed="auto", **changes)
    ring = "{ring: [[15, 14], [19, 14], [19, 16], [15, 16]]}"
    with_ring = plan_of(tiny, dem__plate_speed="auto", outline__obstacles=ring, **changes)
    assert with_ring.dem.plate_speed < open_pipe.dem.plate_speed
    (decision,) = [decision for decision in with_ring.decisions if decision.name == "plate_speed"]
    assert "gap between ring and the wall" in decision.criterion


def test_the_plan_says_what_coarse_graining_leaves_alone(tiny: Path) -> None:
    changes = {"material__size__diameter": "0.6 cm", "dem__coarse_grain_factor": "2"}
    fine, coarse = plan_of(tiny, material__size__diameter="0.6 cm"), plan_of(tiny, **changes)
    assert "coarse_grain_factor" in {decision.name for decision in coarse.decisions}
    assert coarse.dem.classes.largest == pytest.approx(2 * fine.dem.classes.largest)
    assert coarse.case.contact == fine.case.contact


def test_few_facets_are_marked_and_odd_numbers_refused(tiny: Path) -> None:
    assert plan_of(tiny, dem__facets="16").breaches == ()
    (breach,) = plan_of(tiny, dem__facets="8").breaches
    assert "facets" in breach
    with pytest.raises(CaseError, match="multiple of 4"):
        plan_of(tiny, dem__facets="10")


def test_snapshots_and_segments_follow_the_plates_travel(tiny: Path) -> None:
    dem = plan_of(tiny).dem
    travel = dem.plate_speed * dem.time_step
    assert travel * dem.dump_every == pytest.approx(0.1 * 0.02, rel=0.02)
    assert dem.segment_steps == dem.dump_every
    assert dem.duration == pytest.approx(1.2, rel=0.2)


def test_a_long_run_has_longer_segments_but_no_more_of_them(tiny: Path) -> None:
    dem = plan_of(tiny, dem__max_time="1200", dem__reservoir_height="0.1").dem
    assert dem.segments <= 1024
    assert dem.duration == pytest.approx(1200, rel=0.02)


def test_a_section_thinner_than_a_row_of_the_grid_is_refused_before_anything_is_run(tiny: Path) -> None:
    """A curved wall is flattened into many short pieces, each of them a section."""
    curved = {"outline__wall": "[[6.2, 10], [6.1, 5], [6.05, 4.9], [6.0, 0]]"}
    with pytest.raises(CaseError, match=r"section s2, z = 0.049 … 0.05 m, holds no row .* join it with a neighbour"):
        plan_of(tiny, **curved)
    joined = "{a: {z: [10, 5]}, b: {z: [5, 0]}}"
    assert plan_of(tiny, **curved, outline__sections=joined).dem.segments
    assert plan_of(tiny, **curved, homogenize__cell="0.8 mm").dem.segments


def test_a_longer_time_changes_nothing_but_the_number_of_segments(tiny: Path) -> None:
    short, long = plan_of(tiny, dem__max_time="1 s").dem, plan_of(tiny, dem__max_time="auto").dem
    assert long.segments > 2 * short.segments
    same = replace(short, segments=0, length=long.length, particles=0, ranks=0, decisions=())
    assert same == replace(long, segments=0, particles=0, ranks=0, decisions=())
    assert short.length.room == long.length.room
    assert short.lowest - short.plate_speed * (long.duration - short.duration) == pytest.approx(long.lowest)


def test_the_time_chosen_moves_the_widest_section_by_six_diameters_and_grows_with_the_error_asked_for(
    tiny: Path,
) -> None:
    plan = plan_of(tiny, dem__max_time="auto")
    assert plan.dem.plate_speed * plan.dem.length.time == pytest.approx(6 * 0.02, rel=0.1)
    times = [
        plan_of(tiny, dem__max_time="auto", dem__statistical_error=f"{e} %", homogenize__method="psi").dem.length.time
        for e in (20, 2, 1)
    ]
    assert times[0] == plan.dem.length.time
    assert times[2] == pytest.approx(4 * times[1], rel=0.1)


FREE = 0.58 * math.sqrt(9.81) * (0.12 - 1.4 * 0.02) ** 2.5 / (math.pi * 0.06**2)
"""Speed of the tiny case's plate [m/s] at free discharge, after Beverloo."""

FASTER = {"dem__start_speed": "auto", "outline__wall": "[[6, 30], [6, 0]]"}


def test_a_faster_start_is_half_of_free_discharge_in_whole_segments_over_a_twelfth_of_the_content(
    tiny: Path,
) -> None:
    plan = plan_of(tiny, **FASTER)
    dem = plan.dem
    segment = dem.segment_steps * dem.time_step
    assert dem.start_segments == math.ceil(0.025 / (0.5 * FREE * segment))
    assert dem.start_speed * dem.start_segments * segment == pytest.approx(0.3 / 12, rel=1e-9)
    after = (dem.segments_left_out - dem.start_segments) * segment * dem.plate_speed
    assert 0.002 - 1e-9 <= after < 0.002 + segment * dem.plate_speed
    assert dem.plate_level(dem.steps) > dem.bottom
    assert plan_of(tiny, dem__start_speed="auto").dem.start_segments == 0  # a third of the height: not a diameter


CONE = {"outline__wall": "[[6.5, 30], [6, 0]]"}
"""An outlet 6 cm in radius below a slope."""


def test_the_plate_is_a_radius_below_a_slope_when_the_average_begins(tiny: Path) -> None:
    small = FASTER | CONE | {"material__size": "{diameter: 4 mm}"}
    plain, faster = plan_of(tiny, **small | {"dem__start_speed": "0.03"}).dem, plan_of(tiny, **small).dem
    assert plain.plate_z == pytest.approx(-0.06)
    assert faster.length.start_travel > 0.02
    assert faster.plate_z == pytest.approx(-0.06 + faster.length.start_travel)
    assert -0.06 - 0.001 < faster.plate_level(faster.segments_left_out * faster.segment_steps) <= -0.06
    wide = plan_of(tiny, **FASTER | CONE).dem
    assert wide.plate_z == pytest.approx(-5 * 0.02 + wide.length.start_travel)


def test_the_plate_is_five_diameters_below_a_straight_outlet_when_the_average_begins_and_two_before(tiny: Path) -> None:
    """Content over outlet is 30 cm: a twelfth of it is the start's travel."""
    small = FASTER | {"material__size": "{diameter: 4 mm}"}
    plain, faster = plan_of(tiny, **small | {"dem__start_speed": "0.03"}).dem, plan_of(tiny, **small).dem
    assert plain.plate_z == pytest.approx(-5 * 0.004)
    assert faster.plate_z == pytest.approx(-2 * 0.004)
    assert faster.plate_level(faster.segments_left_out * faster.segment_steps) < -5 * 0.004


def test_the_reservoir_is_a_radius_above_a_slope_and_half_of_it_or_five_diameters_above_a_straight_inlet(
    tiny: Path,
) -> None:
    small = {"material__size": "{diameter: 4 mm}", "dem__reservoir_height": "auto"}
    sloping = plan_of(tiny, **small | {"outline__wall": "[[6.5, 30], [6, 0]]"}).dem
    straight = plan_of(tiny, **small | {"outline__wall": "[[6, 30], [6, 0]]"}).dem
    large = plan_of(tiny, **FASTER | {"dem__reservoir_height": "auto"}).dem  # in the same pipe, of 2 cm
    for dem, height in ((sloping, 0.065), (straight, 0.03), (large, 5 * 0.02)):
        assert 0.5 * (dem.feed_bottom + dem.feed_top) == pytest.approx(0.3 + height)


def test_a_packed_bed_has_most_particles_of_a_full_vessel_and_room_to_settle(tiny: Path) -> None:
    """A straight pipe of 6 cm: from 2 cm below to 3 cm above the vessel of 30 cm."""
    small = {"material__size": "{diameter: 4 mm}", "dem__reservoir_height": "auto"}
    dem = plan_of(tiny, **small, outline__wall="[[6, 30], [6, 0]]").dem
    full = 0.58 * 0.06**2 * 0.35 / (4 / 3 * 0.002**3)
    assert dem.placed == pytest.approx(0.9 * full, rel=1e-3)
    assert dem.bed_top - dem.feed_top == pytest.approx(0.25 * 0.35)
    assert dem.wall_top > dem.bed_top


def test_a_faster_start_begins_after_a_free_fall_and_where_it_cannot_move_the_bed_only_at_rest(tiny: Path) -> None:
    dem = plan_of(tiny, **FASTER).dem
    height = 0.5 * 9.81 * (dem.fall_steps * dem.time_step) ** 2
    assert height == pytest.approx(dem.feed_top - dem.plate_z, rel=0.02)
    for changes in (
        {"dem__start_speed": "0.03"},  # none
        {"material__size": SIEVED.format("1 mm, 1.2 mm")},  # all is dropped in
    ):
        assert plan_of(tiny, **FASTER | changes).dem.fall_steps == 0


def test_a_very_slow_plate_starts_in_one_segment_that_is_not_too_long(tiny: Path) -> None:
    dem = plan_of(tiny, **FASTER, dem__plate_speed="1e-5", dem__max_time="auto").dem
    assert dem.start_segments == 1
    assert dem.plate_z - dem.plate_level(dem.start_steps) == pytest.approx(0.3 / 12)


@pytest.mark.parametrize("changes", [{"dem__plate_speed": "0.08", "dem__start_speed": "0.1"}, {"dem__outlet": "open"}])
def test_without_gain_or_without_a_plate_there_is_no_faster_start(tiny: Path, changes: dict[str, str]) -> None:
    dem = plan_of(tiny, **FASTER | changes).dem
    assert (dem.start_segments, dem.segments_left_out, dem.pace) == (0, 0, 1.0)


def test_a_start_beyond_what_the_solids_can_follow_is_marked_or_refused(tiny: Path) -> None:
    assert not any("start_speed" in breach for breach in plan_of(tiny, **FASTER).breaches)
    marked = plan_of(tiny, **FASTER | {"dem__start_speed": f"{FREE:.4g}"}).breaches
    assert any("of free discharge: the solids lag behind" in breach for breach in marked)
    with pytest.raises(CaseError, match=r"dem\.start_speed.*1\.6 times what falls freely"):
        plan_of(tiny, **FASTER | {"dem__start_speed": f"{1.6 * FREE:.4g}"})


def test_a_time_that_is_too_short_is_told_with_a_better_one_which_is_not(tiny: Path) -> None:
    short = plan_of(tiny, dem__max_time="0.5 s")
    (said,) = (one for one in short.warnings if one.startswith("max_time"))
    better = said.split("try ")[1].split(" s")[0]
    assert not any(one.startswith("max_time") for one in plan_of(tiny, dem__max_time=f"{better} s").warnings)


def test_an_average_cannot_begin_after_the_time_that_is_chosen(tiny: Path) -> None:
    with pytest.raises(CaseError, match="must be below the time of production"):
        plan_of(tiny, dem__max_time="auto", homogenize__start="900 s")


def test_replicas_share_the_cores(tiny: Path) -> None:
    one, many = plan_of(tiny), plan_of(tiny, dem__replicas="1000")
    assert many.dem.ranks == 1
    assert many.particle_steps == pytest.approx(1000 * one.particle_steps)
    assert many.seconds <= 1000 * one.seconds * (1 + 1e-9)  # rounding


def test_a_case_for_more_cores_than_there_are_can_be_planned_but_not_run(tiny: Path) -> None:
    assert plan_of(tiny, dem__ranks="4000").dem.ranks == 4000
    with pytest.raises(CaseError, match=r"dem\.ranks: 4000 ranks, but this machine has \d+ cores"):
        run_case(read_case(tiny, {"dem.ranks": "4000"}), tiny.parent / "results", Silent())


def test_the_cores_that_are_given_decide_the_ranks_whatever_this_machine_has() -> None:
    case = load_case(CASES / "reactor.yaml")
    assert [make_plan(case, cores).dem.ranks for cores in (1, 2, 64)] == [1, 2, 4]


def test_the_plan_names_what_it_leaves_out(tiny: Path) -> None:
    left = {
        stage.name for stage in plan_of(tiny, contact__rolling_model="none", contact__rolling_friction="0").left_out
    }
    assert {"rolling model", "size classes", "obstacle meshes"} <= left


def test_a_plate_that_would_leave_the_solids_behind_is_refused(tiny: Path) -> None:
    auto = plan_of(tiny).dem.plate_speed
    assert "too fast" in plan_of(tiny, dem__plate_speed=repr(10 * auto)).breaches[0]
    with pytest.raises(CaseError, match="leave the solids behind"):
        plan_of(tiny, dem__plate_speed=repr(100 * auto))


def test_particles_too_small_for_the_facets_of_the_wall_are_the_cases_fault(tiny: Path) -> None:
    with pytest.raises(CaseError, match="wall facets per turn") as caught:
        plan_of(tiny, outline__unit="m", outline__wall="[[1, 0.0064], [1, 0]]", material__size="{diameter: 0.8 mm}")
    assert caught.value.key == ("material", "size")


def test_millimetres_without_their_unit_are_asked_for(tiny: Path) -> None:
    tiny.write_text(tiny.read_text().replace("  unit: cm\n", ""))
    for model, size in (("dem", "2 cm"), ("dem", "1 m"), ("fluid", "2 cm")):
        changes = {"outline__wall": "[[250, 800], [250, 0]]", "material__bulk_density": "1200", "model": model}
        with pytest.raises(CaseError, match=r"500 m wide: did you mean outline\.unit: mm\?"):
            plan_of(tiny, material__size__diameter=size, homogenize__cell="0.0075", **changes)


def test_a_run_too_short_for_the_fit_says_how_long_the_remedy_takes(tiny: Path) -> None:
    changes = {"homogenize__method": "psi", "homogenize__start": "auto", "dem__plate_speed": "0.04"}
    with pytest.raises(
        CaseError, match=r"simulate [\d.]+ s or more, which takes about [\d.]+ (s|min) .*to compute"
    ) as no:
        plan_of(tiny, dem__max_time="0.1 s", **changes)
    seconds = re.search(r"simulate ([\d.]+) s", str(no.value))
    assert seconds is not None
    plan = plan_of(tiny, dem__max_time=f"{seconds[1]} s", **changes)
    assert f"takes about {duration_text(plan.seconds)} to compute" in str(no.value)


def test_the_planner_touches_no_file_and_starts_no_process() -> None:
    """A hook on everything that Python reports of the operating system, set once all modules are loaded."""
    script = f"""
import sys
from dataclasses import replace
from pathlib import Path
from granpipe.case.reader import load_case
from granpipe.planning.make import make_plan, model_plans
cases = [load_case(Path(path)) for path in {[str(path) for path in sorted(CASES.glob("*.yaml"))]}]
first = [(make_plan(case, 2), model_plans(case, 2)) for case in cases]
seen = []
watched = ("open", "os.", "subprocess.", "socket.", "shutil.", "glob.", "tempfile.", "import", "ctypes.")
sys.addaudithook(lambda event, args: seen.append((event, args)) if event.startswith(watched) else None)
again = [(make_plan(case, 2), model_plans(case, 2)) for case in cases]
found = list(seen)
assert [plan.decisions for plan, _ in again] == [plan.decisions for plan, _ in first]
open({str(CASES / "smoke.yaml")!r}).close()
assert len(seen) > len(found), "the hook does not see"
print(found)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
