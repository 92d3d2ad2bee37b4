"""Titles of the cuts through a field in space."""

import numpy as np
import pytest

from granpipe.export.space_pictures import _middle


@pytest.mark.parametrize(("edges", "told"), [([-0.0015, 0.0015 - 4e-19], "0"), ([0.075, 0.078], "0.0765")])
def test_a_cut_is_named_by_the_middle_of_its_cells_without_rounding_errors(edges: list[float], told: str) -> None:
    assert f"{_middle(np.array(edges), 0):.3g}" == told
