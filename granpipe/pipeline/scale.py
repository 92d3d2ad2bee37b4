"""`granpipe scale`: one solve serves every flow rate, as long as inertia does not show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from granpipe.case.schema import Case
from granpipe.dem.settings import BEVERLOO_SHARE, free_flow
from granpipe.dem.sizes import size_classes
from granpipe.errors import RunError
from granpipe.field import Field
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.pipeline.results import write_exports
from granpipe.planning.flow import target_flow
from granpipe.system.store import publishing


def scale_results(source: Path, case: Case, target: Path) -> str:
    """Write the exports of a results folder for the flow rate of `case`; return a warning, or nothing.

    `case` is that of the results but for the flow rate. Granular flow is driven by gravity and keeps its pattern while
    inertia is small (Sparta & Halvorsen 2017), so that every velocity scales with the flow.
    """
    if target.exists():
        raise RunError(f"{target} exists already; choose another --out")
    field = Field.load(source / "field.npz")
    wanted = target_flow(case, field.bulk_packing)
    scaled = replace(field, flow_scale=wanted / field.bulk_flow)
    with publishing(target) as folder:
        (folder / "case.yaml").write_text(case.to_yaml())
        scaled.save(folder / "field.npz")
        write_exports(scaled, case, folder)
    return _warning(case, wanted)


def _warning(case: Case, flow: float) -> str:
    openings = [opening for opening in find_openings(Outline.from_case(case)) if opening.required]
    particle = size_classes(case.material.size).mean_diameter
    narrowest = min(openings, key=lambda opening: free_flow(opening, particle))
    free = free_flow(narrowest, particle)
    if flow <= BEVERLOO_SHARE * free:
        return ""
    return (
        f"{flow:.3g} m³/s is more than {BEVERLOO_SHARE:.0%} of the free discharge at the {narrowest.name} "
        f"({free:.3g} m³/s after Beverloo): inertia changes the pattern, and the scaled field does not show it"
    )
