"""Overlap correction: packings of soft particles converted to those of rigid ones.

Particles far softer than the material overlap under the bed's weight, so more of them fit into the vessel. A bed whose
neighbouring centres lie closer by the mean relative overlap δ than those of touching spheres is denser by (1 − δ)⁻³,
an affine compression (O'Hern, Silbert, Liu & Nagel 2003, Phys. Rev. E 68, 011306, for packings just above jamming).
The volume that two spheres share, a lens, is of second order in δ, a thousandth and less: counting it once would
hardly correct anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.overlap import Overlap, measure_overlap
from granpipe.dem.snapshot import Snapshot
from granpipe.field import Grid
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Sums
from granpipe.pipeline.averages import reference_range
from granpipe.pipeline.records import SegmentRecord

_VOLUMES = ("volume", "flow_r", "flow_z", "gain", "level_flow", "solids")
_EXTRA_SCALED = ("class_volume", "wall_force", "stress", "stress_mass", "stress_support", "stress_motion")
# the bed's weight goes with its packing, and so do the forces


def reference_overlap(snapshot: Snapshot, case: Case, outline: Outline, grid: Grid) -> Overlap:
    """Overlap of the particles where the reference packing is measured."""
    low, high = reference_range(case, outline, grid)
    z = snapshot.position[:, 2]
    there = (z > low) & (z < high)
    return measure_overlap(snapshot.position[there], snapshot.radius[there])


def rigid_share(overlap: float) -> float:
    """Packing of a bed of rigid particles over that of one with a mean relative overlap δ: (1 − δ)³."""
    return (1 - overlap) ** 3


def mean_reference_overlap(reports: Sequence[Sequence[SegmentRecord]]) -> float:
    """Mean overlap δ where the reference packing is taken, over the segments of all replicas."""
    return float(np.mean([report.reference_overlap for replica in reports for report in replica]))


def as_rigid(segments: Sequence[Sums], overlap: float) -> list[Sums]:
    """Segments with solids volumes, flows and wall forces as in a bed of rigid particles at the same velocities.

    Velocities, F/φ, stay; the packing is that of the material, and with it ρ_ref = ρ_s φ_ref.
    """
    share = rigid_share(overlap)
    return [
        replace(
            sums,
            **{name: share * getattr(sums, name) for name in _VOLUMES},
            extra={name: share * value if name in _EXTRA_SCALED else value for name, value in sums.extra.items()},
        )
        for sums in segments
    ]
