"""What is read from LIGGGHTS' output, and what it may use."""

from __future__ import annotations

import math

import pytest

from granpipe.dem.run import Limits, Status


def read(*lines: str) -> tuple[Status, list[bool]]:
    status = Status()
    return status, [status.read(line) for line in lines]


def test_insertions_come_before_the_row_that_counts_their_particles() -> None:
    status, rows = read(
        "       0        0              0              0 ",
        "INFO: Particle insertion feed: inserted 41 particle templates (mass 3.434808e-01) at step 1",
        " - a total of 41 particle templates (mass 3.434808e-01) inserted so far.",
        "INFO: Particle insertion fill1: inserted 61 particle templates (mass 5.110324e-01) at step 1",
        "     178      102     0.10835056    0.017513833 ",
    )
    assert rows == [True, False, False, False, True]
    assert (status.step, status.particles, status.inserted) == (178, 102, 102)
    assert status.kinetic_energy == pytest.approx(0.10835056)


def test_what_was_discharged_before_a_restart_is_not_counted_again() -> None:
    status, _ = read("    3300      736      1.0214159              0            948      12.480000              0 ")
    assert status.discharged == 0
    status.read("    3410      692      0.5660083             45            992      13.060000     0.11115522 ")
    assert (status.discharged, status.discharged_mass) == (44, pytest.approx(0.58))


@pytest.mark.parametrize(
    "line",
    [
        "    Step    Atoms         KinEng            CPU ",
        "Nlocal:    183 ave 183 max 183 min",
        "Histogram: 1 0 0 0 0 0 0 0 0 0",
        "178 102 nonsense 3",
        "1 by 1 by 1 MPI processor grid",
        "",
    ],
)
def test_other_lines_are_no_rows(line: str) -> None:
    status, rows = read(line)
    assert rows == [False]
    assert status == Status()


def test_an_energy_that_is_no_number_is_seen_as_such() -> None:
    status, rows = read("     178      102     -nan    0.017513833 ")
    assert rows == [True]
    assert math.isnan(status.kinetic_energy)


def test_limits_grow_with_the_run_and_never_fall_below_what_a_small_one_needs() -> None:
    small, large = Limits.of(100, 1, 1000, 1e-3), Limits.of(10**7, 8, 10**8, 60.0)
    assert small.silence >= 60
    assert large.silence > 60 * 10
    for name in ("file_bytes", "output_bytes", "memory_bytes"):
        assert getattr(large, name) > getattr(small, name) > 10_000_000
