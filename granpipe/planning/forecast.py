"""Forecasts of the wall time of a plan."""

from __future__ import annotations

from granpipe.planning.cost import assumed_rate
from granpipe.planning.plan import Plan
from granpipe.system.rates import Rates


def forecast(plan: Plan, rates: Rates | None, busy: int = 1) -> float:
    """Wall time of a plan [s], at the rates of this machine where they are known.

    Parameters
    ----------
    busy : cores that runs keep busy at that time, this plan's among them: they take from each other's speed
    """
    if rates is None:
        return plan.seconds
    if plan.settings is not None:
        ranks = plan.settings.ranks
        return plan.seconds * assumed_rate(ranks) / min(rates.of(ranks), ranks * rates.of(busy) / busy)
    particles = sum(submodel.seconds for _, submodel in plan.submodels)
    return plan.seconds - particles + sum(forecast(submodel, rates, busy) for _, submodel in plan.submodels)
