"""Checks on the settled bed that Young's modulus, chosen by a formula, is stiff enough; chooses it again if not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from granpipe.case.reader import varied
from granpipe.dem import contact
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import settle
from granpipe.pipeline.records import SettleRecord
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan, decisions_of

MOST_RETRIES = 2
"""How often the modulus is chosen again, at most."""

MARGIN = 1.1
"""What is put on the modulus that the measured overlap asks for."""

FLOWING = 0.85
"""Overlap of a flowing bed over that of the settled one: once solids slide down, walls bear more of the weight.

It was 0.74 to 0.90 in five vessels, and 0.97 in the reactor, which is far from the limits (docs/validation/filling.md);
the gates go by the flowing bed itself."""


def with_checked_stiffness(plan: Plan, context: Context) -> Plan:
    """The plan with a Young's modulus that keeps every flowing bed within the limits of overlap.

    A modulus that the case gives is left alone, and so is one with which the bed stays within the limits.

    Raises
    ------
    CaseError : the stiffer settings are refused
    """
    if plan.submodels:
        submodels = tuple((span, with_checked_stiffness(submodel, context)) for span, submodel in plan.submodels)
        return replace(plan, submodels=submodels, decisions=decisions_of(submodels))
    if plan.settings is None or plan.case.contact.youngs_modulus != "auto":
        return plan
    for _ in range(MOST_RETRIES):
        mean, p99 = overlap(settle(plan, context))
        factor = contact.stiffening(FLOWING * mean, FLOWING * p99)
        if factor <= 1:
            return plan
        why = f"at {plan.dem.youngs_modulus:.3g} Pa the settled bed overlapped by {mean:.2%} and {p99:.2%}"
        plan = _stiffer(plan, contact.two_digits_up(MARGIN * factor * plan.dem.youngs_modulus), why)
        stiffer = f"youngs_modulus = {plan.dem.youngs_modulus:.3g} Pa"
        context.progress.note(f"note: the vessel is filled again, with {stiffer}: {why}")
    return plan


def overlap(settled: Path) -> tuple[float, float]:
    """Mean overlap of a settled bed and its 99th percentile."""
    measured = SettleRecord.read(settled).overlap
    return measured.mean, measured.p99


def _stiffer(plan: Plan, youngs: float, why: str) -> Plan:
    """The plan at another Young's modulus, which still is a decision of granpipe's, on as many ranks."""
    settings = make_plan(varied(plan.case, {"contact.youngs_modulus": repr(youngs)})).dem
    decisions = tuple(
        replace(decision, criterion=f"{decision.criterion}; {why}") if decision.name == "youngs_modulus" else decision
        for decision in settings.decisions
    )
    others = tuple(decision for decision in plan.decisions if decision.name not in {c.name for c in decisions})
    return replace(
        plan, settings=replace(settings, ranks=plan.dem.ranks, decisions=decisions), decisions=(*decisions, *others)
    )
