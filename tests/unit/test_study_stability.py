"""The truth test of the stability suite on beds made by hand, and what its rows cover."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from stability.rows import Judged, Row, Truth, flow_truth, rest_truth, rows, subset
from stability.suite import changes_of, scene

from granpipe.case.reader import varied
from granpipe.errors import CaseError
from granpipe.planning.make import make_plan

RADIUS = 0.01
SPAN = (-0.05, 0.05)


@dataclass(frozen=True)
class Bed:
    """Spheres with nothing but what the truth test looks at."""

    id: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray


def bed(spacing: float = 2 * RADIUS) -> Bed:
    """A cubic lattice that fills a pipe of 6 cm radius beyond the span."""
    x = np.arange(-0.06, 0.06, spacing) + spacing / 2
    z = np.arange(-0.1, 0.1, spacing)
    place = np.stack(np.meshgrid(x, x, z), axis=-1).reshape(-1, 3)
    n = len(place)
    return Bed(np.arange(1, n + 1), place, np.zeros((n, 3)), np.full(n, RADIUS))


def truth(*beds: Bed) -> Truth:
    return rest_truth(beds, 9.81, SPAN, 0.06)


def test_a_bed_at_rest_is_stable_and_its_packing_that_of_the_lattice() -> None:
    found = truth(bed(), bed())
    assert found.faults == ()
    inside = np.hypot(*bed().position[:, :2].T)
    layer = len(inside) / 10  # ten layers of 2 cm
    assert found.packing == pytest.approx(layer * 4 / 3 * RADIUS**3 / (0.06**2 * 0.02))


def test_a_bed_in_which_all_jitter_is_not_at_rest_and_one_that_rattles_is_nothing() -> None:
    still = bed()
    jitter = replace(still, velocity=np.full_like(still.velocity, 0.01))
    (fault,) = truth(jitter, jitter).faults
    assert "no rest" in fault
    one = still.velocity.copy()
    one[5] = 1.0
    assert truth(still, replace(still, velocity=one)).faults == ()


def test_lost_particles_are_missed_by_their_numbers() -> None:
    still = bed()
    fewer = Bed(still.id[3:], still.position[3:], still.velocity[3:], still.radius[3:])
    assert truth(still, still).lost == 0
    assert truth(still, fewer).faults == ("3 particles lost",)
    none = Bed(still.id[:0], still.position[:0], still.velocity[:0], still.radius[:0])
    assert truth(none, none).faults
    assert truth(still, none).lost == len(still.id)


def test_a_bed_that_sinks_or_is_squeezed_is_not_stable() -> None:
    still = bed()
    lower = replace(still, position=still.position - [0, 0, 0.05 * RADIUS])
    assert any("sinks" in fault for fault in truth(still, lower).faults)
    assert any("squeezed" in fault for fault in truth(bed(0.016), bed(0.016)).faults)


def flowing(speed: float, jitter: float = 0.0) -> tuple[list[float], list[Bed]]:
    still, times = bed(), list(np.linspace(0, 1, 40))
    rng = np.random.default_rng(1)
    beds = [
        replace(
            still,
            position=still.position - [0, 0, speed * t],
            velocity=rng.normal(size=still.velocity.shape) * (1 + jitter * t),
        )
        for t in times
    ]
    return times, beds


def test_a_bed_that_follows_the_plate_is_stable_and_one_that_lags_or_heats_up_is_not() -> None:
    assert flow_truth(*flowing(0.03), 0.03, -0.1, 0.05).following == pytest.approx(1)
    assert flow_truth(*flowing(0.03), 0.03, -0.1, 0.05).faults == ()
    assert "0.50 of the plate" in flow_truth(*flowing(0.015), 0.03, -0.1, 0.05).faults[0]
    assert "grows" in flow_truth(*flowing(0.03, jitter=9), 0.03, -0.1, 0.05).faults[0]


def test_small_ones_that_trickle_through_the_pores_hardly_count() -> None:
    times, beds = flowing(0.03)
    dust = replace(beds[0], id=beds[0].id + 10_000, radius=np.full(len(beds[0].id), RADIUS / 10))
    rng = np.random.default_rng(2)
    mixed = [
        Bed(
            np.concatenate([bed.id, dust.id]),
            np.concatenate([bed.position, dust.position - [0, 0, 0.15 * t]]),
            np.concatenate([bed.velocity, 5 * rng.normal(size=bed.velocity.shape)]),
            np.concatenate([bed.radius, dust.radius]),
        )
        for t, bed in zip(times, beds, strict=True)
    ]
    assert flow_truth(times, mixed, 0.03, -0.1, 0.05).following == pytest.approx(1, abs=0.01)


STABLE, LOST = Truth(), Truth(lost=1)


@pytest.mark.parametrize(
    ("verdict", "rest", "chosen", "wrong"),
    [
        ("done", STABLE, True, ""),
        ("done", LOST, False, "missed"),
        ("flagged", LOST, False, ""),
        ("stopped", LOST, False, ""),
        ("stopped", STABLE, False, "false alarm"),
        ("stopped", LOST, True, "granpipe's own settings are not stable"),
        ("refused", STABLE, True, ""),
    ],
)
def test_what_counts_as_wrong(verdict: str, rest: Truth, chosen: bool, wrong: str) -> None:
    changes = {} if chosen else {"dem.time_step": "1e-4"}
    assert Judged(Row("x", 1, changes=changes), verdict, "", rest, Truth()).wrong == wrong  # type: ignore[arg-type]


def test_rows_have_names_of_their_own() -> None:
    names = [row.name for row in rows()]
    assert len(set(names)) == len(names)
    assert 1 < len(subset(rows())) < 10


def test_granpipes_own_choices_are_inside_the_range_in_every_row() -> None:
    refused = 0
    for row in filter(lambda row: row.chosen, rows()):
        case = scene(row)
        try:
            assert make_plan(varied(case, changes_of(row, case))).breaches == (), row.name
        except CaseError:
            refused += 1
    assert refused == 5  # three narrow columns, a hopper that closes, and what never comes to rest


def test_similar_rows_keep_every_group() -> None:
    groups = set()
    for row in (row for row in rows() if row.similar):
        case = scene(row)
        dem = make_plan(varied(case, changes_of(row, case))).dem
        length = dem.classes.mean_diameter
        groups.add(
            (
                round(dem.time_step / dem.rayleigh_time, 6),
                round(dem.plate_speed**2 / (9.81 * length), 6),
                round(dem.feed_top / length, 6),
                round(dem.youngs_modulus / (varied(case, changes_of(row, case)).material.density * 9.81 * length), 1),
            )
        )
    assert len(groups) == 1
