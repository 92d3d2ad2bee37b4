"""The validation against others: its judges on data of known answers, and the page against the data that is kept."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import free_surface
import numpy as np
import pytest
from validation import (
    article,
    beverloo,
    dosta,
    error_bars,
    hoppers,
    janssen,
    lammps,
    monte_carlo,
    other_code,
    other_surface,
    pebble_bed,
    repose,
)
from validation.__main__ import run_short
from validation.case import Case, Verdict
from validation.page import lines, tally
from validation.suite import CASES, results_of, run_together

from granpipe.case.reader import read_case
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import RunError
from granpipe.field import Grid
from granpipe.pipeline import dem_stages
from granpipe.planning.make import make_plan

ROOT = Path(__file__).parents[2]
DATA = ROOT / "benchmarks" / "references" / "validation"


def test_the_page_is_that_of_the_kept_results() -> None:
    judged = {case.name: list(case.judge(results_of(case, DATA)[0])) for case in CASES if results_of(case, DATA)[0]}
    assert judged
    page = (ROOT / "docs" / "validation" / "validation.md").read_text()
    assert page == "\n".join(lines(judged, DATA)) + "\n"
    count = tally([one for verdicts in judged.values() for one in verdicts])
    assert count in (ROOT / "docs" / "validation" / "index.md").read_text()


def test_kept_results_are_of_pieces_that_there_are() -> None:
    pieces = {case.name: set(case.pieces) for case in CASES}
    for path in DATA.glob("*.json"):
        assert set(json.loads(path.read_text())) <= pieces[path.stem]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, id=name)
        for name, text in {
            "error_bars": error_bars.text(3),
            "other_code": other_code.text("one", 1),
            "other_surface": other_surface.text(),
            "beverloo": beverloo.text("one", 12, 0.2, 1),
            "dosta": dosta.text("M2", 60),
            "janssen": janssen.text("one", 0.4),
            "pebble_bed": pebble_bed.text("one", 30.0),
            "hoppers": hoppers.FLAT[0].text(),
        }.items()
    ],
)
def test_every_scene_can_be_planned_within_the_rules(text: str, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(text)
    plan = make_plan(read_case(tmp_path / "scene.yaml").case, 1)
    assert [one.name for one in plan.decisions if one.breach] == []


def test_beverloo_finds_the_constants_of_exact_rates() -> None:
    ratio = np.array([6.0, 8.0, 10.0, 12.0, 6.0, 8.0])
    (c, k), half = beverloo.beverloo(ratio, 0.61 * (ratio - 1.45) ** 2.5)
    assert (c, k) == (pytest.approx(0.61, rel=1e-6), pytest.approx(1.45, rel=1e-6))
    assert np.all(half < 1e-6)


def test_beverloo_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng, held, ratio = np.random.default_rng(1), [], np.array([6.0, 8.0, 10.0, 12.0, 6.0, 8.0])
    for _ in range(300):
        rate = 0.58 * (ratio - 1.4) ** 2.5 * np.exp(0.01 * rng.standard_normal(len(ratio)))
        (c, k), (c_half, k_half) = beverloo.beverloo(ratio, rate)
        held.append((abs(c - 0.58) <= c_half, abs(k - 1.4) <= k_half))
    assert np.mean(held, axis=0) == pytest.approx([0.95, 0.95], abs=0.04)


def test_spreading_finds_b_of_gaussian_profiles() -> None:
    radius = np.linspace(0.125, 9.9, 40)
    profiles = [np.exp(-(radius**2) / (2.0 + 4 * 1.7 * z)) / (2.0 + 4 * 1.7 * z) for z in beverloo.HEIGHTS]
    assert beverloo.local({"radius": radius, "profiles": profiles, "ratio": 8}, 3.0, 5.0) == pytest.approx(
        1.7, rel=1e-3
    )
    b, error, straight, levels = beverloo.spreading({"radius": radius, "profiles": profiles, "ratio": 8})
    assert b == pytest.approx(1.7, rel=1e-4)
    assert error < 1e-3
    assert straight > 0.9999
    assert levels >= 4


def test_random_points_agree_with_the_homogenizer_on_moving_spheres() -> None:
    rng = np.random.default_rng(2)
    count, grid = 30, Grid(np.linspace(0, 0.04, 9), np.linspace(0, 0.05, 11))
    place = np.column_stack([rng.uniform(-0.02, 0.02, (count, 2)), rng.uniform(0.005, 0.045, count)])
    move = rng.normal(0, 1e-3, (count, 3)) - [0, 0, 2e-3]

    def at(step: int) -> Snapshot:
        position = place + step * move
        values = np.column_stack([np.arange(1.0, count + 1), position, move, np.full(count, 4e-3)])
        names = ("id", "x", "y", "z", "vx", "vy", "vz", "radius")
        return Snapshot(step, np.array([[-1.0, 1.0]] * 3), names, values)

    found = monte_carlo.compare([0.0, 1.0, 2.0], [at(step) for step in range(3)], grid)
    for name in ("volume", "flow_r", "flow_z"):
        assert found[name][3] < 0.03  # thirty particles are few, and half a cell of path from one snapshot to the next


def test_numbers_of_the_unit_cube_fill_the_ball_evenly() -> None:
    points = monte_carlo.in_ball(np.random.default_rng(4).random((100_000, 3)))
    distance = np.linalg.norm(points, axis=1)
    assert (distance**3).mean() == pytest.approx(0.5, abs=0.004)  # the volume within a point is uniform
    assert points.mean(axis=0) == pytest.approx([0, 0, 0], abs=0.006)
    assert (points**2).mean(axis=0) == pytest.approx([0.2, 0.2, 0.2], rel=0.02)


def test_error_bars_of_independent_noise_hold() -> None:
    rng, data = np.random.default_rng(3), {}
    for seed in range(6):
        data[seed] = {"effective": 29 / error_bars.FREEDOM, "speed": 1.0}
        for name in error_bars.NAMES:
            data[seed][name] = 1 + 0.1 * rng.standard_normal((40, 40))
            data[seed][f"{name}_se"] = 0.1 * np.sqrt(rng.chisquare(29, (40, 40)) / 29)
    for name in error_bars.NAMES:
        ratio, held = error_bars.measured(data, name)
        assert ratio == pytest.approx(1, abs=0.05)
        assert held == pytest.approx(0.95, abs=0.015)
        assert error_bars.freedom(data, name) == pytest.approx(29, rel=0.5)  # of six only, whose median lies higher


def test_zhou_is_the_published_formula_with_arms_in_millimetres() -> None:
    # by hand for d = 6 mm, μ = 0.5, μ_r = 0.1: 68.61 · 0.5^0.49 · 0.15^0.06 · 0.3^0.12 · 6^−0.2, arms 0.15 and 0.3 mm
    assert repose.zhou(0.5, 0.1) == pytest.approx(68.61 * 0.7120 * 0.8924 * 0.8655 * 0.6988, rel=1e-3)


def test_a_cone_is_in_mass_flow_on_the_right_side_of_the_limit() -> None:
    one = {"half_angle": 30.0, "wall_friction": 0.3, "slowest": 0.4, "limit": 41.0, "internal": 25.0, "wall": 14.0}
    words = []
    for changes in (
        {},
        {"slowest": 0.01},
        {"half_angle": 60.0},
        {"half_angle": 60.0, "slowest": 0.01},
        {"limit": 32.0},
    ):
        (verdict,) = hoppers.judge({"cones": {"x": one | changes}})
        words.append(verdict.passed)
    assert words == [True, False, False, True, None]


def a_column(raised: float) -> dict[str, object]:
    """A column that obeys Janssen's law with K 0.7 and friction 0.15, its stress raised by a part at half height."""
    radius, height, weight, k, friction = janssen.RADIUS, janssen.HEIGHT, 14000.0, 0.7, 0.15
    edges = np.linspace(0, height, 97)
    z = 0.5 * (edges[1:] + edges[:-1])
    length = radius / (2 * friction * k)

    def law(at: np.ndarray) -> np.ndarray:
        return np.asarray(weight * length * (1 - np.exp(-(height - at) / length)))

    stress = law(z) * (1 + raised * (np.abs(z / height - 0.5) < 0.02))
    pressure = k * law(z)
    return {
        "wall_friction": 0.2, "z": z, "stress": stress, "stress_r": k * stress, "weight": np.full(z.shape, weight),
        "edges": edges, "pressure": pressure, "raw_pressure": pressure, "raw_friction": friction * pressure,
    }  # fmt: skip


