"""`total_error`: the cheapest model whose error is within it, by vessels of the same kind."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.dem.sizes import size_classes
from granpipe.errors import CaseError
from granpipe.fluid.friction_error import ExpectedError, Rheology, expected_error
from granpipe.planning.plan import Plan, Stage
from granpipe.planning.plane import check_model_between_walls
from granpipe.planning.planner import Planner
from granpipe.planning.scene import scene_of

RHEOLOGIES: tuple[Rheology, ...] = ("viscous", "frictional")
"""From the cheapest on."""

FEWEST_DIAMETERS = 8.0
"""Openings below this many particle diameters mark a frictional fluid: they flow in jerks."""

TOTAL_ERROR, STATISTICAL_ERROR = ("total_error",), ("dem", "statistical_error")
BY_STUDY = "make a study of the case and run it with --total-error"
BY_PARTICLES = f"give model: dem with dem.statistical_error, or {BY_STUDY}"


def plan_within(case: Case, error: float, cores: int) -> Plan:
    """The cheapest model whose error is at most that which the case asks for, by vessels of the same kind.

    Raises
    ------
    CaseError : no model is known to be within it
    """
    check_model_between_walls(case, "auto")
    if case.vessel is not None:
        raise CaseError(f"of vessels in space no error is known; {BY_PARTICLES}", TOTAL_ERROR)
    scene = scene_of(case, Planner(case, cores).outline)
    left: list[Stage] = []
    known = False
    for rheology in RHEOLOGIES if case.fluid.rheology == "viscous" else ("frictional",):
        expected = expected_error(rheology, scene)
        if isinstance(expected, ExpectedError):
            known = True
            plan = _fluid_within(case, rheology, expected, error, cores)
            if isinstance(plan, Plan):
                chosen = f"{rheology} fluid, the cheapest within total_error {error:.3g}: {expected.text()}"
                return _with_choice(plan, chosen, left)
            left.append(Stage(f"{rheology} fluid", plan))
        else:
            left.append(Stage(f"{rheology} fluid", expected))
    fluids = "; ".join(f"{one.name}: {one.reason}" for one in left)
    if not known:
        raise CaseError(f"no error is known to choose a model by ({fluids}); {BY_PARTICLES}", TOTAL_ERROR)
    if case.dem.coarse_grain_factor > 1:
        raise CaseError(
            f"no fluid is within it ({fluids}), and of enlarged particles no error is known: leave "
            f"dem.coarse_grain_factor out, or {BY_STUDY}",
            TOTAL_ERROR,
        )
    if case.homogenize.method == "gaussian":
        raise CaseError(
            f"no fluid is within total_error ({fluids}), and only method: psi tells the error of particles",
            ("homogenize", "method"),
        )
    if (case.dem.statistical_error or error) > error:
        raise CaseError(f"no fluid is within total_error ({fluids}), and this is beyond it", STATISTICAL_ERROR)
    target = case.dem.statistical_error or error
    dem = case.dem.model_copy(update={"statistical_error": target})
    plan = Planner(case.model_copy(update={"dem": dem}), cores).plan("dem")
    chosen = f"particles of the material's own size, until their statistical error is {target:.3g}: no fluid is within"
    return _with_choice(plan, f"{chosen} total_error {error:.3g}", left)


def _fluid_within(case: Case, rheology: Rheology, expected: ExpectedError, error: float, cores: int) -> Plan | str:
    """The plan of a fluid, or why it is not taken."""
    if expected.worst > error:
        return f"{expected.text()}: beyond total_error {error:.3g}"
    try:
        plan = Planner(varied(case, {"fluid.rheology": rheology}), cores).plan("fluid")
    except CaseError as problem:
        return f"not possible: {problem}"
    narrow = min(plan.openings, key=lambda opening: opening.gap)
    diameters = narrow.gap / size_classes(case.material.size).sauter_diameter
    if rheology == "frictional" and diameters < FEWEST_DIAMETERS * (1 - 1e-9):
        return f"would be marked: {narrow.name} of {diameters:.3g} d; it flows in jerks below {FEWEST_DIAMETERS:g}"
    return f"would be marked: {'; '.join(plan.breaches)}" if plan.breaches else plan


def _with_choice(plan: Plan, chosen: str, left: Iterable[Stage]) -> Plan:
    """The plan with why its model was taken, and no other."""
    hybrid = Stage("hybrid", "no error of hybrids is known from vessels of the same kind")
    return replace(plan, stages=(Stage("model", chosen), *plan.stages), left_out=(*left, hybrid, *plan.left_out))
