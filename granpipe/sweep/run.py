"""`granpipe sweep run`: the points that are missing, on this machine or as jobs of a cluster."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from granpipe.progress import Progress
from granpipe.sweep.file import read_profile
from granpipe.sweep.folder import Folder
from granpipe.sweep.jobs import submit
from granpipe.sweep.local import run_here
from granpipe.sweep.points import Point
from granpipe.system.cores import usable_cores


def run_missing(
    folder: Folder, points: Sequence[Point], cores: int | None, cluster: Path | None, progress: Progress
) -> bool:
    """Run points here, or submit them as Slurm jobs; whether they have been run when this returns.

    Parameters
    ----------
    cores : to keep busy here, all that there are unless given
    cluster : what each job requests; None: here

    Raises
    ------
    CaseError : the profile of the cluster is wrong, or a point asks for more ranks than there are cores
    RunError : another process runs the sweep, or Slurm refuses it
    """
    if cluster is None:
        run_here(folder, points, cores or usable_cores(), progress)
        return True
    submit(folder, points, read_profile(cluster), progress)
    return False