def test_a_column_by_janssens_law_holds_and_another_fails() -> None:
    verdicts = janssen.judge({"one": a_column(0.0)})
    assert [one.passed for one in verdicts] == [True] * 4
    _, stress, law, k, friction = janssen.janssen(a_column(0.0))
    assert (k, friction) == (pytest.approx(0.7), pytest.approx(0.15))
    assert law == pytest.approx(stress, rel=1e-9)
    assert janssen.by_level(a_column(0.0)) == pytest.approx(stress, rel=1e-4)
    assert janssen.judge({"one": a_column(0.3)})[0].passed is False


def test_a_wall_layer_ends_where_nine_tenths_of_the_core_are_reached() -> None:
    """Speed 1, and 0.5 within 0.15 m of a wall at 1 m: 3 radii of particles of 0.1 m; none where all is a plug."""
    r = np.arange(0.005, 1, 0.01)
    assert article.layer(r, np.where(r < 0.85, 1.0, 0.5), 1.0, 0.1) == pytest.approx(3, abs=0.1)
    assert article.layer(r, np.ones_like(r), 1.0, 0.1) == 0


def test_wall_forces_come_from_the_file_of_liggghts(tmp_path: Path) -> None:
    """10 N inwards, and upwards 2 N of 3 N for friction 0.2, at 0.1 m; a sphere on the plate does not count."""
    radius = janssen.RADIUS
    rows = [[0, radius, 0.1, 0, radius - 0.003, 0.1, 0, -10, 3], [0, 0, 0, 0, 0, 0.003, 0, 0, 50]]
    (tmp_path / "contacts.1.txt").write_text("\n".join(["head"] * 9 + [" ".join(map(str, row)) for row in rows]) + "\n")
    inward, upward = janssen.wall_forces([tmp_path / "contacts.1.txt"], np.array([0.0, 0.05, 0.15]), 0.2)
    area = 2 * np.pi * radius * 0.1
    assert inward == pytest.approx([0, 10 / area])
    assert upward == pytest.approx([0, 2 / area])


