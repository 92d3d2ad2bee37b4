"""`granpipe repose`: the search with its store, and the folder of what it has found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granpipe.case.reader import CaseFile
from granpipe.errors import CaseError
from granpipe.progress import Progress
from granpipe.repose.heaps import Heaps
from granpipe.repose.report import draw, found_data, found_text, found_yaml
from granpipe.repose.search import Found, check, search
from granpipe.system.cores import usable_cores
from granpipe.system.jsonfile import write_json
from granpipe.system.locks import locked
from granpipe.system.publish import lock_file, renewing
from granpipe.system.rates import known_rates
from granpipe.system.store import Store
from granpipe.system.surroundings import require_memory
from granpipe.system.versions import program_versions

FOLDER = "repose"
"""Below the results folder; a case's own folder lies in it."""


@dataclass(frozen=True)
class Calibration:
    """What a search has found, in words and as YAML, and the folder with the table and the picture."""

    found: Found
    folder: Path

    @property
    def text(self) -> str:
        """For the terminal."""
        return found_text(self.found)

    @property
    def yaml(self) -> str:
        """To paste into the case."""
        return found_yaml(self.found)


def calibrate_friction(
    file: CaseFile, angle: float, angle_error: float, results: Path, cores: int | None, progress: Progress
) -> Calibration:
    """Find the friction pairs that give an angle of repose; heaps that are in the store are not run again.

    Parameters
    ----------
    angle, angle_error : measured, and its standard error [rad]

    Raises
    ------
    CaseError : no friction gives this angle
    RunError : LIGGGHTS failed
    """
    try:
        check(file.case, angle)
        require_memory()
        store, cores = Store(results / ".store"), cores or usable_cores()
        folder = results / FOLDER / file.case.name
        busy = f"another granpipe is writing {folder}; wait for it, or stop it"
        folder.parent.mkdir(parents=True, exist_ok=True)
        with store.in_use(), locked(lock_file(folder), lambda _: busy):
            liggghts = program_versions(store.root / "programs.json")["liggghts"]
            heaps = Heaps(file.case, store, liggghts, cores, progress)
            found = search(file.case, angle, angle_error, heaps, known_rates(), cores, progress)
            with renewing(folder, progress.note) as aside:
                write_json(aside / "repose.json", found_data(found))
                (aside / "contact.yaml").write_text(found_yaml(found), encoding="utf-8")
                draw(found, aside / "repose.png")
    except CaseError as error:
        raise error if error.place else file.places.explain(error) from None
    return Calibration(found, folder)
