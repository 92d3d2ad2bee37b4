"""Friction from an angle of repose: slope of a heap, the fitted surface and its inversion, the search."""

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.cli import main
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import CaseError, DataError, RunError
from granpipe.progress import Silent
from granpipe.repose.heap import LENGTH, WIDTH, Pair, make_heap, slope
from granpipe.repose.heaps import Asked, HeapRecord
from granpipe.repose.report import draw, found_data, found_text, found_yaml
from granpipe.repose.response import LEAST, MOST, ROLLING_SCALE, SLIDING_SCALE, fit
from granpipe.repose.search import FRICTIONS, NEAR, ROLLINGS, Found, search

CASE = {
    "name": "beads",
    "outline": {"wall": [[0.3, 1], [0.3, 0]]},
    "material": {
        "density": 1000,
        "size": {"diameter": {"normal": {"mean": "6 mm", "std": "0.6 mm", "min": "5 mm", "max": "7 mm"}}},
    },
    "flow_rate": "1 kg/h",
}
TEXT = """\
name: beads
outline: {wall: [[0.3, 1], [0.3, 0]]}
material: {density: 1000, size: {diameter: 6 mm}}
contact: {rolling_friction: 0}
flow_rate: 1 kg/h
"""
GRID = [Pair(friction, rolling) for friction in FRICTIONS for rolling in ROLLINGS]


def case(**overrides: str) -> Case:
    return resolve(
        deepcopy(CASE), Places("x"), {key.replace("__", "."): value for key, value in overrides.items()}
    ).case


def truth(pair: Pair) -> float:
    """A surface of the fitted form, written down once more: tan α."""
    s, q = 1 - math.exp(-pair.friction / SLIDING_SCALE), 1 - math.exp(-pair.rolling / ROLLING_SCALE)
    return 0.36 + 0.18 * s + 0.40 * s * q


class Known:
    """Heaps whose slopes are known, with noise."""

    def __init__(self, noise: float, seed: int = 1) -> None:
        self.random, self.noise, self.asked = np.random.default_rng(seed), noise, list[Asked]()

    def missing(self, asked: Sequence[Asked]) -> list[Asked]:
        return list(asked)

    def particle_steps(self, asked: Sequence[Asked]) -> float:
        return 1e6

    def run(self, asked: Sequence[Asked], name: str) -> list[HeapRecord]:
        self.asked += asked
        wave = 2 * self.noise * np.array([1.0, 1, 1, -1, 1, -1])  # mean of the four that count is 0
        return [
            HeapRecord(tuple(truth(one.pair) + self.noise * self.random.normal() + wave), (1e-3,) * 6, 1000, 1, 1.0)
            for one in asked
        ]


def found_for(angle: float, noise: float = 0.01, seed: int = 1, **overrides: str) -> Found:
    heaps: Any = Known(noise, seed)
    return search(case(**overrides), angle, 0.0, heaps, None, 2, Silent())


@pytest.mark.parametrize("tan", [0.2, 0.5, 0.8])
def test_the_slope_of_a_plane_of_spheres_is_found(tan: float) -> None:
    x, y = np.meshgrid(np.arange(0.25, LENGTH, 0.5), np.arange(0.25, WIDTH, 0.5))
    place = np.stack([x.ravel(), y.ravel(), 12 - tan * x.ravel()], axis=1)
    below = place - [0, 0, 1]
    assert slope(snapshot(np.concatenate([place, below]))) == pytest.approx(tan, abs=0.01)


def test_what_lies_beyond_the_gate_or_at_its_ends_does_not_count() -> None:
    x, y = np.meshgrid(np.arange(0.25, LENGTH, 0.5), np.arange(0.25, WIDTH, 0.5))
    place = np.stack([x.ravel(), y.ravel(), 12 - 0.5 * x.ravel()], axis=1)
    strange = np.array([[0.3, 2, 30], [LENGTH - 0.3, 2, 20], [LENGTH + 1, 1, 15]])
    assert slope(snapshot(np.concatenate([place, strange]))) == pytest.approx(slope(snapshot(place)), abs=1e-12)


def test_a_heap_with_a_hole_is_refused() -> None:
    with pytest.raises(DataError, match="without particles"):
        slope(snapshot(np.array([[3.0, 1, 1]])))


def snapshot(place: Any) -> Snapshot:
    columns = ("x", "y", "z", "radius")
    return Snapshot(1, np.zeros((3, 2)), columns, np.column_stack([place, np.full(len(place), 0.5)]))


