"""Health of a run: what breaks physics is seen and named with its remedy; what beds do is let pass."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.dem.health import ArchError, FillingHealth, FlowHealth
from granpipe.dem.run import Status
from granpipe.dem.snapshot import OWN_COLUMNS, Snapshot
from granpipe.errors import RunError
from granpipe.pipeline.health_limits import flow_limits
from granpipe.planning.make import make_plan

RADIUS = 0.01
MASS = 4 / 3 * math.pi * RADIUS**3 * 2000
SPEED = 0.03  # of the plate in the tiny case


def health(tiny: Path, present: int = 100, **changes: str) -> FlowHealth:
    case = load_case(tiny, {key.replace("__", "."): value for key, value in changes.items()})
    plan = make_plan(case)
    return FlowHealth(
        plan.dem, case, flow_limits(plan.outline, plan.dem, case.contact.wall.friction, plan.facets), present
    )


def status(step: int = 0, particles: int = 100, energy: float = 1e-3, inserted: int = 0, discharged: int = 0) -> Status:
    return Status(step, particles, energy * particles * MASS, inserted, 0, discharged)


def snapshot(step: int, position: np.ndarray, velocity: object = 0.0, first: int = 1) -> Snapshot:
    n = len(position)
    values = np.column_stack(
        [np.arange(first, first + n), np.ones(n), position, np.zeros((n, 3)) + velocity, np.full(n, RADIUS)]
    )
    return Snapshot(step, np.zeros((3, 2)), OWN_COLUMNS, values)


def column(spacing: float = 2 * RADIUS, low: float = -0.02, high: float = 0.1) -> np.ndarray:
    """Spheres on a square lattice in the vessel of 6 cm radius."""
    x = np.arange(-0.04, 0.0401, spacing)
    place = np.stack(np.meshgrid(x, x, np.arange(low, high, spacing)), axis=-1).reshape(-1, 3)
    return place[np.hypot(place[:, 0], place[:, 1]) < 0.05]


def test_a_balance_that_closes_at_every_row_passes(tiny: Path) -> None:
    watch = health(tiny)
    watch.row(status(0))
    watch.row(status(100, particles=105, inserted=7, discharged=2))


def test_a_single_lost_particle_is_seen_at_the_next_row(tiny: Path) -> None:
    watch = health(tiny)
    with pytest.raises(RunError, match=r"step 100: .*balance.*100 present before \+ 3 inserted − 0 discharged ≠ 102"):
        watch.row(status(100, particles=102, inserted=3))
    with pytest.raises(RunError, match="balance"):
        FillingHealth(make_plan(load_case(tiny)).dem, load_case(tiny), 7).row(status(10, particles=11, inserted=5))


def test_what_had_fallen_before_a_resume_may_go_unseen_and_no_more(tiny: Path) -> None:
    case = load_case(tiny)
    plan = make_plan(case)
    watch = FlowHealth(
        plan.dem,
        case,
        flow_limits(plan.outline, plan.dem, case.contact.wall.friction, plan.facets),
        present=100,
        fallen=2,
    )
    for left in (100, 99, 98):
        watch.row(status(particles=left))
    for left in (97, 101):
        with pytest.raises(RunError, match="balance"):
            watch.row(status(particles=left))


@pytest.mark.parametrize("energy", [100.0, math.inf, math.nan])
def test_energy_that_no_fall_can_give_is_a_blow_up(tiny: Path, energy: float) -> None:
    with pytest.raises(RunError, match=r"kinetic energy is .* unstable; make dem\.time_step smaller"):
        health(tiny).row(status(energy=energy))


def test_free_fall_while_filling_is_no_blow_up_and_more_than_that_is(tiny: Path) -> None:
    case = load_case(tiny)
    settings = make_plan(case).dem
    watch = FillingHealth(settings, case, 0)
    fall = 9.81 * (settings.feed_top - settings.plate_z)
    watch.row(status(energy=fall, inserted=100))
    with pytest.raises(RunError, match="a fall through the whole vessel"):
        watch.row(status(energy=2 * fall, inserted=100))


def test_a_lot_of_fed_particles_may_fall_onto_a_bed_that_hardly_moves(tiny: Path) -> None:
    slow = {"dem__plate_speed": "1e-5", "dem__start_speed": "1e-5"}
    fall = 9.81 * 0.08 * 20 / 120  # J/kg: twenty of them, from the top of the feed region
    with pytest.raises(RunError, match="unstable"):
        health(tiny, **slow).row(status(100, energy=fall))
    watch = health(tiny, **slow)
    watch.row(status(100, energy=0.0))
    watch.row(status(200, particles=120, inserted=20, energy=fall))
    with pytest.raises(RunError, match="unstable"):  # they have landed long ago
        watch.row(status(20_000, particles=120, inserted=20, energy=fall))


def test_a_bed_that_heats_up_slowly_is_seen_below_the_peak_that_a_moment_may_have(tiny: Path) -> None:
    watch = health(tiny)
    peak = 3 * watch.energy
    watch.row(status(0, energy=peak))  # a moment of it is a slip
    for step in range(100, 3000, 100):
        watch.row(status(step, energy=0.0))
    hot = (status(step, energy=peak) for step in range(3000, 20_000, 100))
    with pytest.raises(RunError, match=r"over the last diameter of plate travel .* heats up"):
        list(map(watch.row, hot))


def test_a_flowing_bed_is_healthy(tiny: Path) -> None:
    watch = health(tiny)
    for step in range(0, 3000, 300):
        watch.snapshot(snapshot(step, column() - [0, 0, step * SPEED * watch.settings.time_step], [0, 0, -SPEED]))
    watch.closely(snapshot(0, column()))


@pytest.mark.parametrize(
    "place", [[0.061, 0, 0.05], [0, 0.07, 0.05], [0, 0, -0.2], [0, 0, 0.5]], ids=["wall", "y", "plate", "top"]
)
def test_a_particle_outside_the_walls_is_found(tiny: Path, place: list[float]) -> None:
    with pytest.raises(RunError, match=r"1 particle outside the walls.*youngs_modulus"):
        health(tiny).snapshot(snapshot(0, np.vstack([column(), place])))


def test_a_particle_inside_an_obstacle_is_outside_the_walls(tiny: Path) -> None:
    ring = {"outline__obstacles": "{ring: [[4, 4], [6, 4], [6, 5], [4, 5]]}", "material__size__diameter": "0.5 cm"}
    health(tiny, **ring).snapshot(snapshot(0, np.array([[0.03, 0, 0.045]])))
    with pytest.raises(RunError, match="outside the walls"):
        health(tiny, **ring).snapshot(snapshot(0, np.array([[0.05, 0, 0.045]])))


def test_a_single_particle_faster_than_any_fall_is_seen(tiny: Path) -> None:
    velocity = np.zeros((len(column()), 3))
    velocity[7, 1] = 3.0  # after a fall through everything it would be below that
    health(tiny).snapshot(snapshot(0, column(), velocity))
    velocity[7, 1] = 30.0
    with pytest.raises(RunError, match=r"moves at 30 m/s.*dem\.time_step"):
        health(tiny).snapshot(snapshot(0, column(), velocity))


def test_a_step_too_long_for_the_collisions_that_happen_is_seen(tiny: Path) -> None:
    fast = snapshot(0, column(), [0, 0, -2.0])
    health(tiny).snapshot(fast)
    with pytest.raises(RunError, match=r"of that, 20% at the most: make dem\.time_step smaller"):
        health(tiny, dem__time_step="6e-4", contact__youngs_modulus="5e6").snapshot(fast)


def test_travel_beyond_half_the_skin_in_a_step_is_seen(tiny: Path) -> None:
    with pytest.raises(RunError, match="neighbour skin"):
        health(tiny, dem__time_step="3e-3").snapshot(snapshot(0, column(), [0, 0, -2.0]))


@pytest.mark.parametrize(("overlap", "name"), [(0.05, "mean"), (0.02, "")])
def test_mean_overlap_beyond_its_limit_asks_for_stiffer_particles(tiny: Path, overlap: float, name: str) -> None:
    bed = snapshot(0, column(spacing=2 * RADIUS * (1 - overlap)))
    if not name:
        health(tiny).closely(bed)
        return
    with pytest.raises(RunError, match=r"overlap by 5\.0% of a diameter \(mean.*youngs_modulus"):
        health(tiny).closely(bed)


def test_a_few_deep_overlaps_count_by_their_percentile(tiny: Path) -> None:
    """One contact in fifty as deep as a quarter of a diameter, the others light: mean 0.6 %."""
    low = np.column_stack([np.zeros((50, 2)), np.arange(50.0)])
    high = low + np.column_stack([np.zeros((50, 2)), np.where(np.arange(50) < 1, 1.5, 1.998) * RADIUS])
    with pytest.raises(RunError, match=r"overlap by \d+\.\d% of a diameter \(99th percentile of 50 contacts\), 10%"):
        health(tiny).closely(snapshot(0, np.vstack([low, high])))


def falling(watch: FlowHealth, passes: bool, diameters: float) -> None:
    """A plate that sinks: the particles above the outlet follow it, or stand still; those below always follow."""
    step_travel = SPEED * watch.settings.time_step
    start = column(low=-0.04, high=0.2)
    above = (start[:, 2] > 0) & (not passes)
    for step in range(0, round(diameters * 2 * RADIUS / step_travel), 300):
        travel = np.where(above, 0.0, step * step_travel)
        watch.snapshot(snapshot(step, start - travel[:, None] * [0, 0, 1]))


def test_small_particles_are_looked_for_behind_the_facets_and_not_behind_the_circle(tiny: Path) -> None:
    """A square of the area of a circle of 6 cm has its corners 7.52 cm from the axis and its sides 5.32 cm."""
    case = load_case(tiny)
    vessel = flow_limits(make_plan(case).outline, make_plan(case).dem, 0.5, 4)
    corner, side = math.sqrt(math.pi / 2) * 0.06, math.sqrt(math.pi) / 2 * 0.06
    for turn, reach in ((0, corner), (90, corner), (45, side), (225, side)):
        across = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))])
        centres = np.array([[*(part * reach * across), 0.01] for part in (0.99, 1.01)])
        assert vessel.inside(centres).tolist() == [True, False]


def test_the_facets_of_an_obstacle_are_its_own(tiny: Path) -> None:
    """A cylinder of 2 cm in radius on the axis, of as few facets as there are, twelve: their middles lie 1.98 cm away,
    their corners 2.05 cm. The vessel has more of them."""
    wall = {"outline.wall": "[[30, 60], [30, 0]]", "outline.sections": "{all: [60, 0]}"}
    case = load_case(tiny, wall | {"outline.obstacles": "{core: [[0, 40], [2, 40], [2, 20], [0, 20]]}"})
    vessel = flow_limits(make_plan(case).outline, make_plan(case).dem, 0.5, None)
    for turn, reach in ((0, 0.02047), (15, 0.01977)):
        across = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))])
        centres = np.array([[*(part * reach * across), 0.3] for part in (0.995, 1.005)])
        assert vessel.inside(centres).tolist() == [False, True]


def test_an_arch_at_the_outlet_is_named_after_some_diameters_of_plate_travel(tiny: Path) -> None:
    falling(health(tiny), passes=True, diameters=9)
    falling(health(tiny), passes=False, diameters=4.5)  # bursts and the start are no arch
    with pytest.raises(RunError, match=r"0\.0% of the imposed flow has passed the outlet at z = 0 m.*: an arch"):
        falling(health(tiny), passes=False, diameters=9)


def test_an_arch_in_a_throat_is_named_after_some_diameters_of_travel_in_the_throat(tiny: Path) -> None:
    """A throat of a quarter of the outlet's area: 5/4 of a diameter of plate travel are 5 in it."""
    wall = "[[6, 60], [6, 30], [3, 20], [3, 15], [6, 15], [6, 0]]"
    size = {"material.size": "{diameter: 1 cm}", "dem.coarse_grain_factor": "2"}
    case = load_case(tiny, {"outline.wall": wall, "outline.sections": "{all: [60, 0]}"} | size)
    plan = make_plan(case)
    settings, vessel = plan.dem, flow_limits(plan.outline, plan.dem, case.contact.wall.friction, plan.facets)
    diameter = settings.classes.sauter_diameter
    steps = round(0.1 * diameter / vessel.speed / settings.time_step)
    spheres = column(low=0.01, high=0.6)
    stuck = spheres[:, 2] > 0.15

    def sink(watch: FlowHealth, held: np.ndarray, begins: float, ends: float) -> None:
        """The plate sinks from one travel to another [diameters]; what is held stays where it is."""
        for number in range(round(10 * begins), round(10 * ends) + 1):
            travel = 0.1 * diameter * np.where(held, 0.0, number * np.where(spheres[:, 2] > 0.15, 4, 1))
            watch.passing.add(snapshot(number * steps, spheres - travel[:, None] * [0, 0, 1]))

    begins = 0.1 * (0.15 - settings.plate_z) / diameter
    assert list(vessel.areas.values()) == pytest.approx([np.pi * 0.03**2, np.pi * 0.06**2])
    sink(FlowHealth(settings, case, vessel, len(spheres)), np.zeros_like(stuck), 0, begins + 2)
    sink(FlowHealth(settings, case, vessel, len(spheres)), stuck, 0, begins + 1.1)
    seen = r"0\.0% of the imposed flow has passed the throat at z = 0\.15 m.*the plate takes \d\d% of .* an arch"
    with pytest.raises(ArchError, match=seen):
        sink(FlowHealth(settings, case, vessel, len(spheres)), stuck, 0, begins + 1.6)


