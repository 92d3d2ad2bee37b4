"""`granpipe run --total-error`: the cheapest settings that a study rates within ERROR, and no longer than needed.

A study of the same scene, the user's own or one that is part of granpipe, gives error and time as measured. For any
other scene the settings of granpipe's studies are scaled to it, and their error is only a guess. The run itself ends
when its noise, with the systematic error that the study tells, makes the total that was asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path
from typing import Any

from granpipe.case.reader import CaseFile, resolve, varied
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.dem.contact import filling_angle
from granpipe.errors import CaseError
from granpipe.geometry.openings import find_openings
from granpipe.pipeline.gates import BLOCKS
from granpipe.pipeline.provenance import Provenance
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.study.budget import PLAIN, Option, advise, estimate, percent, sure_factor, worst_fillings
from granpipe.study.folder import study_name
from granpipe.study.reference import scene
from granpipe.study.report import FormerStudy, read_study

SHIPPED = Path(__file__).parents[1] / "templates" / "studies"
"""Studies that are part of granpipe, as their ``study.json``; made by ``benchmarks/study.py``."""

_SETTLED = (
    ("contact", "youngs_modulus"),
    ("dem", "coarse_grain_factor"),
    ("dem", "mass_scaling"),
    ("dem", "walls"),
    ("dem", "plate_speed"),
    ("dem", "start_speed"),
    ("dem", "reservoir_height"),
    ("dem", "replicas"),
    ("homogenize", "cell"),
    ("homogenize", "start"),
    ("homogenize", "method"),
)
"""What the study had settled for the case; the option's own changes come on top.

The start of the average is among them: where the study found it from its data, the run does, and where it was given,
what was left of the transient is in the errors as the study measured them.
"""


@dataclass(frozen=True)
class Recommendation:
    """What will be run, and what to expect.

    Parameters
    ----------
    tolerance : total error that was asked for
    changes : of the case
    study : where the option is from
    proven : the option's 95 % bound is within the tolerance, not only its estimate
    guessed : the study is one of another scene
    fill_angles : angle below edges up to which the study's vessels were filled, and up to which they would be now [°]
    unknown : axes of which the study could not tell what they add to the error
    """

    file: CaseFile
    option: Option
    tolerance: float
    changes: Mapping[str, str]
    study: str
    proven: bool
    fill_angles: tuple[float, float]
    unknown: tuple[str, ...]
    guessed: bool

    @property
    def expected(self) -> str:
        """For the user, before the run."""
        settings = ", ".join(f"{key} = {value}" for key, value in self.changes.items())
        marks = map("marked: {}".format, (*self._filling, *self._marks))
        return "\n".join([self._forecast, f"settings: {settings}", *self._end, *marks])

    @property
    def _end(self) -> tuple[str, ...]:
        """When the run ends; told where it is not after a fixed time."""
        if (noise := self.file.case.dem.statistical_error) is None:
            return ()
        rest = self.option.systematic["whole"]
        part, word = (rest.upper, "at most ") if self.proven else (rest.value, "")
        return (
            f"ends when the statistical error is {percent(noise)} in every section, which with {word}{percent(part)} "
            f"of systematic error makes a total of {percent(self.tolerance)}",
        )

    @property
    def _filling(self) -> tuple[str, ...]:
        """Where the study filled its vessels in another way, which shows below edges."""
        then, now = self.fill_angles
        if math.isclose(then, now, abs_tol=0.1):
            return ()
        return (
            f"the study filled vessels up to {then:.0f}° below edges, granpipe would now up to {now:.0f}°; the error "
            "of sections with a free surface may differ",
        )

    @property
    def _forecast(self) -> str:
        error, option = self.option.error(), self.option
        which = f"point {option.point}, method {option.method}, {self.study}"
        size = f"{percent(error.value)}, at most {percent(error.upper)}"
        if self.guessed:
            return (
                f"no study of this scene; as {which}, scaled to this scene: there the error was {size}; here that "
                "is a guess, which granpipe study would test"
            )
        sure = "" if self.proven else " (its 95 % bound is above the tolerance)"
        sure += f" (not counting {', '.join(self.unknown)}, which the study did not vary)" if self.unknown else ""
        what = "of the finite elements, not of the fluid as a model" if math.isinf(option.blocks) else "of error"
        cores = "one core" if option.cores == 1 else f"{option.cores} cores"
        return f"{which}: expecting {size} {what}{sure}, in {option.seconds:.3g} s on {cores} of the study's machine"

    @property
    def _marks(self) -> tuple[str, ...]:
        """Settings outside granpipe's rules, for which the run will be marked; the study has tested them."""
        return make_plan(self.file.case).breaches

    def obtained(self, folder: Path) -> str:
        """For the user, after the run.

        Raises
        ------
        DataError : the results folder is damaged
        """
        provenance = Provenance.read(folder)
        took = f"took {provenance.wall_seconds:.0f} s"
        numbers = dict(provenance.numbers)
        noise, blocks = (numbers.get(name) for name in ("statistical_error.whole", "effective_blocks"))
        if noise is None:
            return f"{took}; this method gives no statistical error"
        rest = self.option.systematic["whole"]
        source = "guessed from another scene" if self.guessed else "from the study"
        most = "" if blocks is None else f", at most {hypot(noise * sure_factor(blocks), rest.upper):.1%}"
        return (
            f"{took}; error {hypot(noise, rest.value):.1%}{most}: {noise:.1%} statistical as measured now, "
            f"{rest.value:.1%} {source}"
        )