def test_no_two_spheres_of_a_loose_bed_touch_and_all_lie_between_the_walls() -> None:
    lines = [line.split() for line in make_heap(case(), Pair(0.5, 0.1), 3).bed.splitlines() if line.count(" ") == 6]
    data = np.array([[float(word) for word in line] for line in lines])
    radius, place = data[:, 2] / 2, data[:, 4:]
    apart = place[:, None] - place
    apart[..., 1] -= WIDTH * np.round(apart[..., 1] / WIDTH)
    gap = np.linalg.norm(apart, axis=2) - radius[:, None] - radius
    assert gap[~np.eye(len(gap), dtype=bool)].min() > -2e-6  # places are written to six digits
    assert (place[:, 0] > radius).all()
    assert (place[:, 0] < LENGTH - radius).all()
    assert (place[:, 2] > radius).all()


def test_the_same_sizes_in_another_unit_give_the_same_heap() -> None:
    large = case(material__size="{diameter: {normal: {mean: 6 cm, std: 6 mm, min: 5 cm, max: 7 cm}}}")
    one, other = make_heap(case(), Pair(0.5, 0.1), 1), make_heap(large, Pair(0.5, 0.1), 1)
    assert one.deck == other.deck
    assert one.bed == other.bed


def test_sizes_that_would_take_too_many_particles_are_refused() -> None:
    wide = case(material__size="{diameter: {sieve: {edges: [1 um, 2 um, 20 mm], fractions: [1 %, 99 %]}}, by: mass}")
    with pytest.raises(CaseError, match=r"material.size: a heap of these sizes holds \S+ particles"):
        make_heap(wide, Pair(0.5, 0.1), 1)


def test_the_deck_fills_with_high_friction_and_goes_on_with_that_of_the_pair() -> None:
    deck = make_heap(case(contact__restitution="0.6"), Pair(0.37, 0.07), 1).deck
    rubs = [line.split()[6:] for line in deck.splitlines() if "coefficientFriction" in line]
    assert rubs == [["2", "1", "0", "0", "0"], ["2", "0.37", "0", "0", "0"]]
    rolls = [line.split()[6:] for line in deck.splitlines() if "coefficientRollingFriction" in line]
    assert rolls == [["2", "0.5", "0", "0", "0"], ["2", "0.07", "0", "0", "0"]]
    assert "coefficientRestitution peratomtypepair 2 0.6" in deck


def test_the_fit_finds_the_surface_that_made_the_slopes() -> None:
    response = fit(GRID, [truth(pair) for pair in GRID])
    assert response.coefficients == pytest.approx([0.36, 0.18, 0.40])
    assert response.scatter == pytest.approx(0, abs=1e-12)
    assert response.reach == pytest.approx((truth(LEAST), truth(MOST)))


def test_slopes_that_do_not_grow_with_friction_are_refused() -> None:
    with pytest.raises(RunError, match="do not grow"):
        fit(GRID, [0.8 - truth(pair) for pair in GRID])


def test_the_95_percent_range_holds_the_true_pair_in_95_percent_of_searches() -> None:
    random, pair, inside = np.random.default_rng(5), Pair(0.5, 0.15), 0
    for _ in range(400):
        response = fit(GRID, [truth(one) + 0.03 * random.normal() for one in GRID])
        crossing = response.crossing(pair.friction, truth(pair))
        inside += crossing is not None and crossing.low <= pair.rolling <= crossing.high
    assert 0.91 < inside / 400 < 0.985


@pytest.mark.parametrize("pair", [Pair(0.3, 0.05), Pair(0.5, 0.1), Pair(0.73, 0.21)])
def test_a_known_pair_lies_on_the_valley_of_its_angle(pair: Pair) -> None:
    found = found_for(math.atan(truth(pair)), contact__friction=str(pair.friction))
    assert found.kept
    assert found.best.pair.friction == pair.friction
    assert found.best.low <= pair.rolling <= found.best.high
    assert found.frictions[0] <= pair.friction <= found.frictions[1]
    for crossing in found.valley:
        assert truth(crossing.pair) == pytest.approx(truth(pair), abs=0.04)


