"""Decks: only the blocks that a scene needs, legal seeds, no text from a case, the same bytes every time."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.dem.deck import Deck, bed_lines, make_deck, render
from granpipe.dem.packing import Bed
from granpipe.errors import CaseError
from granpipe.geometry.insertion import insertion_frusta
from granpipe.geometry.outline import Outline
from granpipe.planning.make import make_plan


def deck_of(case: Case) -> Deck:
    plan = make_plan(case)
    settings = plan.dem
    frusta = insertion_frusta(plan.outline, settings.feed_top, settings.plate_z, settings.classes.largest, 0.5)
    meshes = [f"obstacle_{name}" for name in plan.outline.obstacles]
    return make_deck(case, settings, frusta, meshes, ((-plan.outline.r_max, plan.outline.r_max),) * 2)


TALL = {"outline.wall": "[[6, 30], [6, 0]]"}
FASTER = TALL | {"dem.start_speed": "auto"}


def deck_with(tiny: Path, **overrides: str) -> Deck:
    return deck_of(load_case(tiny, {key.replace("__", "."): value for key, value in overrides.items()}))


def test_the_same_case_gives_the_same_deck(tiny: Path) -> None:
    first, second = (render(deck_with(tiny), name) for name in ("fill.in", "fill.in"))
    assert first == second
    assert render(deck_with(tiny, dem__seed="2"), "fill.in") != first


def test_seeds_are_different_primes_above_ten_thousand(tiny: Path) -> None:
    text = render(deck_with(tiny), "fill.in")
    seeds = [int(s) for s in re.findall(r"(?:seed|particletemplate/sphere|numberbased) (\d+)", text)]
    assert len(seeds) >= 4
    assert len(set(seeds)) == len(seeds)
    assert all(s > 10_000 and all(s % d for d in range(2, int(s**0.5) + 1)) for s in seeds)


def test_no_rolling_model_without_rolling_friction(tiny: Path) -> None:
    assert "rolling" in render(deck_with(tiny), "produce.in").lower()
    bare = render(deck_with(tiny, contact__rolling_model="none", contact__rolling_friction="0"), "produce.in")
    assert "rolling" not in bare.lower()


def test_no_tangential_history_without_friction(tiny: Path) -> None:
    text = render(deck_with(tiny, contact__friction="0", contact__rolling_friction="0"), "produce.in")
    assert "tangential off" in text
    assert "history" not in text


def test_walls_of_their_own_friction_are_a_second_material(tiny: Path) -> None:
    assert deck_with(tiny).types == 1
    own = deck_with(tiny, contact__wall__friction="0.2")
    assert own.types == 2
    assert own.friction == (0.5, 0.2, 0.2, 0.2)


def test_stiffness_beyond_liggghts_range_is_announced_before_the_box(tiny: Path) -> None:
    text = render(deck_with(tiny, contact__youngs_modulus="4.7e9"), "fill.in")
    assert text.index("hard_particles  yes") < text.index("read_data")
    assert "hard_particles" not in render(deck_with(tiny), "fill.in")


def test_hooke_brings_its_characteristic_velocity(tiny: Path) -> None:
    text = render(deck_with(tiny, contact__model="hooke", contact__characteristic_velocity="0.5"), "fill.in")
    assert "model hooke" in text
    assert "characteristicVelocity scalar 0.5" in text


def test_an_open_outlet_has_a_catcher_and_no_sinking_plate(tiny: Path) -> None:
    text = render(deck_with(tiny, dem__outlet="open"), "produce.in")
    assert "massflow/mesh" in text
    assert "move/mesh" not in text
    assert "meshes vessel\n" in text


def test_the_plate_sinks_at_the_plates_speed(tiny: Path) -> None:
    assert "move/mesh mesh plate linear 0.0 0.0 -0.03" in render(deck_with(tiny), "produce.in")


def test_a_plate_with_a_faster_start_changes_its_speed_at_a_segment_and_nothing_else(tiny: Path) -> None:
    settings = make_plan(load_case(tiny, FASTER)).dem
    text = render(deck_with(tiny, **{key.replace(".", "__"): value for key, value in FASTER.items()}), "produce.in")
    change, move = settings.start_segments + 1, "all move/mesh mesh plate linear 0.0 0.0"
    start, final = f"fix starting {move} {-settings.start_speed:.10g}", f"fix sinking {move} -0.03"
    assert f'if              "${{first}} <= {change}" then "{start}" else "{final}"' in text
    assert f'if              "${{segment}} == {change}" then "unfix starting" "{final}"' in text
    lines = [line for line in text.splitlines() if "move/mesh" not in line and "plate sinks" not in line]
    plain = render(deck_with(tiny, outline__wall=TALL["outline.wall"]), "produce.in").splitlines()
    assert lines == [line for line in plain if "move/mesh" not in line and "plate sinks" not in line]


def test_the_box_holds_the_plates_whole_travel(tiny: Path) -> None:
    deck = deck_with(tiny, dem__max_time="2")
    plan = make_plan(load_case(tiny, {"dem.max_time": "2"}))
    assert deck.box[4] < plan.dem.plate_z - 0.03 * 2


def test_a_mesh_name_that_could_be_a_command_is_refused(tiny: Path) -> None:
    case = load_case(tiny)
    plan = make_plan(case)
    frusta = insertion_frusta(Outline.from_case(case), plan.dem.feed_top, plan.dem.plate_z, 0.01, 0.5)
    with pytest.raises(CaseError, match="cannot name a mesh"):
        make_deck(case, plan.dem, frusta, ["x\nshell rm -rf /"], ((-0.06, 0.06),) * 2)


def test_only_fine_particles_need_a_limit_for_small_regions(tiny: Path) -> None:
    limited = re.compile(r"^region .*volume_limit", re.MULTILINE)
    assert not limited.search(render(deck_with(tiny), "fill.in"))
    fine = deck_with(
        tiny,
        flow_rate="0.02 kg/s",
        outline__unit="mm",
        material__size="{diameter: 0.1 mm}",
        dem__reservoir_height="0.5 mm",
    )
    text = render(fine, "fill.in")
    regions = re.findall(r"^region +(?:feed|fill\d+) .*$", text, re.MULTILINE)
    assert regions
    assert all("volume_limit" in region for region in regions)


@pytest.mark.parametrize(
    ("fields", "pairs", "walls"),
    [("[]", 0, 0), ("[coordination, strain_rate]", 0, 0), ("[wall_pressure]", 0, 1), ("[stress]", 1, 1)],
)
def test_contacts_are_dumped_only_where_forces_are_asked_for(tiny: Path, fields: str, pairs: int, walls: int) -> None:
    text = render(deck_of(load_case(tiny, {"homogenize.fields": fields})), "produce.in")
    assert (text.count("pair/gran/local"), text.count("wall/gran/local")) == (pairs, walls)


def test_liggghts_is_told_each_placed_particle_as_its_template_has_it(tiny: Path) -> None:
    deck = deck_with(tiny)
    text = "".join(bed_lines(deck, Bed(np.array([[0.1, -0.2, 0.3], [0.0, 0.0, 1 / 3]]), np.array([0, 0]))))
    assert "2 atoms\n1 atom types\n" in text
    assert f"{deck.box[0]:.10g} {deck.box[1]:.10g} xlo xhi\n" in text
    number, kind, diameter, density, *centre = text.splitlines()[-1].split()
    assert (number, kind) == ("2", "1")
    assert 0.5 * float(diameter) == float(f"{deck.classes[0].radius:.10g}")
    assert float(density) == deck.classes[0].density
    assert list(map(float, centre)) == pytest.approx([0, 0, 1 / 3], rel=1e-8)


def test_runs_with_a_faster_start_share_a_bed_that_is_nearly_at_rest_and_the_others_one_at_rest(tiny: Path) -> None:
    start = {key.replace(".", "__"): value for key, value in FASTER.items()}
    speed = np.sqrt(9.81 * 2 * deck_with(tiny).classes[0].radius)
    assert deck_with(tiny).rest_energy == pytest.approx(0.5 * (0.01 * speed) ** 2)
    for plate_speed in ("0.02", "0.01"):
        deck = deck_with(tiny, **start | {"dem__plate_speed": plate_speed})
        assert deck.start_segments
        assert deck.rest_energy == pytest.approx(0.5 * (0.05 * speed) ** 2)


def test_before_a_faster_start_a_packed_bed_is_given_the_time_of_a_free_fall(tiny: Path) -> None:
    start = {key.replace(".", "__"): value for key, value in FASTER.items()}
    assert "${passed}" not in render(deck_with(tiny), "fill.in")  # at one speed the bed comes to rest
    deck = deck_with(tiny, **start)
    assert f"(${{passed}} >= {deck.fall_steps}) && (${{present}} >= {deck.enough})" in render(deck, "fill.in")
    assert "${passed}" not in render(deck, "fill.in", bed="")  # nor where all is dropped in


def test_a_vessel_without_a_packed_bed_begins_empty(tiny: Path) -> None:
    deck = deck_with(tiny)
    assert "create_box" in render(deck, "fill.in", bed="")
    assert "read_data" not in render(deck, "fill.in", bed="")
    assert "create_box" not in render(deck, "fill.in")
