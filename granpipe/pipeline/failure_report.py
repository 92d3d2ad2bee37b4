"""What is kept of a run without a field: report, pictures, level flows, logs. There is no ``field.npz`` in it.

It stands beside the results folder, so that nothing takes it for results and an earlier field stays as it is.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.errors import DataError
from granpipe.export.run_report import write_failure_report
from granpipe.homogenize.assemble import raw_field
from granpipe.homogenize.average import merge
from granpipe.homogenize.conserve import Plug
from granpipe.pipeline.averages import plug_range
from granpipe.pipeline.failure import Story
from granpipe.pipeline.results import made_now, plan_summary, write_logs
from granpipe.planning.plan import Plan
from granpipe.system.jsonfile import write_json
from granpipe.system.manifest import MANIFEST, has_manifest
from granpipe.system.publish import renewing

_ENDING = ".failed"  # no case is called so: names hold no dots


def failure_folder(results: Path) -> Path:
    """The folder of a failed run, beside the results folder of its case."""
    return results.with_name(results.name + _ENDING)


def write_failure(
    results: Path, plan: Plan, story: Story, provenance: Mapping[str, Any], note: Callable[[str], None]
) -> Path:
    """Write what a run without a field tells; return its folder.

    Parameters
    ----------
    results : results folder of the case, which is left alone
    plan : of the case; `story` may be that of a sub-model
    note : is told which files were kept aside because somebody had changed them
    """
    folder = failure_folder(results)
    with renewing(folder, note) as aside:
        (aside / "case.yaml").write_text(plan.case.to_yaml())
        write_json(aside / "plan.json", plan_summary(plan))
        write_json(
            aside / "failure.json",
            {"case": plan.case.name, "run": story.plan.case.name, **made_now(), **provenance, "reason": story.reason}
            | {"cause": story.cause, "text": story.text},
        )
        (aside / "figures").mkdir()
        _levels(aside, story)
        _raw_average(aside, story)
        write_logs(aside, story.productions)
        write_failure_report(aside)
    return folder


def withdraw(folder: Path, note: Callable[[str], None]) -> None:
    """Remove what was written of a failed run, once the case has a field; what others put there stays."""
    if not has_manifest(folder):
        return
    with renewing(folder, note):
        pass
    (folder / MANIFEST).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        folder.rmdir()


def _levels(folder: Path, story: Story) -> None:
    from granpipe.export.level_flow import level_flow_figure, level_flow_table

    levels, path = story.levels, folder / "figures" / "level_flow.png"
    level_flow_table(levels.z, levels.whole, levels.late, folder / "level_flow.csv")
    level_flow_figure(levels.z, levels.whole, levels.late, f"{story.plan.case.name}: failed", path)


def _raw_average(folder: Path, story: Story) -> None:
    """The plain average on r–z, stamped; none of a vessel in space, or where it cannot be drawn."""
    from granpipe.export.pictures import DPI, RED, overview

    plan, outline = story.plan, story.plan.simulated
    if plan.space is not None:
        return
    sums = merge([one for production in story.productions for one in production.sums()])
    inside = outline.inside_fraction(sums.grid)
    full = sums.mean_volume / np.where(inside > 0, inside * sums.grid.cell_volume, np.inf)
    packing = float(np.median(full[full > 0.5 * np.quantile(full, 0.9)])) if full.any() else 0.0
    if not packing > 0:
        return
    plug = Plug(packing, story.levels.flow, 0.0, plug_range(outline, sums.grid))
    try:
        field = replace(raw_field(sums, inside, plug, plan.dem.classes.sauter_diameter), psi=None)
        obstacles = {name: polygon.tolist() for name, polygon in outline.obstacles.items()}
        title = f"{plan.case.name}: plain average, at the scale of the simulation"
        levels = plan.case.outline.levels
        figure = overview(field, outline.wall.tolist(), obstacles, levels, title, outline.left_wall)
    except DataError:
        return
    stamp: dict[str, Any] = {
        "color": RED,
        "alpha": 0.5,
        "fontsize": 30,
        "rotation": 60,
        "ha": "center",
        "va": "center",
        "zorder": 10,
    }
    figure.text(0.5, 0.5, "FAILED: no field", **stamp)
    path = folder / "figures" / "raw_average.png"
    figure.savefig(path, dpi=DPI)