def test_what_falls_through_an_open_outlet_and_is_taken_out_has_passed_it(tiny: Path) -> None:
    watch = health(tiny, dem__outlet="open")
    spheres = column(low=0.05, high=0.2)
    steps = round(0.02 / (watch.vessel.speed * watch.settings.time_step))  # one diameter of travel
    for number in range(12):
        watch.snapshot(snapshot(number * steps, spheres, first=1 + 10_000 * number))  # all gone, and new ones there
    stuck = (snapshot(number * steps, spheres) for number in range(12, 24))
    with pytest.raises(RunError, match="arch"):
        list(map(watch.snapshot, stuck))


FASTER = {"dem__start_speed": "auto", "outline__wall": "[[6, 30], [6, 0]]"}


def test_a_bed_in_a_faster_start_may_have_that_speeds_energy_and_must_calm_down_after_it(tiny: Path) -> None:
    watch = health(tiny, **FASTER)
    settings = watch.settings
    change, fall = settings.start_steps, math.sqrt(2 * (settings.wall_top - settings.lowest) / 9.81)
    energy = 3 * watch.energy + (watch.start_energy - watch.energy)  # of the bed at the start speed, and more
    for step in range(0, change + 1, 100):
        watch.row(status(step, energy=energy))
    late = range(change + math.ceil(fall / settings.time_step), settings.steps, 100)
    with pytest.raises(RunError, match=r"heats up|unstable"):
        list(map(watch.row, (status(step, energy=energy) for step in late)))
    with pytest.raises(RunError, match="unstable"):
        watch.row(status(0, energy=100.0))


