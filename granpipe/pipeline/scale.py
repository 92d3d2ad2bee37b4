"""`granpipe scale`: one simulation scales to other flow rates as long as inertia is negligible."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from granpipe.case.material import MOST_PACKING
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Field
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.pipeline.exports import write_exports
from granpipe.planning.flow import check_flow_rate, target_flow
from granpipe.system.manifest import verify
from granpipe.system.publish import publishing_new


def scale_results(source: Path, case: Case, target: Path) -> str:
    """Write the exports of a results folder for the flow rate of `case`; return a warning, or nothing.

    `case` is that of the results but for the flow rate. Granular flow is driven by gravity and keeps its pattern while
    inertia is small (Sparta & Halvorsen 2017), so that every velocity scales with the flow.

    Raises
    ------
    RunError : `target` exists
    DataError : the results are damaged, or do not know the packing of the bulk, so that they tell no mass flow
    CaseError : the flow rate is above the free discharge through an opening
    """
    verify(source, "field.npz", "case.yaml")
    field = Field.load(source / "field.npz")
    packing = field.bulk_packing
    if packing > MOST_PACKING:
        raise DataError(
            f"{source / 'field.npz'}: packing fraction {packing:.3g} of the bulk; run the case again with "
            "material.bulk_density"
        )
    outline = Outline.from_case(case)
    notes = check_flow_rate(case, outline, find_openings(outline), packing)
    scaled = replace(field, flow_scale=target_flow(case, packing) / field.bulk_flow)
    with publishing_new(target) as folder:
        (folder / "case.yaml").write_text(case.to_yaml())
        scaled.save(folder / "field.npz")
        write_exports(scaled, case, folder)
    return "; ".join(notes)