def test_measures_of_a_pebble_bed() -> None:
    """A plug at 10 mm/s with a layer 2 d thick at half that speed; a corner at a fifth of the axis' speed."""
    radius = np.linspace(0.125, 9.875, 40)
    plug = np.where(radius < 8, 0.01, 0.005)
    corner = np.where(radius < 5, 0.05, 0.01)
    one = {"angle": 60.0, "radius": radius, "profiles": {"plug": plug, "corner": corner}, "residence": [8, 10, 15]}
    found = pebble_bed.measures(one)
    assert found["plug"] == pytest.approx(0)
    assert found["wall"] == pytest.approx(0.5)
    assert found["layer"] == pytest.approx(2, abs=0.13)
    assert found["corner"] == pytest.approx(0.2)
    assert found["spread"] == pytest.approx(0.7)


def test_the_rate_of_a_bed_that_empties_steadily() -> None:
    """2 kg/s from 0.1 s on, in snapshots 7 ms apart, with mass that goes in lumps of 1 g."""
    times = np.arange(0, 0.6, 0.007)
    above = 3 - np.round(2 * np.maximum(times - 0.1, 0), 3)
    value, error = dosta.rate({"times": times, "above": above})
    assert value == pytest.approx(2, rel=2e-3)
    assert error < 0.02


def test_lammps_gets_the_numbers_of_the_case(tmp_path: Path) -> None:
    (tmp_path / "silo.yaml").write_text(dosta.text("M1", 40))
    plan = make_plan(read_case(tmp_path / "silo.yaml").case, 1)
    lines = lammps.deck(plan, dosta.walls(plan, 40), 0.1, every=50, lost="ignore").splitlines()
    stiff = f"{plan.dem.youngs_modulus:g}"
    pair = next(line for line in lines if line.startswith("pair_coeff"))
    assert pair.startswith(f"pair_coeff * * hertz/material {stiff} 0.5 0.2 tangential mindlin NULL ")
    assert " 0.3 damping" in pair  # friction, and no rolling resistance
    walls = [line for line in lines if "wall/gran/region" in line]
    assert len(walls) == 3
    assert all(f"hertz/material {stiff} 0.4 0.2 " in line and " 0.2 damping" in line for line in walls)
    assert "region cone cone z 0 0 0.02 0.11 0.001 0.091 open 1 open 2" in lines
    assert any(line.startswith("dump all all custom 50 ") for line in lines)
    assert f"run {round(0.1 / plan.dem.time_step)}" in lines


