"""Records of DEM stages with plausible figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from granpipe.pipeline.records import OverlapRecord, SegmentRecord, SettleRecord, WallRecord

WALLS = WallRecord(40, ((-0.06, 0.06), (-0.06, 0.06)), 0.0, {"wall": 80}, 0.01)

SETTLED = SettleRecord(
    steps=1000, particles=300, inserted=300, short_insertions=0, mass_share=(1.0,), wanted_mass_share=(1.0,),
    youngs_modulus=1e6, overlap=OverlapRecord(0.001, 0.004), wall_seconds=3.0, processor_seconds=3.0, ranks=1,
)  # fmt: skip

SEGMENT = SegmentRecord(
    particles=300, inserted=0, discharged=0, discharged_mass_kg=0.0, counted_to_step=500,
    overlap=OverlapRecord(0.001, 0.004), reference_overlap=0.001,
    averaging_seconds=0.1, checking_seconds=0.1, wall_seconds=1.0, processor_seconds=1.0, ranks=1,
)  # fmt: skip


def settled(**changes: Any) -> SettleRecord:
    return replace(SETTLED, **changes)


def segment(**changes: Any) -> SegmentRecord:
    return replace(SEGMENT, **changes)
