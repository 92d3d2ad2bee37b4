"""The settled bed as a pilot: is Young's modulus, chosen by a formula, stiff enough? If not, it is chosen again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from granpipe.dem import contact
from granpipe.planning.plan import Plan, choices_of, make_plan
from granpipe.progress import Progress
from granpipe.run.dem_stages import settle
from granpipe.system.jsonfile import read_json
from granpipe.system.store import Store

CHOICES_AGAIN = 2
"""How often the modulus is chosen again, at most."""

MARGIN = 1.1
"""What is put on the modulus that the measured overlap asks for."""


def piloted(plan: Plan, store: Store, tools: dict[str, str], progress: Progress) -> Plan:
    """The plan with a Young's modulus that keeps every settled bed within the limits of overlap.

    A modulus that the case gives is left alone, and so is one that the bed is content with.
    """
    if plan.parts:
        parts = tuple((span, piloted(part, store, tools, progress)) for span, part in plan.parts)
        return replace(plan, parts=parts, choices=choices_of(parts))
    if plan.settings is None or plan.case.contact.youngs_modulus != "auto":
        return plan
    for _ in range(CHOICES_AGAIN):
        mean, p99 = overlap(settle(plan, store, tools, progress))
        factor = contact.stiffening(mean, p99)
        if factor <= 1:
            return plan
        why = f"at {plan.dem.youngs_modulus:.3g} Pa the settled bed overlapped by {mean:.2%} and {p99:.2%}"
        plan = _stiffer(plan, contact.two_digits_up(MARGIN * factor * plan.dem.youngs_modulus), why)
        progress.note(f"note: youngs_modulus = {plan.dem.youngs_modulus:.3g} Pa: {why}")
    return plan


def overlap(settled: Path) -> tuple[float, float]:
    """Mean overlap of a settled bed and its 99th percentile."""
    measured = read_json(settled / "settle.json")["overlap"]
    return float(measured["mean"]), float(measured["p99"])


def _stiffer(plan: Plan, youngs: float, why: str) -> Plan:
    """The plan at another Young's modulus, which still is a choice of granpipe's."""
    settings = make_plan(plan.case.varied({"contact.youngs_modulus": repr(youngs)})).dem
    choices = tuple(
        replace(choice, criterion=f"{choice.criterion}; {why}") if choice.name == "youngs_modulus" else choice
        for choice in settings.choices
    )
    others = tuple(choice for choice in plan.choices if choice.name not in {c.name for c in choices})
    return replace(plan, settings=replace(settings, choices=choices), choices=(*choices, *others))
