"""The chart of a study: error against time, every option with its error bar, and the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from granpipe.study.budget import TOLERANCES, ErrorBound, Option, advise, pareto, percent
from granpipe.system.surroundings import own_style

DURATIONS = (
    (1.0, "s", (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)),
    (60.0, "min", (1.0, 3.0, 10.0, 30.0)),
    (3600.0, "h", (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)),
)
"""Seconds of a unit, its name, and where an axis of times has its ticks in it."""

COLOURS = [f"C{number}" for number in range(10) if number != 7]
"""Of options that are told apart: matplotlib's, but for the grey one."""

_OTHERS = {"marker": ".", "color": "0.7", "markersize": 4, "linewidth": 0.6}


@own_style({})
def draw_options(options: Sequence[Option], reference: str, path: Path) -> None:
    """Total error of the whole against wall time × cores, on logarithmic axes.

    One line per point and method, over the lengths of its average. Bars reach up to the 95 % bound. Only the reference,
    the front and what is recommended are told apart: a study may have dozens of others.
    """
    from matplotlib.figure import Figure

    front, lines = pareto(options), _lines(options)
    recommended = [advise(options, tolerance).option for tolerance in TOLERANCES]
    telling = {(option.point, option.method) for option in (*front, *recommended) if option is not None}
    told = [line for line in lines if line in telling or line[0] == reference]
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    axes: Any = figure.subplots()
    axes.step(
        [option.core_seconds for option in front],
        [option.error().upper for option in front],
        where="post",
        color="black",
        linewidth=2,
        alpha=0.5,
        label="front of the 95 % bounds",
    )
    highest = 0.0
    for name in sorted(lines, key=told.__contains__):
        errors = [option.error() for option in lines[name]]
        highest = max(highest, *(error.value for error in errors))
        axes.errorbar(
            [option.core_seconds for option in lines[name]],
            [error.value for error in errors],
            yerr=[[0.0] * len(errors), [error.upper - error.value for error in errors]],
            **_style(name, told, reference),
        )
    if len(told) < len(lines):
        axes.plot([], [], **_OTHERS, label="other options")
    for tolerance in TOLERANCES:
        axes.axhline(tolerance, color="grey", linewidth=0.4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    bounds = [bound for option in front if math.isfinite(bound := option.error().upper)]
    if (top := max([highest, *bounds], default=0.0)) > 0:
        axes.set_ylim(top=1.2 * top)  # not by the longest bar of those beside the front
    _durations(axes.xaxis)
    _readable(axes.yaxis, percent)
    axes.set_xlabel("time × cores")
    axes.set_ylabel("error of the field, whole vessel")
    axes.grid(alpha=0.3, which="both")
    figure.legend(loc="outside lower center", fontsize=7, ncols=2)
    figure.savefig(path, dpi=130)


def _style(name: tuple[str, str], told: Sequence[tuple[str, str]], reference: str) -> dict[str, Any]:
    """Of a line of a point and method: a colour of its own where it is told apart."""
    if name not in told:
        return _OTHERS
    point, method = name
    number, is_reference = told.index(name), point == reference
    return {
        "marker": "os^vD<>ph*"[number % 10],
        "color": "black" if is_reference else COLOURS[number % len(COLOURS)],
        "markersize": 5,
        "linewidth": 0.8,
        "capsize": 2,
        "linestyle": "--" if is_reference else "-",
        "label": f"{point}, {method}" + (" (reference)" if is_reference else ""),
    }


@own_style({})
def draw_effects(effects: Sequence[tuple[str, float, ErrorBound]], path: Path) -> None:
    """What each change of the case costs or saves, and what it changes.

    Parameters
    ----------
    effects : name, time over that of the case, difference of the field from the case's
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes: Any = figure.subplots()
    for number, (name, times, part) in enumerate(effects):
        height = part.value if part.resolved else part.upper
        axes.errorbar(
            [times],
            [height],
            yerr=[[0.0], [part.upper - height]],
            marker="os^vD<>ph*"[number % 10] if part.resolved else "_",
            color=f"C{number % 10}",
            markersize=6,
            capsize=2,
            linestyle="none",
        )
        axes.annotate(name, (times, height), xytext=(5, 3), textcoords="offset points", fontsize=7)
    axes.axvline(1.0, color="grey", linewidth=0.6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    _readable(axes.xaxis, lambda times: f"× {times:g}")
    _readable(axes.yaxis, percent)
    axes.margins(x=0.2, y=0.1)
    axes.set_xlabel("time × cores, over that of the case")
    axes.set_ylabel("difference from the case (a dash: below it)")
    axes.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=120)


def _durations(axis: Any) -> None:
    """Ticks of a logarithmic axis of seconds at 1, 3, 10 and 30 of a unit that fits."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    ticks = {factor * unit: f"{factor:g} {name}" for unit, name, factors in DURATIONS for factor in factors}
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: ticks.get(value, "")))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _readable(axis: Any, text: Callable[[float], str]) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, in words."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
    axis.set_minor_formatter(NullFormatter())


def _lines(options: Sequence[Option]) -> dict[tuple[str, str], list[Option]]:
    """Options of one point and method, the cheapest first."""
    lines: dict[tuple[str, str], list[Option]] = {}
    for option in sorted(options, key=lambda option: option.core_seconds):
        lines.setdefault((option.point, option.method), []).append(option)
    return lines


@own_style({})
def draw_curves(curves: dict[str, list[tuple[float, float]]], across: str, up: str, path: Path) -> None:
    """Lines of (x, y), both logarithmic: another chart of error against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 4.0), layout="constrained")
    axes: Any = figure.subplots()
    for label, points in curves.items():
        xs, ys = zip(*sorted(points), strict=True)
        axes.loglog(xs, ys, "o-", markersize=4, linewidth=1, label=label)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7)
    figure.savefig(path, dpi=110)
