"""The stability suite as a page: a table of all rows, a map of the stable region, and what similar scenes give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stability.rows import Judged, rows

_MARKERS = {"done": "o", "flagged": "s", "stopped": "X", "refused": "D"}
_STABLE, _UNSTABLE, _UNSEEN = "#2b8a3e", "#c92a2a", "#868e96"
_COLOURS = ((_STABLE, "stable"), (_UNSTABLE, "not stable"), (_UNSEEN, "nothing to see"))


@dataclass(frozen=True)
class Similar:
    """A similar scene against its model: 95 % upper bound of the noise-free difference of the fields, by section."""

    length: float
    density: float
    noise_free: Mapping[str, float]
    upper: Mapping[str, float]


def summary(judged: Sequence[Judged]) -> Iterator[str]:
    """Lines that count."""
    chosen = [one for one in judged if one.row.chosen and one.verdict != "refused"]
    seen = [one for one in judged if one.verdict != "refused"]
    unstable = [one for one in seen if not one.stable]
    marked = [one for one in unstable if one.verdict != "done"]
    alarms = [one for one in seen if one.wrong == "false alarm"]
    yield f"- {len(judged)} of the suite's {len(rows())} rows: {len(judged) - len(seen)} refused,"
    yield f"  {len(seen) - len(unstable)} stable, {len(unstable)} unstable."
    yield f"- granpipe chose all settings in {len(chosen)} of them: {sum(one.stable for one in chosen)} are stable."
    yield f"- Of the {len(unstable)} unstable rows {len(marked)} were stopped or marked;"
    yield f"  {len(unstable) - len(marked)} ended as a finished result without a mark."
    yield f"- {len(alarms)} stable rows were stopped."


def table(judged: Sequence[Judged]) -> Iterator[str]:
    """All rows."""
    yield "| scene | varied | value | granpipe | why | the dumps | rest energy / m g d | bed over plate |"
    yield "|---|---|---|---|---|---|---|---|"
    for one in judged:
        row = one.row
        truth = "" if one.verdict == "refused" else "; ".join(one.faults) or "stable"
        wrong = f" **{one.wrong}**" if one.wrong else ""
        chosen = " ●" if row.chosen else ""
        cells = [
            row.scene,
            row.group,
            f"{row.value:g}{chosen}",
            one.verdict + wrong,
            _short(one.said),
            truth,
            _number(one.rest.energy, ".1e"),
            _number(one.flow.following, ".2f"),
        ]
        yield f"| {' | '.join(cells)} |"


def _number(value: float | None, spec: str) -> str:
    return "" if value is None else format(value, spec)


def _short(text: str) -> str:
    """The first line, in a length that a table bears."""
    line = text.partition("\n")[0].replace("|", "/").removeprefix("setting of the case: ").removeprefix("--set ")
    return line if len(line) <= 140 else line[:137] + "…"


def similar_table(scenes: Sequence[Similar]) -> Iterator[str]:
    """Similar scenes, one row each."""
    if not scenes:
        return
    names = list(scenes[0].upper)
    yield "| length × | density × | " + " | ".join(names) + " |"
    yield "|---|---|" + "---|" * len(names)
    for one in scenes:
        cells = [f"{one.noise_free[name]:.1%} (< {one.upper[name]:.1%})" for name in names]
        yield f"| {one.length:g} | {one.density:g} | " + " | ".join(cells) + " |"


def draw_map(judged: Sequence[Judged], path: Path) -> None:
    """One line per group, its values in order: green stable, red unstable; the shape tells what granpipe said."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    lines: dict[str, list[Judged]] = {}
    for one in judged:
        if not one.row.similar:
            lines.setdefault(f"{one.row.group} ({one.row.scene})", []).append(one)
    figure = Figure(figsize=(10, 0.42 * len(lines) + 1.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for y, ones in enumerate(lines.values()):
        for x, one in enumerate(ones):
            colour = _UNSEEN if one.verdict == "refused" else _STABLE if one.stable else _UNSTABLE
            edge = "black" if one.row.chosen else colour
            axes.plot(x, y, _MARKERS[one.verdict], color=colour, markeredgecolor=edge, markersize=9)
            axes.annotate(
                f"{one.row.value:g}", (x, y), (0, -8), textcoords="offset points", ha="center", va="top", size=7
            )
    axes.set_yticks(range(len(lines)), list(lines), size=8)
    axes.set_xticks([])
    axes.set_ylim(len(lines) - 0.3, -0.7)
    axes.spines[["top", "right", "bottom", "left"]].set_visible(False)
    marks = [Line2D([], [], marker=m, ls="", color="black", label=f"granpipe: {name}") for name, m in _MARKERS.items()]
    marks += [Line2D([], [], marker="o", ls="", color=c, label=n) for c, n in _COLOURS]
    marks.append(
        Line2D([], [], marker="o", ls="", color="white", markeredgecolor="black", label="settings all granpipe's")
    )
    axes.legend(handles=marks, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def page(judged: Sequence[Judged], similar: Sequence[Similar], picture: str, date: str, program: str) -> str:
    """The page in Markdown."""
    unlike = [one for one in judged if not one.row.similar]
    lines = [
        "# Stability",
        "",
        f"Written by `make stability` on {date} with {program}.",
        "",
        _HOW,
        "",
        *summary(judged),
        "",
        f"![Map of the stable region]({picture})",
        "",
        "## Rows",
        "",
        "● granpipe chose every setting of the row.",
        "",
        *table(unlike),
        "",
        "## Similar scenes",
        "",
        "The reactor scene at other lengths and densities, all dimensionless groups equal: noise-free difference",
        "of its field from that of the model, with the 95 % upper bound, for the whole and each section.",
        "",
        *similar_table(similar),
    ]
    return "\n".join(lines).rstrip() + "\n"


_HOW = """\
Every row is a variant of a small scene, a column or a reactor with hopper, throat and widening, and is run by
`granpipe run` as a user would. `done`: a result without a mark. `flagged`: a result with a failed gate (status 4).
`stopped`: ended with an error. `refused`: not started. Gates about the noise of so short a run are left out.

Whether the row is stable is judged apart, from particle dumps alone. The bed is filled and left alone for some free
falls through the vessel: no particle is missing, nine tenths of them are slower than 0.01 √(g d), the bed sinks less
than 0.02 d and is not packed denser than 0.68. In granpipe's own run the bed between plate and outlet moves as fast as
the plate, within 30 % (it loosens while it starts), and its kinetic energy does not grow tenfold."""
