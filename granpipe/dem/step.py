"""How stiff particles are, and what follows from it: neighbour skin and time step."""

from __future__ import annotations

import math
from dataclasses import dataclass

from granpipe.case.contact import Contact
from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.decision import Decision
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.stress import BedStress

SKIN, WIDE_SKIN = 0.2, 0.4
"""Neighbour skin in mean diameters, and at the most, where the time step needs it."""

MANY_PARTICLES = 1e4
"""From so many on, where the step needs more than the usual skin, the widest costs least: what falls goes so far in a
step that lists are built every six to nine steps (docs/validation/deck_levers.md)."""


@dataclass(frozen=True)
class Step:
    """How the motion of the particles is solved.

    Parameters
    ----------
    youngs_modulus : of the particles [Pa]
    skin : of the neighbour lists [m]
    time_step : [s]
    rayleigh_time : of the smallest particle [s]
    decisions : the rules behind them
    """

    youngs_modulus: float
    skin: float
    time_step: float
    rayleigh_time: float
    decisions: tuple[Decision, ...]


def choose_step(case: Case, classes: SizeClasses, stress: BedStress, speed: float, particles: float) -> Step:
    """Choose stiffness, skin and time step, or judge those of the case.

    Parameters
    ----------
    stress : in the bed
    speed : of the fastest particle to be expected [m/s]
    particles : number of them
    """
    youngs, youngs_choice = _youngs_modulus(case, stress, classes)
    skin, skin_choice = _skin(case, classes, youngs, speed, particles)
    step, rayleigh, step_choice = _time_step(case, classes, youngs, speed, skin)
    return Step(youngs, skin, step, rayleigh, (youngs_choice, step_choice, skin_choice))


def step_limits(
    law: Contact, restitution: float, radius: float, density: float, youngs: float, speed: float, skin: float
) -> dict[str, float]:
    """What the time step must not exceed, in words → limit [s].

    Parameters
    ----------
    restitution : least of the contacts'
    radius : of the smallest particle [m]
    speed : of the fastest particle to be expected [m/s]
    """
    rayleigh = contact.rayleigh_time(radius, density, youngs, law.poisson)
    hertz = contact.hertz_time(radius, density, youngs, law.poisson, speed)
    share = contact.step_share(law.rolling_model, restitution)
    return {
        f"{share:.2g} of the smallest particle's Rayleigh time of {rayleigh:.3g} s": share * rayleigh,
        f"{contact.HERTZ_SHARE:g} of its collision of {hertz:.3g} s at {speed:.3g} m/s": contact.HERTZ_SHARE * hertz,
        f"{contact.SKIN_SHARE:g} of the neighbour skin of {skin:.3g} m at {speed:.3g} m/s": contact.SKIN_SHARE
        * skin
        / speed,
    }


def _youngs_modulus(case: Case, stress: BedStress, classes: SizeClasses) -> tuple[float, Decision]:
    law, pressed = case.contact, contact.wall_stiffening(classes.largest / classes.smallest)
    bed = contact.softened_modulus(stress.mean, stress.peak, law.poisson)
    needed = bed * pressed
    youngs = contact.two_digits_up(needed) if law.youngs_modulus == "auto" else float(law.youngs_modulus)
    criterion = (
        f"overlap at most {contact.MEAN_OVERLAP:.1%} on average and {contact.P99_OVERLAP:.1%} at the 99th percentile "
        f"under Janssen's {stress.mean:.3g} Pa on average and {stress.peak:.3g} Pa at most"
    )
    if pressed > 1:
        criterion += f"; {pressed:.2g} times as stiff, so that the largest do not press the smallest through walls"
    breach = ""
    if youngs < 0.5 * bed:
        breach = f"the bed overlaps too much; it needs about {needed:.2g} Pa"
    elif youngs < 0.5 * needed:
        breach = f"the largest may press the smallest through walls; it needs about {needed:.2g} Pa"
    return youngs, Decision("youngs_modulus", f"{youngs:.3g} Pa", criterion, breach)


def _time_step(
    case: Case, classes: SizeClasses, youngs: float, speed: float, skin: float
) -> tuple[float, float, Decision]:
    """Time step and Rayleigh time [s]; `speed` is that of the fastest particle to be expected [m/s]."""
    density = classes.smallest_density(case.material.density)
    rayleigh = contact.rayleigh_time(classes.smallest, density, youngs, case.contact.poisson)
    limits = _step_limits(case, classes, youngs, speed, skin)
    criterion, limit = min(limits.items(), key=lambda item: item[1])
    given = case.dem.time_step
    step = contact.two_digits(limit) if given == "auto" else float(given)
    breach = "" if step <= 1.05 * limit else f"at most {criterion} is stable; the bed may never come to rest"
    return step, rayleigh, Decision("time_step", f"{step:.3g} s", criterion, breach)


def _step_limits(case: Case, classes: SizeClasses, youngs: float, speed: float, skin: float) -> dict[str, float]:
    law, density = case.contact, classes.smallest_density(case.material.density)
    return step_limits(law, min(law.restitution, law.wall.restitution), classes.smallest, density, youngs, speed, skin)


def _skin(case: Case, classes: SizeClasses, youngs: float, speed: float, particles: float) -> tuple[float, Decision]:
    """Neighbour skin [m] of so many particles, of which none is faster than a speed [m/s]."""
    usual, wide = (contact.two_digits(share * classes.mean_diameter) for share in (SKIN, WIDE_SKIN))
    given = case.dem.time_step
    allowed = min(_step_limits(case, classes, youngs, speed, math.inf).values())
    step = contact.two_digits(allowed) if given == "auto" else float(given)
    needed = contact.two_digits_up(step * speed / contact.SKIN_SHARE)
    criterion = f"{SKIN:g} of the mean diameter"
    if needed <= usual:
        return usual, Decision("neighbour skin", f"{usual:.3g} m", criterion)
    skin = wide if particles >= MANY_PARTICLES else min(needed, wide)
    criterion += (
        f", at most {WIDE_SKIN:g} where the time step needs more: so much with {MANY_PARTICLES:g} particles and above"
    )
    return skin, Decision("neighbour skin", f"{skin:.3g} m", criterion)
