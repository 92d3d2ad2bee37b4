"""The time of production, by numbers that follow by hand from the rules that the module states."""

from __future__ import annotations

import pytest

from granpipe.dem.duration import dumps_per_segment, duration, start_pays


@pytest.mark.parametrize(
    ("filled", "error", "least", "expected", "time", "room"),
    [
        (1.0, None, 1.2, 0.0, 1.2, 9.6),  # six diameters of 0.1 m in a section of twice the outlet's area
        (10.0, None, 2.5, 0.0, 2.5, 20.0),  # a quarter of a content of 10 m over the outlet
        (1.0, 0.05, 1.2, 1.6, 3.2, 9.6),  # twice (0.1/0.05)² diameters there, and as much again in reserve
        (1.0, 0.01, 1.2, 40.0, 80.0, 153.6),  # the room is doubled until the time fits in
    ],
)
def test_the_time_is_that_of_the_travel_the_content_or_the_error(
    filled: float, error: float | None, least: float, expected: float, time: float, room: float
) -> None:
    found = duration(None, error, speed=1.0, ratio=2.0, filled=filled, diameter=0.1)
    assert (found.least, found.expected) == (pytest.approx(least), pytest.approx(expected))
    assert (found.time, found.room) == (pytest.approx(time), pytest.approx(room))
    slow = duration(None, error, speed=0.1, ratio=2.0, filled=filled, diameter=0.1)
    assert slow.time == pytest.approx(10 * time)


def test_a_given_time_is_kept_and_warned_about_below_nine_tenths_of_what_is_needed() -> None:
    assert duration(1.1, None, 1.0, 2.0, 1.0, 0.1).warning == ""
    assert "try 1.2 s" in duration(1.07, None, 1.0, 2.0, 1.0, 0.1).warning


def test_segments_are_one_interval_or_as_many_as_keep_them_within_1024() -> None:
    assert dumps_per_segment(102.4, 0.1) == 1
    assert dumps_per_segment(102.6, 0.1) == 2


def test_a_faster_start_takes_its_travel_off_the_least_one_and_the_room_holds_it() -> None:
    """Twelve diameters of a tenth of a metre are the least: 0.4 m of them, and a tenth of one that is not averaged."""
    found = duration(None, 0.05, speed=1.0, ratio=2.0, filled=1.0, diameter=0.1, start=0.4)
    assert found.start_travel == pytest.approx(0.4 + 0.01)
    assert found.least == pytest.approx(0.8)
    assert found.expected == pytest.approx(1.4 * 4 * 0.1 * 2)  # (0.1/0.05)² diameters in a section of twice the area
    assert (found.room, found.longest) == (pytest.approx(9.6), pytest.approx(9.6 - 0.41))
    assert duration(9.5, None, 1.0, 2.0, 1.0, 0.1, start=0.4).room == pytest.approx(2 * 9.6)
    assert duration(9.5, None, 1.0, 2.0, 1.0, 0.1).room == pytest.approx(9.6)


@pytest.mark.parametrize(
    ("start", "ratio", "pays"), [(0.11, 2, True), (0.09, 2, False), (2.7, 100, False), (3, 100, True)]
)
def test_a_start_of_less_than_a_diameter_or_six_segments_does_not_pay(start: float, ratio: float, pays: bool) -> None:
    """Six diameters in a section of a hundred times the outlet's area are 60 m, their room 480 m in 1024 segments."""
    length = duration(None, None, speed=1.0, ratio=ratio, filled=1.0, diameter=0.1, start=start)
    assert start_pays(length, 1.0, 0.1) == pays