def test_a_bed_that_was_left_to_the_faster_start_may_go_on_falling_for_the_time_of_a_free_fall(tiny: Path) -> None:
    watch = health(tiny, **FASTER)
    settings = watch.settings
    fall = math.sqrt(2 * (settings.wall_top - settings.lowest) / 9.81) / settings.time_step
    falling = 0.5 * (9.81 * 0.1)  # on average half of what a fall by 10 cm gives
    for step in range(0, int(fall), 100):
        watch.row(status(step, energy=falling))
    with pytest.raises(RunError, match="flow and falls"):
        watch.row(status(int(fall) + 1, energy=falling))
    with pytest.raises(RunError, match="a fall through the whole vessel"):
        watch.row(status(100, energy=1.01 * 9.81 * (settings.wall_top - settings.lowest)))
    settled = health(tiny)  # at one speed the bed was at rest
    with pytest.raises(RunError, match="flow and falls"):
        settled.row(status(0, energy=falling))


def test_the_plate_is_where_both_its_speeds_have_brought_it(tiny: Path) -> None:
    watch = health(tiny, **FASTER)
    settings = watch.settings
    for step in (settings.start_steps // 2, settings.start_steps, settings.steps):
        fast = min(step, settings.start_steps)
        level = settings.plate_z - settings.time_step * (settings.start_speed * fast + SPEED * (step - fast))
        watch.snapshot(snapshot(step, np.array([[0.0, 0.0, level + 1e-6]])))
        with pytest.raises(RunError, match="outside the walls"):
            watch.snapshot(snapshot(step, np.array([[0.0, 0.0, level - 1e-6]])))


def test_an_arch_in_a_faster_start_names_the_speed_of_the_start(tiny: Path) -> None:
    """Free discharge through the throat moves the plate at 0.029 m/s."""
    throat = {
        "outline__wall": "[[6, 90], [6, 20], [3, 15], [3, 10], [6, 10], [6, 0]]",
        "outline__sections": "{all: [90, 0]}",
        "material__size": "{diameter: 1 cm}",
        "dem__coarse_grain_factor": "2",
        "dem__walls": "as_drawn",
        "dem__plate_speed": "0.002",
        "dem__start_speed": "0.0234",
    }
    watch = health(tiny, **FASTER | throat)
    steps = round(0.002 / (watch.settings.start_speed * watch.settings.time_step))  # a tenth of a diameter
    still = (snapshot(number * steps, column(low=0.11, high=0.3)) for number in range(40))
    with pytest.raises(RunError, match=r"the plate takes 6\d% of the free discharge .* smaller dem\.start_speed"):
        list(map(watch.passing.add, still))