def test_scenes_of_lammps_have_plates_of_one_speed_and_others_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    for text in (other_code.text("hopper1", 1), other_surface.text()):
        path.write_text(text)
        plan = make_plan(read_case(path).case, 1)
        walls = other_surface.walls(plan)
        assert lammps.deck(plan, walls, 0.1, every=50).count("wall/gran/region") == len(walls)
        path.write_text(re.sub(r"start_speed: 1 mm/s", "start_speed: auto", re.sub(r"homogenize: .*", "", text)))
        with pytest.raises(RunError, match=r"dem\.start_speed"):
            lammps.deck(make_plan(read_case(path).case, 1), walls, 0.1, every=50)


def test_another_filling_angle_does_not_last() -> None:
    with free_surface.filling(80.0):
        assert math.degrees(dem_stages.filling_angle(0.5, 0.1)) == pytest.approx(80)
    assert math.degrees(dem_stages.filling_angle(0.5, 0.1)) == pytest.approx(41, abs=1)


def test_surfaces_and_fields_of_two_codes_are_judged_with_their_errors() -> None:
    def judged(angle: float, upper: float) -> list[bool | None]:
        codes = {"liggghts": [[28.0, 1.0]] * 3, "lammps": [[angle, 1.0]] * 3}
        data = {
            code: {"angles": angles, "apart": {"chamber": [0.05, 0.04, 0.03, upper]}} for code, angles in codes.items()
        }
        return [one.passed for one in other_surface.judge(data)]

    assert judged(29.0, 0.04) == [True, True]
    assert judged(33.0, 0.06) == [None, None]
    assert judged(35.0, 0.06) == [False, None]


def test_cases_that_run_together_are_kept_and_failed_ones_named(tmp_path: Path) -> None:
    """The cones are kept references, read in a second; LAMMPS' silo needs one that granpipe has not run."""
    failed = run_together([(dosta.CASE, "lammps-M1-40"), (hoppers.CASE, "cones")], 2, tmp_path, tmp_path)
    assert failed == ["dosta"]
    assert "silo-m1-40" in (tmp_path / "dosta.log").read_text()
    assert set(json.loads((tmp_path / "hoppers.json").read_text())) == {"cones"}


@pytest.mark.parametrize(("passed", "status"), [(True, 0), (None, 0), (False, 4)])
def test_the_short_form_ends_with_status_4_where_a_verdict_fails(
    passed: bool | None, status: int, tmp_path: Path
) -> None:
    case = Case("one", "", "", "", "", {"piece": lambda _: {"value": 1}}, lambda _: [Verdict("", "", "", passed)])
    assert run_short([(case, "piece")], tmp_path / "results", tmp_path / "data") == status


def test_verdicts_of_numpy_are_counted() -> None:
    """np.False_ is not False: it must not count among what holds."""
    assert Verdict("q", "1", "2", np.bool_(False)).passed is False
    assert Verdict("q", "1", "1", np.bool_(True)).passed is True
    assert Verdict("q", "1", "1 ± 9", None).passed is None


def test_two_ways_of_filling_gave_the_same_free_surface_for_four_frictions() -> None:
    """As docs/validation/free_surface.md tells it; all surfaces are flatter than both fillings."""
    text = (Path(__file__).parents[2] / "docs" / "validation" / "free_surface.md").read_text()
    rows = re.findall(r"\| ([\d.]+) \| ([\d.]+) \| (\d+)° \| ([\d.]+) ± ([\d.]+)° \| ([\d.]+) ± ([\d.]+)°", text)
    found: dict[str, dict[int, tuple[float, ...]]] = {}
    for friction, _, filling, *angles in rows:
        found.setdefault(friction, {})[int(filling)] = tuple(map(float, angles))
    assert {name: set(one) for name, one in found.items()} == {
        "0.3": {37, 60},
        "0.5": {41, 60},
        "0.73": {45, 60},
        "1": {51, 60},
    }
    for fillings in found.values():
        for at in (0, 2):  # settled, flowing
            (one, error), (other, other_error) = (angles[at : at + 2] for angles in fillings.values())
            assert abs(one - other) <= 2 * math.hypot(error, other_error)
            assert max(one, other) < min(fillings)
