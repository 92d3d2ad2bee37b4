"""A bed with mass scaling on the real LIGGGHTS: as heavy as without, in fewer steps."""

from __future__ import annotations

from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import settle
from granpipe.pipeline.records import SettleRecord
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

pytestmark = pytest.mark.liggghts

SIZES = "{diameter: {sieve: {edges: [8 mm, 11 mm, 14 mm], fractions: [40 %, 60 %]}}, by: mass}"


def test_a_bed_with_mass_scaling_overlaps_as_one_without(tiny: Path, tmp_path: Path) -> None:
    """Overlap tells the weight on the contacts: it goes with its power 2/3, so 4 % of it is 6 % of the weight."""
    versions = library_versions() | program_versions(tmp_path / "programs.json")
    context = Context(Store(tmp_path / "store"), versions, Silent(), cores=1)
    beds = {}
    for way in ("auto", "none"):
        plan = make_plan(load_case(tiny, {"material.size": SIZES, "dem.mass_scaling": way}))
        beds[way] = SettleRecord.read(settle(plan, context)), plan.dem.classes.mass_factor
    (scaled, factor), (plain, one) = beds["auto"], beds["none"]
    assert factor > 1.1 * one  # (1 / 1.1)^(2/3) is 0.94: unscaled gravity would be seen
    assert scaled.overlap.mean == pytest.approx(plain.overlap.mean, rel=0.04)
    assert scaled.mass_share == pytest.approx(plain.mass_share, rel=0.05)
    assert scaled.particles == pytest.approx(plain.particles, rel=0.03)
