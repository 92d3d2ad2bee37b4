"""The page that lists what granpipe refuses, marks and notes, generated from the limits in the code.

``docs/reference/gates.md`` is what `gates_page` returns: ``make docs`` writes it anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from granpipe.case.material import LEAST_PACKING
from granpipe.case.material import MOST_PACKING as MOST_CASE_PACKING
from granpipe.dem import contact, gaps, health, plate
from granpipe.fluid.direct import LARGEST_RESIDUAL
from granpipe.homogenize.psi_field import MOST_STORAGE
from granpipe.pipeline import field_vessel, known_field
from granpipe.pipeline.dump_checks import DUMP_GATES, MOST_OUTSIDE, MOST_PACKING
from granpipe.pipeline.gates import GATES, NOTES, Limit
from granpipe.planning.sections import FLATTEST_HOPPER

_INTRODUCTION = """\
# What granpipe refuses, marks and lets pass, and why

Made from the limits in the code: run `make docs` after changing one.

- **Refused**: the case is impossible or the simulation is no longer physics. There is no result (status 2 or 3).
- **Marked**: a measured figure is beyond its limit, a gate has failed. The results are written, the failed gates stand
  on the terminal, in `report.html` and in `provenance.json` under `quality`, and the run ends with status 4. A run with
  status 0 has passed every gate.
- **Noted**: the result is right as far as it goes, but there is something to keep in mind. Notes stand on the terminal,
  in the report and in `provenance.json` under `notes`; the status stays 0.

A figure is a gate where being beyond the limit means that the field is wrong, and a note where it may also be the
nature of the vessel.
"""

_PASSES = """\
## What passes

granpipe computes what the case describes. It does not know, and therefore cannot mark:

