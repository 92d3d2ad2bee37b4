"""The flow rate that a case asks for, and what its openings let through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.filling import PACKING
from granpipe.dem.plate import BEVERLOO_SHARE, MOST_BEVERLOO
from granpipe.dem.sizes import size_classes
from granpipe.dem.vessel import Opening, free_flow
from granpipe.errors import CaseError
from granpipe.geometry.edges import Side
from granpipe.geometry.openings import Opening as VesselOpening
from granpipe.geometry.outline import Outline


def target_flow(case: Case, packing: float) -> float:
    """Bulk flow [m³/s] that the case asks for; a mass flow becomes bulk of this packing."""
    rate = case.flow_rate
    if rate.volume is not None:
        return rate.volume
    assert rate.mass is not None  # the case gives one of the two
    return rate.mass / (case.material.density * packing)


@dataclass(frozen=True)
class FreeFlow:
    """Free discharge [m³/s of bulk] through one opening, or all that lie beside each other at its level."""

    name: str
    bulk: float


def check_flow_rate(
    case: Case, outline: Outline, openings: Sequence[Opening], packing: float | None = None
) -> tuple[str, ...]:
    """What the user should keep in mind of the flow rate that the process asks for, against free discharge.

    Parameters
    ----------
    openings : of the vessel, and what else the solids must pass
    packing : packing fraction of the bulk, where it is known better than by the case

    Raises
    ------
    CaseError : more is asked for than falls freely through an opening
    """
    particle = size_classes(case.material.size).mean_diameter
    least = min((free_discharge(outline, opening, particle) for opening in openings), key=lambda one: one.bulk)
    return against_free_flow(case, least, packing)


def against_free_flow(case: Case, least: FreeFlow, packing: float | None = None) -> tuple[str, ...]:
    """The same, where it is known which free discharge is the least.

    Raises
    ------
    CaseError : more is asked for than that
    """
    flow = target_flow(case, packing or case.material.packing or PACKING)
    if least.bulk == 0:
        return ()  # too narrow for the particles: refused as an opening
    share = flow / least.bulk
    amount = f"{flow:.3g} m³/s of bulk"
    if share > 1:
        mass = least.bulk * case.material.density * (packing or case.material.packing or PACKING)
        raise CaseError(
            f"{case.flow_rate}; {amount} is {share:.3g} times the free discharge through the {least.name}, about "
            f"{least.bulk:.3g} m³/s or {mass:.3g} kg/s (Beverloo); ask for less, or widen the opening",
            ("flow_rate",),
        )
    if share <= BEVERLOO_SHARE:
        return ()
    return (
        f"flow_rate: {amount} is {share:.0%} of the free discharge through the {least.name} ({least.bulk:.3g} m³/s "
        f"after Beverloo): above {BEVERLOO_SHARE:.0%} inertia changes the flow pattern, and the field does not show it",
    )


def free_discharge(outline: Outline, opening: Opening, particle: float) -> FreeFlow:
    """Free discharge through an opening that all solids pass, or through the vessel's section at its level."""
    if opening.required:
        return FreeFlow(opening.name, free_flow(opening, particle) * _cone_factor(outline, opening))
    sides: tuple[Side, ...] = ("above", "below")  # of the level at which an obstacle may begin or end
    cuts = [[_interval(outline, opening, r0, r1) for r0, r1 in outline.intervals(opening.z, side)] for side in sides]
    least = min(sum(free_flow(one, particle) for one in cut) for cut in cuts)
    return FreeFlow(f"openings at the level of the {opening.name}", least)


def _interval(outline: Outline, opening: Opening, r0: float, r1: float) -> VesselOpening:
    axial = outline.measure.axial
    round_axis = axial and r0 == 0
    gap = 2 * r1 if round_axis else r1 - r0
    area = float(outline.measure.area(np.array(r0), np.array(r1)))
    length = None if round_axis else math.pi * (r0 + r1) if axial else outline.measure.turn
    walled = outline.measure.walled
    return VesselOpening(opening.name, opening.z, r0, r1, gap, area, False, opening.key, length, walled)


def _cone_factor(outline: Outline, opening: Opening) -> float:
    """How much more falls through an opening below a cone than through one in a flat bottom.

    (tan α)^−0.35 of the half-angle α below 45°, at most `MOST_BEVERLOO`. Source: Rose & Tanaka (1959) in the form of
    Nedderman (1992), with a stagnant zone at 45°. For slots there is no such law: 1, which is on the safe side.
    """
    narrowing = [angle for z, angle in outline.narrowing if z >= opening.z - outline.tolerance]
    if opening.length is not None or not narrowing:
        return 1.0
    return float(max(1.0, min(MOST_BEVERLOO, math.tan(narrowing[-1]) ** -0.35)))
