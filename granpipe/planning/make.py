"""Case → plan. Pure: no disk, no process."""

from __future__ import annotations

from typing import Literal

from granpipe.case.schema import Case
from granpipe.errors import CaseError
from granpipe.planning.plan import Model, Plan
from granpipe.planning.planner import Planner
from granpipe.planning.space import check_model_in_space
from granpipe.planning.space_plan import space_plan
from granpipe.planning.within_error import plan_within


def make_plan(case: Case, cores: int = 1) -> Plan:
    """Decide everything. Pure: the same case and cores give the same plan on every machine.

    Parameters
    ----------
    cores : that the run may keep busy: they decide the number of ranks and the forecast, nothing else

    Raises
    ------
    CaseError : the case asks for what is impossible, or for a model that cannot be right
    """
    if case.total_error is not None:
        return plan_within(case, case.total_error, cores)
    if case.vessel is not None:
        return space_plan(case, cores)
    planner = Planner(case, cores)
    return planner.plan(planner.choose_model())


def model_plans(case: Case, cores: int = 1) -> dict[Model, Plan | CaseError]:
    """The plans of all three models, for comparison; the error of one that the scene does not allow.

    Raises
    ------
    CaseError : no model is possible
    """
    planned = Planner(case, cores).plan if case.vessel is None else lambda model: space_plan(case, cores, model)
    found: dict[Model, Plan | CaseError] = {}
    for model in ("fluid", "hybrid", "dem"):
        try:
            found[model] = planned(model)
        except CaseError as error:
            found[model] = error
    return found


def other_rheology(case: Case, cores: int = 1) -> tuple[str, Plan | CaseError]:
    """The rheology of a fluid that the case does not ask for, and the plan with it."""
    name: Literal["viscous", "frictional"] = "viscous" if case.fluid.rheology == "frictional" else "frictional"
    other = case.model_copy(update={"fluid": case.fluid.model_copy(update={"rheology": name})})
    try:
        if case.vessel is not None:
            check_model_in_space("fluid")
        return name, Planner(other, cores).plan("fluid")
    except CaseError as error:
        return name, error