- whether the particles' properties are those of your material. Friction decides the flow most: calibrate it;
- cohesion, moisture, breakage, gas flow, heat and segregation finer than the size classes: they are not modelled;
- how far coarser or softer particles change the flow, within the accepted range. `granpipe study` measures it;
- a flow that is not axisymmetric because the real vessel is not, such as one with a feeder at its side;
- the profile at the outlet: within one diameter of it the field depends on the plate, or on `fluid.outlet_profile`;
- in a hopper that the case calls `regime: mass_flow` and that is steep enough, whether that is so.
"""


def gates_page(heaps: Iterable[Limit]) -> str:
    """The page as Markdown.

    Parameters
    ----------
    heaps : limits of a search for friction by heaps (`granpipe repose`)
    """
    parts = [
        _INTRODUCTION,
        "## Refused before the run\n",
        "What a case file may say stands in [the case file](case.md); `granpipe check` tells what is wrong with one.\n",
        _table(("what", "limit", "why"), _planned()),
        "\n## Refused while LIGGGHTS runs\n",
        _table(("what", "limit", "why"), _watched()),
        "\n## Refused after the run\n",
        _table(("what", "limit", "why"), _refused()),
        "\n## Marked\n",
        _limits(GATES),
        "\nA field from dumps that a user brings (`granpipe homogenize`), beside the packing and, with a case, what an "
        "average must pass:\n",
        _limits(DUMP_GATES),
        "\nFriction found from heaps (`granpipe repose`):\n",
        _limits(heaps),
        "\n## Noted\n",
        _limits(NOTES),
        "\nBefore the run, by `granpipe plan`: a flow rate above "
        f"{plate.BEVERLOO_SHARE:.0%} of the free discharge through an opening, where inertia begins to show; an "
        "opening narrower than 10 d90, where wall layers and arching show; particles of sizes more than 3 to 1.",
        "",
        _PASSES,
    ]
    return "\n".join(parts)


def _limits(limits: Iterable[Limit]) -> str:
    rows = [(one.name, one.range, one.models, one.why, f"`{one.remedy}`" if one.remedy else "") for one in limits]
    return _table(("figure", "limit", "model", "why", "remedy"), rows)


def _planned() -> list[tuple[str, str, str]]:
    return [
        (
            "a fluid in a section with a floor: a narrowing ledge or wall, and up to a diameter above it",
            f"{math.degrees(FLATTEST_HOPPER):.0f}° from the vertical, in all wider than the smallest particle's radius",
            "solids rest there and flow in a funnel, also where the case says `regime: mass_flow` or `model: fluid`",
        ),
        (
            "a fluid without `material.bulk_density`",
            "",
            "without particles nothing else tells the mass flow",
        ),
        (
            "packing fraction of the bulk: `bulk_density` over `density`",
            f"{LEAST_PACKING:g} to {MOST_CASE_PACKING:g}",
            "no bulk is looser or denser",
        ),
        (
            "`flow_rate`, also of `granpipe scale`",
            "free discharge (Beverloo) through every opening; below a cone up to "
            f"{plate.MOST_BEVERLOO:g} times that (Rose & Tanaka)",
            "no more falls through",
        ),
        (
            "width of every opening and gap, in d90",
            f"{gaps.LEAST_GAP:g}, or {gaps.LEAST_COARSE_GAP:g} of coarse-grained particles, which is marked",
            "it arches; one narrower than the smallest particle may be meant to touch, and the message says where",
        ),
        (
            "annular outlet of a fluid (`fluid.annulus`)",
            "inside the outlet, and as wide as any opening",
            "particles do not pass a narrower one",
        ),
        (
            "outline of a field that a hybrid follows (`fluid.known_field`), or that is read beside its case",
            f"{field_vessel.TOLERANCE:.0%} of a level's section",
            "the field of another vessel; the same vessel gives 0 to rounding",
        ),
        (
            "flow of a field that a hybrid follows",
            f"above 0, and the same through every level to {known_field.FLOW_TOLERANCE:.1%}",
            "the hybrid follows a downward flow; the field must not contradict itself",
        ),
        (
            "speed of the plate",
            f"{plate.MOST_BEVERLOO:g} times free discharge through the narrowest opening (Beverloo)",
            "the plate would leave the solids behind",
        ),
    ]


def _watched() -> list[tuple[str, str, str]]:
    return [
        ("particles lost", "none", "inserted − discharged = present, in every row of the log"),
        ("particles outside the walls", "none", "pressed or shot through"),
        (
            "kinetic energy of the bed",
            f"{health.PEAK_ENERGY:g} times what flow and falls give, {health.MEAN_ENERGY:g} times on average over a "
            "diameter of travel",
            "unstable contacts heat the bed; 0.07 to 1.1 times were seen at the most, 0.12 on average",
        ),
        (
            "speed of the fastest particle",
            f"{health.PEAK_SPEED:g} times that of a free fall through everything",
            "unstable contacts",
        ),
        (
            "time step over the duration of the fastest collision",
            f"{health.COLLISION_SHARE:.0%}",
            "a collision must be resolved",
        ),
        (
            "overlap of touching particles",
            f"{health.OVERLAP_MARGIN * contact.MEAN_OVERLAP:.1%} on average, "
            f"{health.OVERLAP_MARGIN * contact.P99_OVERLAP:.1%} for the 99th percentile",
            "twice what Young's modulus is chosen for",
        ),
        (
            "flow through an opening",
            f"at least {health.ARCH_FLOW:.0%} of the imposed one over {health.ARCH_TRAVEL:g} diameters of travel in it",
            "an arch holds the particles up; at least 80% was seen in openings from 7.5 diameters on",
        ),
    ]


def _refused() -> list[tuple[str, str, str]]:
    return [
        (
            "part of the flow that gathers between the plug and a level",
            f"{MOST_STORAGE:.0%}",
            "the filling changes too fast for a steady field",
        ),
        (
            "solids of dumps outside the walls of the case",
            f"{MOST_OUTSIDE:.0%}",
            "another vessel, unit, axis or gravity",
        ),
        ("packing in dumps over three diameters", f"{MOST_PACKING:g}", "spheres do not pack more densely"),
        ("radius of a particle in dumps", "the same to 1%", "particles that grow are not averaged"),
        ("residual of the fluid's linear system", f"{LARGEST_RESIDUAL:g}", "the solver has failed"),
    ]


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