def recommend(file: CaseFile, results: Path, tolerance: float) -> Recommendation:
    """The cheapest option within the tolerance, from a study of this scene or else of another one.

    Raises
    ------
    CaseError : no study has such an option, or the study in the results folder is of another scene
    """
    if file.case.total_error is not None:
        raise CaseError("given in the case and as --total-error: leave one of them out", ("total_error",))
    own = results / study_name(file.case) / "study.json"
    if own.is_file() and scene(read_study(own).case) != scene(file.case):
        message = f"{own.parent} is a study of another vessel or material; run granpipe study again, or move it away"
        raise CaseError(message, place="--total-error")
    for study in (own, *shipped()):
        if study.is_file() and scene((former := read_study(study)).case) == scene(file.case):
            best = _best(former.options, tolerance, study, lambda one: _allowed(file.case, former.case, one))
            where = f"of the study in {study.parent}" if study == own else f"of granpipe's study of {study.stem}"
            return _recommendation(file.case, former, where, tolerance, best, _settings(former.case, best[0]))
    return _guess(file.case, tolerance, own)


def _recommendation(
    case: Case,
    former: FormerStudy,
    where: str,
    tolerance: float,
    best: tuple[Option, bool],
    settings: dict[str, str],
    *,
    guessed: bool = False,
) -> Recommendation:
    """The case with the settings of an option, ending at the tolerance."""
    option, proven = best
    changes = settings | _ending(option, tolerance, proven)
    file = _changed(case, changes)
    law = former.case.contact
    angles = former.fill_angle, math.degrees(filling_angle(law.friction, law.rolling_friction))
    return Recommendation(file, option, tolerance, changes, where, proven, angles, former.unknown, guessed)


def shipped() -> Iterator[Path]:
    """The studies that are part of granpipe."""
    return iter(sorted(SHIPPED.glob("*.json")))


def _best(
    options: list[Option], tolerance: float, study: Path, allowed: Callable[[Option], bool]
) -> tuple[Option, bool]:
    """The cheapest option within the tolerance that a run would not refuse, and whether its bound is within it.

    A run goes on until it has as many blocks as its gate wants: an option of fewer takes longer than the study says.
    """
    options = [_until_done(option) for option in options]
    while (advice := advise(options, tolerance)).option is not None and not allowed(advice.option):
        options.remove(advice.option)
    if advice.option is None:
        fields = [option for option in options if option.method != PLAIN]
        errors = list(map(estimate(), worst_fillings(fields, estimate())))
        best = f"; the best has {percent(min(errors))}" if errors else ""
        message = (
            f"no option of {study} that this case allows is within {percent(tolerance)}{best}; a study with a smaller "
            "dem.coarse_grain_factor, a slower dem.plate_speed or longer runs may find one"
        )
        raise CaseError(message, place="--total-error")
    return advice.option, advice.proven


def _until_done(option: Option) -> Option:
    """The option with the time of a run, which ends with enough blocks; filling takes no longer then, so it is less."""
    if _ends_after_a_time(option):
        return option
    return replace(option, seconds=option.seconds * max(1.0, BLOCKS.low / option.blocks))


