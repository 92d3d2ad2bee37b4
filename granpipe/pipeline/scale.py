"""`granpipe scale`: one simulation scales to other flow rates as long as inertia is negligible."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from granpipe import __version__
from granpipe.case.material import LEAST_PACKING, MOST_PACKING
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Field
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.pipeline.exports import write_exports, write_space_exports
from granpipe.pipeline.field_vessel import check_case
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.provenance import verified_gates
from granpipe.planning.flow import check_flow_rate, target_flow
from granpipe.planning.space import check_space_flow, space_vessel
from granpipe.system.jsonfile import write_json
from granpipe.system.manifest import verify
from granpipe.system.publish import publishing_new


class Scaled(NamedTuple):
    """What to keep in mind of scaled results: of the flow rate, and gates that the run has failed."""

    notes: tuple[str, ...]
    failed: tuple[Gate, ...]


def scale_results(source: Path, case: Case, target: Path) -> Scaled:
    """Write the exports of a results folder for the flow rate of `case`; its quality gates go with them.

    `case` is that of the results but for the flow rate. Granular flow is driven by gravity and keeps its pattern while
    inertia is small (Sparta & Halvorsen 2017), so that every velocity scales with the flow.

    Raises
    ------
    RunError : `target` exists
    DataError
        the results are damaged, of another vessel than their case, without downward flow, or do not know the packing of
        the bulk, so that they tell no mass flow
    CaseError : the flow rate is above the free discharge through an opening
    """
    verify(source, "field.npz", "case.yaml")
    gates = verified_gates(source)
    field = Field.load(source / "field.npz")
    packing = field.bulk_packing
    if not LEAST_PACKING <= packing <= MOST_PACKING:
        raise DataError(
            f"{source / 'field.npz'}: packing fraction {packing:.3g} of the bulk; run the case again with "
            "material.bulk_density"
        )
    if not field.bulk_flow > 0:
        raise DataError(
            f"{source / 'field.npz'}: a flow of {field.bulk_flow:g} m³/s cannot be scaled; one downwards can, above 0"
        )
    check_case(field, case, source / "field.npz")
    if case.vessel is None:
        outline = Outline.from_case(case)
        notes = check_flow_rate(case, outline, find_openings(outline), packing)
    else:
        notes = check_space_flow(case, space_vessel(case), packing)
    scaled = replace(field, flow_scale=target_flow(case, packing) / field.bulk_flow)
    with publishing_new(target) as folder:
        (folder / "case.yaml").write_text(case.to_yaml())
        scaled.save(folder / "field.npz")
        (write_exports if case.vessel is None else write_space_exports)(scaled, case, folder)
        provenance = {
            "made": datetime.now().astimezone().isoformat(timespec="seconds"),
            "granpipe": __version__,
            "case": case.name,
            "scaled_from": str(source.resolve()),
            "figures": {},
            "quality": [gate.as_dict() for gate in gates],
            "notes": notes,
        }
        write_json(folder / "provenance.json", provenance)
    return Scaled(notes, tuple(gate for gate in gates if not gate.passed))
