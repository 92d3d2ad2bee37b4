"""The unit in which a speed reads well."""

import pytest

from granpipe.export.pictures import readable_unit


@pytest.mark.parametrize(
    ("speed", "unit"),
    [(3.0, "m/s"), (0.05, "mm/s"), (6.7e-4, "m/h"), (6.6e-5, "mm/h"), (1e-12, "mm/h"), (0.0, "mm/h")],
)
def test_speeds_get_a_unit_in_which_they_are_at_least_one_where_there_is_one(speed: float, unit: str) -> None:
    chosen, factor = readable_unit(speed)
    assert chosen == unit
    seconds = {"s": 1, "h": 3600}[unit[-1]]
    length = {"m": 1, "mm": 1000}[unit.split("/")[0]]
    assert factor == seconds * length