def _ends_after_a_time(option: Option) -> bool:
    """Whether a run of the option has no noise that could end it."""
    return math.isinf(option.blocks) or option.changes.get("homogenize.method") == "gaussian"


def _allowed(case: Case, studied: Case, option: Option) -> bool:
    """Whether a run with the settings of an option would not be refused."""
    try:
        make_plan(_changed(case, _settings(studied, option)).case)
    except CaseError:
        return False
    return True


def _plain(case: Case) -> dict[str, Any]:
    return case.model_dump(mode="json", exclude_none=True)


def _settings(case: Case, option: Option) -> dict[str, str]:
    """The study's settings and the option's."""
    studied = _plain(case)
    changes = {f"{group}.{key}": str(studied[group][key]) for group, key in _SETTLED}
    changes |= {"model": studied["model"]} | dict(option.changes)
    changes.pop("dem.seed", None)  # any filling will do
    return changes


def _ending(option: Option, tolerance: float, proven: bool) -> dict[str, str]:
    """What ends the run when noise and systematic error make the tolerance; nothing where the noise is not known.

    Both are independent, so the noise may be √(tolerance² − systematic²); of a proven option as 95 % bounds, for which
    the run has the least number of blocks that its gate lets pass.
    """
    if _ends_after_a_time(option):
        return {}
    rest = option.systematic["whole"]
    room = math.sqrt(tolerance**2 - (rest.upper if proven else rest.value) ** 2)
    noise = room / sure_factor(BLOCKS.low) if proven else room
    return {"dem.statistical_error": f"{noise:.4g}", "dem.max_time": "auto"}


def _changed(case: Case, changes: dict[str, str]) -> CaseFile:
    """The case with changes; its own target does not end the run."""
    given = case.model_dump(mode="json", exclude_unset=True)
    given.get("dem", {}).pop("statistical_error", None)
    return resolve(given, Places(case.name), changes)


def _guess(case: Case, tolerance: float, own: Path) -> Recommendation:
    """An option of granpipe's first study, its settings scaled to this scene."""
    particles = varied(case, {"model": "dem"})
    for study in shipped():
        former = read_study(study)
        options = [option for option in former.options if option.method == "psi" and option.travel > 0]
        best = _best(options, tolerance, study, lambda _: True)  # its time is this vessel's own
        model = varied(former.case, best[0].changes)
        settings = carried_over(make_plan(model), particles) | {"dem.replicas": str(model.dem.replicas)}
        where = f"of granpipe's study of {study.stem}"
        return _recommendation(case, former, where, tolerance, best, settings, guessed=True)
    raise CaseError(f"file not found: {own}; make it with granpipe study", place="--total-error")


def carried_over(model: Plan, case: Case) -> dict[str, str]:
    """What gives a case the settings of another scene's run in its own measures.

    These are the narrowest opening over d90, but never particles smaller than the material's, walls set back where they
    may be, and the plate speed over the automatic one.

    Raises
    ------
    CaseError : the changed case is refused
    """
    own = {
        "dem.coarse_grain_factor": "1",
        "dem.walls": "as_drawn",
        "dem.plate_speed": "auto",
        "dem.start_speed": "auto",
        "dem.max_time": "auto",
        "homogenize.start": "auto",
    }
    fine = make_plan(varied(case, own))
    changes = {
        "model": "dem",
        "homogenize.method": "psi",
        "homogenize.start": "auto",
        "dem.mass_scaling": model.case.dem.mass_scaling,
        "dem.walls": "as_drawn" if model.set_back is None else "auto",
        "dem.coarse_grain_factor": f"{max(1.0, _narrowness(fine) / _narrowness(model)):.4g}",
        "dem.plate_speed": "auto",
        "dem.start_speed": "auto",
        "dem.max_time": "auto",
    }
    plan = make_plan(varied(case, changes))
    if not plan.dem.open_outlet:
        pace = model.dem.plate_speed / make_plan(varied(model.case, {"dem.plate_speed": "auto"})).dem.plate_speed
        changes["dem.plate_speed"] = f"{pace * plan.dem.plate_speed:.4g}"
    return changes


def _narrowness(plan: Plan) -> float:
    """Width of the narrowest opening over d90."""
    return min(opening.gap for opening in find_openings(plan.outline) if opening.required) / plan.dem.classes.d90
