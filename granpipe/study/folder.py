"""Where a study lies. This module imports little, so that one may often ask how a study stands."""

from __future__ import annotations

from pathlib import Path

from granpipe.case.reader import load_case
from granpipe.case.schema import Case
from granpipe.errors import CaseError
from granpipe.sweep.folder import Folder, find_folder
from granpipe.sweep.variants import MAX_NAME

_ENDING = "-study"


def study_name(case: Case) -> str:
    """Name of the folder of a case's study."""
    return case.name[: MAX_NAME - len(_ENDING)] + _ENDING


def folder_of(path: Path, results: Path) -> Folder:
    """The folder of a sweep or study, by itself or by a sweep.yaml.

    Raises
    ------
    CaseError : no such file, or a case; the message names the folder of the case's study
    DataError : a folder without a sweep
    """
    from granpipe.sweep.file import is_case

    if path.is_file() and is_case(path):
        folder = results / study_name(load_case(path))
        found = f"give the folder of its study, {folder}" if folder.is_dir() else f"it has no study in {results}"
        raise CaseError(f"is a case, not a sweep; {found}", place=str(path))
    return find_folder(path, results)
