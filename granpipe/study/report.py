"""What a study leaves: study.json and tables as CSV, charts as PNG, and one page of HTML with all of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from granpipe import __version__
from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.dem.contact import filling_angle
from granpipe.errors import CaseError, DataError
from granpipe.export.report import Section, markdown, write_page
from granpipe.planning.plan import Plan
from granpipe.progress import duration_text
from granpipe.study.budget import TOLERANCES, Advice, ErrorBound, Option, advise, pareto, percent, sure_factor
from granpipe.study.chart import draw_curves, draw_effects, draw_options
from granpipe.study.findings import Effect, Findings, ReferenceRun
from granpipe.study.fluid import Solve
from granpipe.study.slopes import AxisFit
from granpipe.study.uncertainty import COVERAGE, Part
from granpipe.sweep.folder import Folder
from granpipe.sweep.status import PointStatus
from granpipe.sweep.table import Row, write_csv
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.rates import machine

_GOOD_FORECAST = 1.5
"""A forecast within this factor of the measured time is good."""

_NO_POWER = 3.0
"""Misfit beyond which points along an axis do not follow a power of the setting."""


def write_study(
    folder: Folder,
    case: Case,
    found: Findings,
    solves: Sequence[Solve],
    other: Plan | None,
    missing: Sequence[PointStatus],
) -> list[Path]:
    """Write everything into the study's folder.

    Parameters
    ----------
    other : a plan whose time shall be forecast at the measured rate
    missing : the points that have no result
    """
    root = folder.root
    write_json(root / "study.json", _stored(case, found))
    write_csv([_option_row(option) for option in found.options], root / "options.csv")
    write_csv([_effect_row(effect) for effect in found.effects], root / "points.csv")
    draw_options(found.options, found.reference, root / "error_time.png")
    if found.effects:
        draw_effects(_effects(found), root / "effects.png")
        draw_curves(_method_curves(found), "wall time × cores [s]", "statistical error", root / "methods.png")
    if solves:
        across, up = "wall time of mesh and solve [s]", "error against the finest"
        draw_curves(_solve_curves(solves), across, up, root / "fluid.png")
    sections = list(study_sections(found, solves, other))
    if missing:
        sections.append(_without_result(missing))
    (root / "report.md").write_text("\n\n".join([*study_intro(found), markdown(sections)]), encoding="utf-8")
    charts = {
        "Error against time": "error_time.png",
        "Effects": "effects.png",
        "Methods": "methods.png",
        "Finite elements": "fluid.png",
    }
    shown = [
        Section(s.title, s.text, [root / charts[s.title]] if s.title in charts else (), s.head, s.rows)
        for s in sections
    ]
    write_page(root / "report.html", f"Study of {case.name}", study_intro(found), shown)
    return [root / name for name in ("report.html", "error_time.png", "options.csv", "points.csv", "study.json")]


@dataclass(frozen=True)
class FormerStudy:
    """What an earlier study found.

    Parameters
    ----------
    case : with everything settled
    fill_angle : of its filling [°]
    options : their errors are against the limit
    unknown : axes of which it is not known what they add to that
    """

    case: Case
    fill_angle: float
    options: list[Option]
    unknown: tuple[str, ...]


@dataclass(frozen=True)
class _Stored:
    """What is read of a ``study.json``."""

    case: dict[str, Any]
    fill_angle_deg: float
    options: Annotated[list[Option], Field(min_length=1)]
    unknown: tuple[str, ...]


def read_study(study: Path) -> FormerStudy:
    """Read a ``study.json``.

    Raises
    ------
    DataError : there is none, it is damaged, or its case is not one of this granpipe
    """
    remedy = "run the study again"
    stored = read_json(study, _Stored, remedy)
    for option in stored.options:
        if not {"whole"} <= option.statistical.keys() <= option.systematic.keys():
            raise DataError(f"{study}: damaged (the errors of {option.point} are not those of the whole); {remedy}")
    try:
        case = resolve(stored.case, Places(study.name)).case
        return FormerStudy(case, stored.fill_angle_deg, stored.options, stored.unknown)
    except CaseError as error:
        raise DataError(f"{study}: damaged ({error}); {remedy}") from error


def study_intro(found: Findings) -> list[str]:
    """Where and when, and against what."""
    alone = "No point has particles: errors are those of the finite elements, not what the fluid leaves out as a model."
    return [
        *([] if found.effects else [alone]),
        f"Made on {datetime.now().astimezone():%Y-%m-%d} by granpipe {__version__} on {machine()}.",
        *([] if found.earlier is None else _earlier_text(found.earlier)),
        f"Reference: {found.reference if found.earlier is None else 'that run'}. Errors are E = √(Σ A |δU|² / "
        "Σ A |U|²) over the bulk cells, A the area of each ring. Statistical: the standard error of the average. "
        "Systematic: the difference from the reference with the noise of both taken off, and its 95 % bound. "
        "Unresolved: smaller than its own uncertainty.",
        *([_distance_text(found)] if found.distance else []),
    ]


def _earlier_text(run: ReferenceRun) -> list[str]:
    """The earlier run from which errors count, and what is wrong with it."""
    size = "the material's own size" if run.own_size else "enlarged"
    plate = f", plate {run.plate_speed:.3g} m/s" if run.plate_speed > 0 else ""
    sections = ", ".join(f"{name} {percent(value)}" for name, value in run.statistical.items())
    told = (
        f"The reference is an earlier run, {run.folder}: particles of {1000 * run.diameter:.3g} mm ({size}){plate}, E "
        f"{run.youngs_modulus:.3g} Pa, time step {run.time_step:.3g} s, cells of {1000 * run.cell:.3g} mm. Its own "
        f"statistical error, which is in every bound: {sections} ({run.blocks:.0f} effective blocks)."
    )
    return [told, *(f"The reference failed a quality gate: {gate}." for gate in run.failed)]


def _distance_text(found: Findings) -> str:
    """What the errors of options hold beside the difference from the reference."""
    part = found.distance["whole"]
    told = [fit.axis for fit in found.axis_fits]
    unknown = (
        f" Not known, for no two points tell: what is added by {', '.join(found.unknown)}." if found.unknown else ""
    )
    if not told:
        return f"Errors are against the reference alone.{unknown}"
    return (
        "Errors of options are against the limit: the material's own size, no plate speed, no softness, no time step, "
        "no mass scaling. That is the reference less what its settings add, as points along the axes tell it "
        f"({', '.join(told)}): {percent(part.value)}, at most {percent(part.upper)}. Their noise is in every "
        f"bound.{unknown}"
    )


def study_sections(found: Findings, solves: Sequence[Solve], other: Plan | None) -> Iterator[Section]:
    """The report, part by part."""
    compared = None if other is None or not found.rate else (other.case.name, other.particle_steps / found.rate)
    yield _recommended(
        "Recommended settings",
        "The cheapest option whose error is proven (its 95 % bound is below the tolerance), or else estimated. Of "
        "options that differ in their filling alone the worst counts.",
        found.options,
        compared,
    )
    if found.earlier is not None:
        yield _recommended(
            "Settings by the reference alone",
            "The same by the difference from the reference as it is, at its plate speed and softness: nothing is "
            "extrapolated, and what these add is left out.",
            [option.against_reference() for option in found.options],
            compared,
        )
    yield Section(
        "Error against time",
        [
            "The front: options that no other beats in both time and 95 % bound. Travel in outlet diameters; "
            "systematic errors are against the limit."
        ],
        head=("point", "method", "travel", "time × cores", "statistical", "systematic", "error", "95 % bound"),
        rows=[_front_row(option) for option in pareto(found.options)],
    )
    if found.effects:
        if found.uncertainty:
            yield _uncertainty(found)
        yield from _particle_sections(found)
    if solves:
        yield Section(
            "Finite elements",
            ["The fictitious fluid on this outline, against order 4 on the finest mesh."],
            head=("order", "elements across", "unknowns", "time", "error"),
            rows=[
                (str(s.order), str(s.across), str(s.unknowns), duration_text(s.seconds), percent(s.error))
                for s in solves
            ],
        )
    if found.effects:
        yield _forecasts(found, other)


def _particle_sections(found: Findings) -> Iterator[Section]:
    """Sections on the points with particles."""
    axes = list(dict.fromkeys(axis for effect in found.effects for axis in effect.contributions))
    yield Section(
        "Error budget",
        [
            "What each setting adds against the limit of its axis: the material's own size, no speed, no softness, no "
            "step, no mass scaling. The sum of all parts is the expected difference from the reference, next to the "
            "measured one.",
            *map(_axis_fit_text, found.axis_fits),
            *_scatter_text(found.scatter),
        ],
        head=("point", "statistical", *axes, "all parts, from the reference", "measured, from the reference"),
        rows=[_budget_row(effect, axes) for effect in found.effects],
    )
    yield Section(
        "Effects",
        [
            "What a change of the case does to the time and to the field. For a shorter average of the case's own run "
            "that is the noise it adds; for the effect of a method see Methods."
        ],
        head=("change", "against the case's time", "difference from the case"),
        rows=[(name, f"× {times:.2f}", str(part)) for name, times, part in _effects(found)],
    )
    yield Section("Sections", head=_section_head(found), rows=[_section_row(effect) for effect in found.effects])
    names = list(dict.fromkeys(name for effect in found.effects for name in effect.measures))
    yield Section(
        "Measures",
        [
            "Differences from the reference. Temperature: w D/κ = 100 at the outlet, feed at 0, walls and obstacles "
            "at 1. Halves of the reference: the difference between both halves of its run; smaller "
            "differences are noise."
        ],
        head=("point", *names),
        rows=[
            *((effect.point, *_figures(effect.measures, names)) for effect in found.effects if effect.measures),
            *([("halves of the reference", *_figures(found.spread, names))] if found.spread else []),
        ],
    )
    yield Section(
        "Methods",
        ["Statistical error of the case itself over its averaging time, by how its average is made a field."],
        head=("method", "systematic", "whole average", "statistical"),
        rows=[_method_row(method, options) for method, options in _by_method(found).items()],
    )


def _without_result(missing: Sequence[PointStatus]) -> Section:
    rows = [(one.name, one.state, one.text) for one in missing]
    return Section("Points without a result", head=("point", "", "why"), rows=rows)


def _recommended(title: str, text: str, options: Sequence[Option], other: tuple[str, float] | None) -> Section:
    """What to take for each tolerance; `other` is the name of another case and the time that it takes on one core."""
    head = ["total error", "point", "method", "travel", "time × cores", "error", "95 % bound", ""]
    rows = []
    for tolerance in TOLERANCES:
        advice = advise(options, tolerance)
        row = _advice_row(advice)
        if other is not None:
            row += ("" if advice.option is None else f"× {other[1] / advice.option.core_seconds:.3g}",)
        rows.append(row)
    return Section(
        title,
        [text],
        head=tuple(head if other is None else [*head, f"{other[0]} takes"]),
        rows=rows,
    )


def _advice_row(advice: Advice) -> tuple[str, ...]:
    tolerance = advice.tolerance
    if advice.option is None:
        return (f"{tolerance:.0%}", "none of the options", "", "", "", "", "", "")
    option, error = advice.option, advice.option.error()
    return (
        f"{tolerance:.0%}",
        option.point,
        option.method,
        f"{option.travel:.2f}",
        duration_text(option.core_seconds),
        percent(error.value),
        percent(error.upper),
        "proven" if advice.proven else "estimated only",
    )


def _front_row(option: Option) -> tuple[str, ...]:
    error = option.error()
    return (
        option.point,
        option.method,
        f"{option.travel:.2f}",
        duration_text(option.core_seconds),
        percent(option.statistical["whole"]),
        str(option.systematic["whole"]),
        percent(error.value),
        percent(error.upper),
    )


def _uncertainty(found: Findings) -> Section:
    """The uncertainty of the case itself, as engineers report it."""
    whole, sections = found.uncertainty["whole"], list(found.uncertainty)

    def row(name: str, kind: str, values: Sequence[float], basis: str) -> tuple[str, ...]:
        return (name, kind, *map(percent, values), basis)

    rows = []
    for at, part in enumerate(whole.parts):
        figures = [_figure(found.uncertainty[section].parts[at]) for section in sections]
        rows.append((part.name, part.kind, *figures, part.basis))
    for name, kinds, basis in (
        ("u_num", ("statistical", "numerical"), "√ of the sum of squares"),
        ("u_input", ("input",), "the same, inputs independent of each other"),
        ("u_c, combined", (), "√(u_num² + u_input²)"),
    ):
        if name != "u_input" or any(part.kind == "input" for part in whole.parts):
            rows.append(row(name, "", [found.uncertainty[one].standard(*kinds) for one in sections], basis))
    expanded = [COVERAGE * found.uncertainty[one].standard() for one in sections]
    rows.append(row("U, expanded", "", expanded, f"{COVERAGE:g} u_c, about 95 %"))
    text = [
        f"Standard uncertainties u of the velocity field of {found.effects[0].point}, relative to it. The model's own "
        "error is not among them: it is seen only against a measurement, as E = S − D with u_val = √(u_num² + u_input² "
        "+ u_D²) (ASME V&V 20); u_D, the measurement's, is not known here."
    ]
    if any(part.bound for one in found.uncertainty.values() for part in one.parts):
        text.append("≤: noise hides the difference of the runs; its 95 % bound stands in its place, in the sums, too.")
    if whole.missing:
        text.append(f"Not determined, and not in the sums: {', '.join(whole.missing)}.")
    if not any(part.kind == "input" for part in whole.parts):
        text.append("Inputs are taken as exact: --inputs contact.friction=0.6..0.8 gives u_input.")
    return Section("Uncertainty", text, head=("source", "kind", *sections, "from"), rows=rows)


def _figure(part: Part) -> str:
    """The standard uncertainty of one part, as the table has it."""
    if part.standard is None:
        return ""
    return f"≤ {percent(part.standard)}" if part.bound else percent(part.standard)


def _scatter_text(scatter: float | None) -> Iterator[str]:
    if scatter is not None:
        counts = ", and noise counts as so much larger in what the axes tell" if scatter > 1 else ""
        yield f"Other fillings lie {scatter:.2f} times as far apart as their noise lets expect{counts}."


def _axis_fit_text(fit: AxisFit) -> str:
    if fit.misfit is None:
        return f"{fit.axis}: {fit.points} points at two settings, first order assumed."
    judgement = "no power of the setting describes them" if fit.misfit > _NO_POWER else "within the noise"
    return f"{fit.axis}: {fit.points} points, order {fit.order:g}, misfit {fit.misfit:.2g} ({judgement})."


def _budget_row(effect: Effect, axes: Sequence[str]) -> tuple[str, ...]:
    contributions = [str(effect.contributions[axis]["whole"]) if axis in effect.contributions else "" for axis in axes]
    predicted = "" if effect.predicted is None else str(effect.predicted["whole"])
    return (
        effect.point,
        percent(effect.statistical["whole"]),
        *contributions,
        predicted,
        str(effect.systematic["whole"]),
    )


def _effects(found: Findings) -> list[tuple[str, float, ErrorBound]]:
    """Name, time over that of the case, and difference from the case: every point, and shorter averages of the case."""
    base, *others = found.effects
    cost = base.seconds * base.cores
    timed = [effect for effect in others if effect.seconds > 0]  # an earlier run may not tell its time
    effects = [(effect.point, effect.seconds * effect.cores / cost, effect.from_base["whole"]) for effect in timed]
    for option in sorted(_by_method(found).get("psi", []), key=lambda option: -option.travel)[1:]:
        noise = math.sqrt(max(0.0, option.statistical["whole"] ** 2 - base.statistical["whole"] ** 2))
        name = f"average over {option.travel:.2g} outlet diameters"
        effects.append((name, option.core_seconds / cost, ErrorBound(noise, noise * sure_factor(option.blocks))))
    return effects


def _section_head(found: Findings) -> tuple[str, ...]:
    names = list(found.effects[0].systematic)
    return ("systematic error of point", *names)


def _section_row(effect: Effect) -> tuple[str, ...]:
    return (effect.point, *map(str, effect.systematic.values()))


def _figures(measures: Mapping[str, float], names: Sequence[str]) -> list[str]:
    return [f"{measures[name]:.3g}" if name in measures else "" for name in names]


def _by_method(found: Findings) -> dict[str, list[Option]]:
    """Options of the case itself by method, the longest average first."""
    methods: dict[str, list[Option]] = {}
    for option in found.options:
        if option.point == found.effects[0].point:
            methods.setdefault(option.method, []).append(option)
    return methods


def _method_row(method: str, options: Sequence[Option]) -> tuple[str, ...]:
    longest = max(options, key=lambda option: option.travel)
    return (
        method,
        str(longest.systematic["whole"]),
        f"{longest.travel:.2f} outlet diameters",
        percent(longest.statistical["whole"]),
    )


def _method_curves(found: Findings) -> dict[str, list[tuple[float, float]]]:
    return {
        method: [(option.core_seconds, option.statistical["whole"]) for option in options]
        for method, options in _by_method(found).items()
    }


def _solve_curves(solves: Sequence[Solve]) -> dict[str, list[tuple[float, float]]]:
    orders = sorted({solve.order for solve in solves})
    return {f"order {order}": [(s.seconds, s.error) for s in solves if s.order == order] for order in orders}


def _forecasts(found: Findings, other: Plan | None) -> Section:
    """Forecast against measured time of every point, and the time of another plan at the measured rate."""
    text = []
    rows = []
    for effect in found.effects:
        if effect.forecast is None:
            continue
        ratio = effect.seconds / effect.forecast
        good = "" if 1 / _GOOD_FORECAST <= ratio <= _GOOD_FORECAST else f"beyond a factor of {_GOOD_FORECAST:g}"
        rows.append((effect.point, duration_text(effect.forecast), duration_text(effect.seconds), f"{ratio:.2f}", good))
    if found.rate is not None:
        text.append(f"Measured: {found.rate:.3g} particle-steps per second on one core, filling included.")
    if other is not None and found.rate is not None:
        hours = other.particle_steps / found.rate / 3600
        text.append(
            f"{other.case.name}: {other.particle_steps:.3g} particle-steps, at this rate {hours:.3g} hours of one core."
        )
    return Section("Forecasts", text, head=("point", "forecast", "measured", "ratio", ""), rows=rows)


def _stored(case: Case, found: Findings) -> dict[str, object]:
    return {
        "case": case.model_dump(mode="json", exclude_none=True),
        "made": datetime.now().astimezone().isoformat(timespec="seconds"),
        "granpipe": __version__,
        "machine": machine(),
        "fill_angle_deg": round(math.degrees(filling_angle(case.contact.friction, case.contact.rolling_friction)), 3),
        **asdict(found),
    }


def _option_row(option: Option) -> Row:
    error = option.error()
    row: dict[str, str | float] = {
        "point": option.point,
        "method": option.method,
        "travel_outlet_diameters": option.travel,
        "seconds": option.seconds,
        "cores": option.cores,
        "error": error.value,
        "error_95": error.upper,
    }
    for name, statistical in option.statistical.items():
        part = option.systematic[name]
        row |= {
            f"{name}.statistical": statistical,
            f"{name}.systematic": part.value,
            f"{name}.systematic_95": part.upper,
        }
    return row | dict(option.changes)


def _effect_row(effect: Effect) -> Row:
    row: dict[str, str | float] = {"point": effect.point, "axis": effect.axis, "seconds": effect.seconds}
    row |= {"cores": effect.cores, "forecast_seconds": "" if effect.forecast is None else effect.forecast}
    for name, part in effect.systematic.items():
        row |= {f"{name}.systematic": part.value, f"{name}.systematic_95": part.upper}
    for axis, bounds in effect.contributions.items():
        row |= {f"part.{axis}": bounds["whole"].value, f"part.{axis}_95": bounds["whole"].upper}
    return row | dict(effect.measures)
