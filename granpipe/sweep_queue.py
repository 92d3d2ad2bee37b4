"""Which points are in Slurm's queue: what was submitted (``slurm/jobs.json``), beside what `squeue` says."""

from __future__ import annotations

import json
from typing import Any

from granpipe.jsonfile import read_json
from granpipe.study import slurm
from granpipe.study.slurm import Element
from granpipe.sweep import Folder, replace_text


def queued(folder: Folder) -> dict[str, Element]:
    """Points that are in Slurm's queue, waiting or running, with the element of the array that has them."""
    jobs = jobs_of(folder)
    if not jobs or not slurm.is_here():  # results may be looked at elsewhere
        return {}
    lines = {str(job["job"]): job["points"] for job in jobs}
    found: dict[str, Element] = {}
    for element in slurm.queue():
        job, _, index = element.job.partition("_")
        if job in lines and index.isdigit():
            found |= dict.fromkeys(lines[job][int(index) - 1], element)
    return found


def jobs_of(folder: Folder) -> list[dict[str, Any]]:
    """The array jobs that were submitted: `job`, and the `points` of each element."""
    file = folder.root / "slurm" / "jobs.json"
    return list(read_json(file)["jobs"]) if file.exists() else []


def write_jobs(folder: Folder, jobs: list[dict[str, Any]]) -> None:
    """Note what was submitted."""
    replace_text(folder.root / "slurm" / "jobs.json", json.dumps({"jobs": jobs}))
