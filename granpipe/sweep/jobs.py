"""The points of a sweep on a cluster: array jobs, one for each number of ranks, and a job that makes the table.

What was submitted is written to ``slurm/jobs.json``; which points are still to run is what Slurm's queue says of those
jobs. No accounting and no database are needed, and scripts and lists of points can be read and edited.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from granpipe.errors import RunError
from granpipe.progress import Progress, counted
from granpipe.sweep import slurm
from granpipe.sweep.file import Profile
from granpipe.sweep.folder import Folder
from granpipe.sweep.local import CHUNK
from granpipe.sweep.points import Point
from granpipe.sweep.queue import Job, jobs_of, queued, queued_jobs, write_jobs

_LEAST = 5
"""Points without particles that a job takes at least: starting takes about as long as these."""

_ELEMENTS = 40
"""Jobs among which points without particles are shared, before they take as many as a worker may."""


def submit(folder: Folder, points: Sequence[Point], profile: Profile, progress: Progress) -> list[str]:
    """Submit the points that are not in the queue already, and a job that makes the table; the ids of the jobs.

    Raises
    ------
    RunError : Slurm does not take the jobs
    """
    most = slurm.largest_array()
    slurm.plain_path(folder.root)
    with folder.started():
        waiting = queued(folder)
        fresh = [point for point in points if point.name not in waiting]
        if not fresh:
            progress.note(f"nothing to submit: {counted(len(waiting), 'point')} in the queue, all others are done")
            return []
        scripts = _next_folder(folder)
        jobs = []
        for ranks in sorted({_ranks(point, profile) for point in fresh}):
            lines = _lines([point for point in fresh if _ranks(point, profile) == ranks], most)
            job = _submit_points(folder, scripts, lines, ranks, profile)
            jobs.append(Job(job, [line.split() for line in lines]))
            points_told = counted(sum(len(line.split()) for line in lines), "point")
            progress.note(f"job {job}: {points_told} in {counted(len(lines), 'element')}")
            write_jobs(folder, [*jobs_of(folder), jobs[-1]])
        active = sorted({element.job.split("_")[0] for element in waiting.values()} | {job.job for job in jobs})
        path = _write(scripts / "table.sh", "table.sh.j2", folder, profile, {})
        table = slurm.submit(path, f"--dependency=afterany:{':'.join(active)}")
        write_jobs(folder, [Job(table, []), *jobs_of(folder)])
        progress.note(f"job {table}: writes the table and chart when the others have ended")
        return [*(job.job for job in jobs), table]


def cancel(folder: Folder) -> str:
    """Cancel the jobs of a sweep that are in the queue, or end the process that runs it here; what was done.

    Raises
    ------
    RunError : Slurm does not answer
    """
    if jobs := sorted(queued_jobs(folder)):
        slurm.cancel(jobs)
        return f"cancelled jobs {', '.join(jobs)}"
    return _end_here(folder)


def _end_here(folder: Folder) -> str:
    owner = folder.owner()
    if owner is None:
        return f"nothing to cancel: {folder.root} is not running"
    if not owner.pid:
        raise RunError(f"{folder.root} is starting at this moment; try again")
    if owner.host != socket.gethostname():
        raise RunError(f"{owner} runs {folder.root}: cancel it there")
    try:
        os.kill(owner.pid, signal.SIGTERM)
    except ProcessLookupError:
        return f"nothing to cancel: {owner} has just ended"
    except PermissionError:
        raise RunError(f"{owner} runs {folder.root} for another user: only they can cancel it") from None
    return f"told process {owner.pid} to end"


def _ranks(point: Point, profile: Profile) -> int:
    return (point.ranks or profile.ranks) if point.particles else 1


def _lines(points: Sequence[Point], most: int) -> list[str]:
    """The points of each element: one with particles, several without, and more where they would be above `most`."""
    slow = [point.name for point in points if point.particles]
    quick = [point.name for point in points if not point.particles]
    lines = _split(slow, 1) + _split(quick, min(CHUNK, max(_LEAST, -(-len(quick) // _ELEMENTS))))
    return lines if len(lines) <= most else _split(slow + quick, -(-len(points) // most))


def _split(names: list[str], size: int) -> list[str]:
    return [" ".join(names[at : at + size]) for at in range(0, len(names), size)]


def _submit_points(folder: Folder, scripts: Path, lines: list[str], ranks: int, profile: Profile) -> str:
    list_file = scripts / f"points-{ranks}.txt"
    list_file.write_text("\n".join(lines) + "\n")
    values = {
        "points": slurm.plain_path(list_file),
        "elements": len(lines),
        "ranks": ranks,
        "time": _slurm_time(profile.time),
        "margin": round(profile.margin),
    }
    return slurm.submit(_write(scripts / f"points-{ranks}.sh", "points.sh.j2", folder, profile, values))


def _write(path: Path, template: str, folder: Folder, profile: Profile, values: dict[str, Any]) -> Path:
    common = {
        "name": folder.name,
        "profile": profile,
        "python": slurm.plain_path(Path(sys.executable)),
        "folder": slurm.plain_path(folder.root),
        "logs": slurm.plain_path(path.parent),
        "start": slurm.plain_path(Path.cwd()),
    }
    path.write_text(slurm.script(template, common | values))
    return path


def _slurm_time(seconds: float) -> int:
    """In whole minutes, as sbatch takes it."""
    return -(-round(seconds) // 60)


def _next_folder(folder: Folder) -> Path:
    root = folder.root / "slurm"
    root.mkdir(exist_ok=True)
    number = 1 + max((int(path.name) for path in root.iterdir() if path.name.isdigit()), default=0)
    path = root / str(number)
    path.mkdir()
    return path
