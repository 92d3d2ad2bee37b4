"""Averaging dumps that exist already: between the times asked for, with and without a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fakes.analytic_flow import ConvergingFlow, write_dumps

from granpipe.case import Case, Outline, Section, load_case
from granpipe.errors import DataError
from granpipe.field import level_flow
from granpipe.raw import Request, homogenize_files

FLOW = ConvergingFlow(solids_flow=0.01, packing=0.58)
RADII = np.full(1, 0.02)


@pytest.fixture(scope="module")
def dumps(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """Eight snapshots, 0.2 s and 1000 steps apart, of a known converging flow."""
    return tuple(write_dumps(tmp_path_factory.mktemp("dumps"), FLOW, RADII, 0.2, 8))


def request(dumps: tuple[Path, ...], **times: float) -> Request:
    return Request(dumps=dumps, cell=0.02, time_step=2e-4, **times)


def vessel(method: str) -> Case:
    """The case of the known flow: its wall as a polygon, its flow rate as bulk."""
    reactor = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml", {"flow_rate": "1 m^3/h"})
    z = np.linspace(FLOW.height, 0, 60)
    wall = tuple(zip(FLOW.wall(z)[0].tolist(), z.tolist(), strict=True))
    outline = Outline(wall=wall, sections={"all": Section(z=(FLOW.height, 0.0))})
    homogenize = reactor.homogenize.model_copy(update={"method": method})
    return reactor.model_copy(update={"outline": outline, "homogenize": homogenize})


def test_without_a_case_the_plain_average_of_the_chosen_times_is_given(dumps: tuple[Path, ...]) -> None:
    field = homogenize_files(request(dumps), None)
    inside = np.abs(level_flow(field.flux_z, field.grid)[10:40])
    np.testing.assert_allclose(inside, FLOW.solids_flow, rtol=0.25)
    assert field.psi is None
    late = homogenize_files(request(dumps, start=1.0), None)
    assert not np.array_equal(late.flux_z, field.flux_z)


@pytest.mark.parametrize("method", ["paper", "psi"])
def test_with_a_case_the_field_conserves_by_its_method(dumps: tuple[Path, ...], method: str) -> None:
    field = homogenize_files(request(dumps), vessel(method))
    flow = level_flow(field.flux_z, field.grid)
    np.testing.assert_allclose(flow, flow[0], rtol=1e-10)
    assert field.bulk_packing == pytest.approx(FLOW.packing, rel=0.1)
    assert flow[0] * field.velocity_scale == pytest.approx(1 / 3600)


def test_times_without_a_snapshot_are_named(dumps: tuple[Path, ...]) -> None:
    with pytest.raises(DataError, match=r"run from 0 to 1\.4 s; none lies between --start 20 s"):
        homogenize_files(request(dumps, start=20.0), None)