def test_the_second_heaps_lie_near_the_angle_and_the_first_are_the_same_for_all_angles() -> None:
    heaps: Any = Known(1e-6)
    found = search(case(), math.radians(32), 0.0, heaps, None, 2, Silent())
    assert [one.pair for one in found.asked[: len(GRID)]] == GRID
    near = found.asked[len(GRID) :]
    assert len(near) == NEAR
    assert [truth(one.pair) for one in near] == pytest.approx([math.tan(math.radians(32))] * NEAR, abs=2e-3)
    assert len({one.pair for one in near}) == NEAR


def test_where_the_friction_of_the_case_cannot_give_the_angle_the_nearest_is_recommended() -> None:
    found = found_for(math.radians(24), contact__friction="0.9")
    assert not found.kept
    assert found.best.pair.friction == max(one.pair.friction for one in found.valley)


def test_a_doubtful_angle_widens_the_range() -> None:
    heaps, others = Known(0.01), Known(0.01)
    sure = search(case(), math.radians(33), 0.0, heaps, None, 2, Silent())  # type: ignore[arg-type]
    doubtful = search(case(), math.radians(33), math.radians(1.5), others, None, 2, Silent())  # type: ignore[arg-type]
    assert doubtful.best.high - doubtful.best.low > 1.5 * (sure.best.high - sure.best.low)


@pytest.mark.parametrize("degrees", [21.0, 41.5])
def test_an_angle_that_no_friction_reaches_is_refused_with_what_is_reached(degrees: float) -> None:
    with pytest.raises(CaseError, match=r"outside what friction reaches: .* stand at 2\d\.\d° .* to 39\.\d°"):
        found_for(math.radians(degrees), noise=1e-4)


def test_heaps_that_the_surface_cannot_follow_mark_the_result() -> None:
    class Rough(Known):
        def run(self, asked: Sequence[Asked], name: str) -> list[HeapRecord]:
            return [
                HeapRecord(tuple(np.array(record.slopes) + 0.1 * (-1) ** number), record.motion, 1000, 1, 1.0)
                for number, record in enumerate(super().run(asked, name))
            ]

    heaps: Any = Rough(0.01)
    found = search(case(), math.radians(32), 0.0, heaps, None, 2, Silent())
    assert [gate.name for gate in found.failed] == [
        "scatter of heaps about the fitted surface, over that of the slopes of one heap"
    ]
    assert not found_for(math.radians(32)).failed


def test_a_heap_that_still_flows_marks_the_result() -> None:
    class Lively(Known):
        def run(self, asked: Sequence[Asked], name: str) -> list[HeapRecord]:
            return [replace(record, motion=(1e-3,) * 5 + (0.05,)) for record in super().run(asked, name)]

    heaps: Any = Lively(0.01)
    found = search(case(), math.radians(32), 0.0, heaps, None, 2, Silent())
    assert [gate.value for gate in found.failed] == [0.05]


def test_text_yaml_table_and_picture_tell_the_recommended_pair(tmp_path: Path) -> None:
    found = found_for(math.radians(32))
    assert f"rolling_friction {found.best.pair.rolling:.3f}" in found_text(found)
    again = resolve(deepcopy(CASE) | {"contact": {}}, Places("x"), {"contact": found_yaml(found).split("deg\n")[1]})
    assert again.case.contact.friction == found.best.pair.friction
    assert again.case.contact.rolling_friction == pytest.approx(found.best.pair.rolling, abs=5e-4)
    assert len(found_data(found)["heaps"]) == len(GRID) + NEAR
    draw(found, tmp_path / "valley.png")
    assert (tmp_path / "valley.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "answer"),
    [
        (["--angle", "60 deg"], "not one of spheres with friction"),
        (["--angle", "3 deg"], "not one of spheres with friction"),
        (["--angle", "34"], "an angle with its unit"),
        (["--angle", "34 mm"], "an angle with its unit"),
        (["--angle", "34 deg", "--error=-1 deg"], "-1° is not from 0 to 10°"),
        (["--angle", "34 deg", "--error=90 deg"], "a rougher angle tells nothing"),
        (["--angle", "34 deg", "--set", "contact.rolling_model=none"], "contact.rolling_model: is none"),
        ([], "Missing option '--angle'"),
    ],
)
def test_the_command_refuses_before_any_work(options: list[str], answer: str, tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(TEXT)
    done = CliRunner().invoke(main, ["repose", str(path), "--results", str(tmp_path / "results"), *options])
    assert done.exit_code == 2
    assert answer in done.output
    assert not (tmp_path / "results").exists()
