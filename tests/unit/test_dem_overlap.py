"""Overlap of a bed, against pairs whose overlap is known."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.dem.overlap import measure_overlap


def test_the_overlap_of_a_chain_is_that_of_its_links() -> None:
    rng = np.random.default_rng(1)
    radius = rng.uniform(0.5, 1.5, 400)
    shares = rng.uniform(-0.05, 0.05, 399)  # gaps count for nothing
    steps = (radius[1:] + radius[:-1]) * (1 - shares)
    position = np.zeros((400, 3))
    position[1:, 2] = np.cumsum(steps)
    order = rng.permutation(400)
    found = measure_overlap(position[order], radius[order])
    touching = shares[shares > 0]
    assert found.contacts == len(touching)
    assert found.mean == pytest.approx(touching.mean())
    assert found.p99 == pytest.approx(np.quantile(touching, 0.99))


def test_a_bed_without_contacts_has_no_overlap() -> None:
    apart = measure_overlap(np.array([[0.0, 0, 0], [3, 0, 0]]), np.ones(2))
    assert (apart.mean, apart.p99, apart.contacts) == (0, 0, 0)
    assert measure_overlap(np.empty((0, 3)), np.empty(0)).contacts == 0
