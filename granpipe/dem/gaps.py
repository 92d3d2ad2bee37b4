"""How wide openings must be for the particles."""

from __future__ import annotations

import math

from granpipe.dem.decision import Decision
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.vessel import Opening
from granpipe.errors import CaseError

LEAST_GAP = 5.0
"""Width of an opening over d90, at least: narrower ones may arch, and wall layers are all that there is."""

LEAST_COARSE_GAP = 3.0
"""The same of particles that stand for smaller ones: such a run is marked, but it tells what coarseness costs."""

_ROUNDING = 1e-9


def check_gap(opening: Opening, classes: SizeClasses, coarse_grain_factor: float) -> Decision:
    """One rule for every opening: at least `LEAST_GAP` of the material's own particles fit side by side.

    Larger particles that stand for them are the case's decision; from `LEAST_COARSE_GAP` on they are marked.

    Raises
    ------
    CaseError : the opening is too narrow for the particles, or none passes it
    """
    ratio = opening.gap / classes.d90
    smallest = 2 * classes.smallest / coarse_grain_factor
    if opening.gap < smallest:
        raise CaseError(
            f"the {opening.name} is {opening.gap:.4g} m wide: no particle passes it, the smallest is {smallest:.4g} m; "
            f"{_closed(opening)}",
            key=opening.key,
        )
    least = LEAST_GAP if coarse_grain_factor == 1 or ratio * coarse_grain_factor < LEAST_GAP else LEAST_COARSE_GAP
    if ratio < least * (1 - _ROUNDING):
        coarser = ", a smaller dem.coarse_grain_factor" if coarse_grain_factor > 1 else ""
        raise CaseError(
            f"the {opening.name} is {opening.gap:.4g} m wide, only {ratio:.3g} times the particles' d90 of "
            f"{classes.d90:.4g} m; it must be at least {least:g} times: use smaller particles{coarser} or a wider "
            "opening" + ("" if opening.required else f"; {_closed(opening)}"),
            key=opening.key,
        )
    breach = f"below {LEAST_GAP:g} by dem.coarse_grain_factor" if ratio < LEAST_GAP else ""
    warning = "" if ratio >= 10 or breach else f"{ratio:.2g} is below 10: expect wall layers and arching to show"
    return Decision(f"gap/d90 at the {opening.name}", f"{ratio:.3g}", "at least 5, better 10", breach, warning)


def _closed(opening: Opening) -> str:
    """What to draw where an opening was not meant to be one."""
    if opening.required:
        return "widen it, there is no other way; or is the unit of the vessel wrong?"
    width = opening.r_outer - opening.r_inner
    if math.isclose(width, opening.gap, rel_tol=1e-3) or opening.r_inner == 0:
        inner, outer = f"r = {opening.r_inner:.6g} m", f"r = {opening.r_outer:.6g} m"
        move = f"{outer} to {inner}" if opening.r_inner == 0 else f"{inner} to {outer}"
        return f"should the two sides touch? then move the points at {move}"
    near = f"[{opening.r_inner:.6g}, {opening.z:.6g}] (in m)"
    return f"should the two sides touch? then draw them with a common point near {near}"
