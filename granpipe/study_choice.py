"""`granpipe run --total-error`: the cheapest setting that a study of the same scene has found good enough."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

from granpipe.case import Case, CaseFile, resolve
from granpipe.errors import CaseError
from granpipe.jsonfile import read_json
from granpipe.study.budget import PLAIN, Option, advise, percent
from granpipe.study_report import read_options
from granpipe.study_sweep import study_name
from granpipe.yamlfile import Places

_SETTLED = (
    ("contact", "youngs_modulus"),
    ("dem", "coarse_grain_factor"),
    ("dem", "plate_speed"),
    ("dem", "reservoir_height"),
    ("dem", "replicas"),
    ("homogenize", "cell"),
    ("homogenize", "start"),
    ("homogenize", "method"),
)
"""What the study had settled for the case; the option's own changes come on top."""


@dataclass(frozen=True)
class Chosen:
    """What will be run, and what to expect; not `proven` where only the estimate is within the tolerance."""

    file: CaseFile
    option: Option
    proven: bool

    @property
    def expected(self) -> str:
        """For the user, before the run."""
        error, option = self.option.error(), self.option
        sure = "" if self.proven else " (the study could not prove it)"
        return (
            f"point {option.point} of the study, method {option.method}: expecting {percent(error.value)} of error, "
            f"at most {percent(error.upper)}{sure}, in {option.seconds:.0f} s on {option.cores} cores of the machine "
            "that made the study"
        )

    def obtained(self, folder: Path) -> str:
        """For the user, after the run."""
        provenance = read_json(folder / "provenance.json")
        took = f"{provenance['wall_seconds']:.0f} s"
        noise = provenance["figures"].get("statistical_error", {}).get("whole")
        if noise is None:
            return f"took {took}; this method does not tell its statistical error"
        rest = self.option.systematic["whole"]
        return (
            f"took {took}; error {hypot(noise, rest.value):.1%}: {noise:.1%} statistical as measured now, "
            f"{rest.value:.1%} from the study"
        )


def choose(file: CaseFile, results: Path, tolerance: float) -> Chosen:
    """The cheapest option of the case's study that is good enough; CaseError where there is none."""
    folder = results / study_name(file.case)
    if not (folder / "study.json").is_file():
        raise CaseError(f"{folder} holds no study of this case; make one with granpipe study", place="--total-error")
    studied = read_json(folder / "study.json")["case"]
    if _scene(studied) != _scene(file.case.model_dump(mode="json", exclude_none=True)):
        message = f"{folder} is a study of another vessel or material; run granpipe study again"
        raise CaseError(message, place="--total-error")
    options = read_options(folder)
    advice = advise(options, tolerance)
    if advice.option is None:
        best = min(option.error().value for option in options if option.method != PLAIN)
        message = f"no option of {folder} is within {tolerance:.2g}; the best has {best:.2g}"
        raise CaseError(message, place="--total-error")
    return Chosen(_with(file.case, studied, advice.option), advice.option, advice.proven)


def _scene(case: Mapping[str, Any]) -> dict[str, Any]:
    """What flows, and where: all that no numerical setting changes, nor the flow rate, with which velocities scale."""
    contact = {key: value for key, value in case["contact"].items() if key != "youngs_modulus"}
    return {"outline": case["outline"], "material": case["material"], "contact": contact}


def _with(case: Case, studied: Mapping[str, Any], option: Option) -> CaseFile:
    """The case with the study's settings and the option's; its own target does not end the run."""
    given = case.model_dump(mode="json", exclude_unset=True)
    given.get("dem", {}).pop("statistical_error", None)
    changes = {f"{group}.{key}": str(studied[group][key]) for group, key in _SETTLED}
    changes |= {"model": studied["model"]} | dict(option.changes)
    changes.pop("dem.seed", None)  # any filling will do
    return resolve(given, Places(case.name), changes)
