"""Which points are in Slurm's queue: what was submitted (``slurm/jobs.json``), beside what `squeue` says."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from granpipe.sweep import slurm
from granpipe.sweep.folder import Folder
from granpipe.sweep.slurm import Element
from granpipe.system.files import write_whole
from granpipe.system.jsonfile import read_json


@dataclass(frozen=True)
class Job:
    """A job that was submitted.

    Parameters
    ----------
    job : its id
    points : names of the points of each element of the array; empty for the job that makes the table
    """

    job: str
    points: list[list[str]]


@dataclass(frozen=True)
class Jobs:
    """What ``slurm/jobs.json`` holds."""

    jobs: list[Job]


def queued(folder: Folder) -> dict[str, Element]:
    """Points that are in Slurm's queue, waiting or running, with the element of the array that has them.

    Raises
    ------
    RunError : Slurm does not answer
    """
    lines = {job.job: job.points for job in jobs_of(folder)}
    found: dict[str, Element] = {}
    for element in _elements(folder):
        job, _, index = element.job.partition("_")
        if index.isdigit() and 0 < int(index) <= len(lines[job]):
            found |= dict.fromkeys(lines[job][int(index) - 1], element)
    return found


def queued_jobs(folder: Folder) -> set[str]:
    """Ids of the jobs that are in the queue, that which makes the table included.

    Raises
    ------
    RunError : Slurm does not answer
    """
    return {element.job.partition("_")[0] for element in _elements(folder)}


def _elements(folder: Folder) -> list[Element]:
    """What of this sweep is in the queue; nothing where there is no Slurm: results may be looked at elsewhere."""
    jobs = {job.job for job in jobs_of(folder)}
    return [one for one in slurm.queue() if one.job.partition("_")[0] in jobs] if jobs and slurm.is_here() else []


def jobs_of(folder: Folder) -> list[Job]:
    """The jobs that were submitted.

    Raises
    ------
    DataError : the record of the jobs is damaged
    """
    file = folder.root / "slurm" / "jobs.json"
    if not file.exists():
        return []
    remedy = "cancel the jobs of this sweep that `squeue --me` shows, and delete the file"
    return read_json(file, Jobs, remedy).jobs


def write_jobs(folder: Folder, jobs: list[Job]) -> None:
    """Note what was submitted."""
    write_whole(folder.root / "slurm" / "jobs.json", json.dumps(asdict(Jobs(jobs))))
