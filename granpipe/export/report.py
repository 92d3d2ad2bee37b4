"""A self-contained HTML page of text, tables and pictures, for a run and for a study."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granpipe.errors import DataError
from granpipe.progress import duration_text
from granpipe.system.jsonfile import read_json
from granpipe.system.templates import templates

BULK_TEXT = (
    "Soft particles overlap and pack too densely; packings and solids flows are corrected for it by the factor below, "
    "so that the reference density times the bulk velocity is the mass flux of the material."
)


@dataclass(frozen=True)
class Section:
    """A part of the page: text, pictures, a table.

    Parameters
    ----------
    title : its heading
    text : paragraphs
    figures : PNG files
    head, rows : a table; none without rows
    """

    title: str
    text: Sequence[str] = ()
    figures: Sequence[Path] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


def write_page(path: Path, title: str, intro: Sequence[str], sections: Sequence[Section]) -> None:
    """Write the page; pictures go into it."""
    parts = [
        {
            "title": section.title,
            "text": section.text,
            "figures": [base64.b64encode(figure.read_bytes()).decode() for figure in section.figures],
            "head": section.head,
            "rows": section.rows,
        }
        for section in sections
    ]
    page = templates(html=True).get_template("report.html.j2").render(title=title, intro=intro, parts=parts)
    path.write_text(page, encoding="utf-8")


def markdown(sections: Sequence[Section]) -> str:
    """The same text and tables as Markdown, without pictures."""
    lines: list[str] = []
    for section in sections:
        lines += [f"## {section.title}", ""]
        for paragraph in section.text:
            lines += [paragraph, ""]
        if section.rows:
            lines += ["| " + " | ".join(section.head) + " |", "|" + "---|" * len(section.head)]
            lines += ["| " + " | ".join(row) + " |" for row in section.rows]
            lines.append("")
    return "\n".join(lines)


def write_run_report(folder: Path) -> None:
    """``report.html`` of a results folder, from the files in it."""
    plan, provenance = read_json(folder / "plan.json"), read_json(folder / "provenance.json")
    try:
        sections = [_quality(provenance), *_pictures(folder), *_run_sections(plan, provenance)]
        intro = [
            f"Model {plan['model']}, made {provenance['made']} by granpipe {provenance['granpipe']} "
            f"in {duration_text(provenance['wall_seconds'])}.",
            _verdict(provenance["quality"]),
        ]
    except (KeyError, TypeError) as error:
        raise DataError(f"{folder}: damaged ({error!r}); delete it and run again") from None
    write_page(folder / "report.html", provenance["case"], intro, sections)


def _verdict(gates: Sequence[Mapping[str, Any]]) -> str:
    failed = [gate["name"] for gate in gates if not gate["passed"]]
    if failed:
        return f"Marked: the result failed {len(failed)} of {len(gates)} quality gates: {'; '.join(failed)}."
    return f"All {len(gates)} quality gates passed." if gates else "No quality gate applies to this model."


def _quality(provenance: Mapping[str, Any]) -> Section:
    gates = [
        (gate["name"], f"{gate['value']:.3g}", gate["limit"], "passed" if gate["passed"] else "failed")
        for gate in provenance["quality"]
    ]
    return Section("Quality", provenance.get("notes", ()), head=("gate", "value", "must be", ""), rows=gates)


def _run_sections(plan: Mapping[str, Any], provenance: Mapping[str, Any]) -> list[Section]:
    sections = _dem_sections(plan, provenance)
    stages = [(stage["stage"], stage["reason"]) for stage in plan["stages"]]
    sections.append(Section("Stages", _notes(plan), head=("stage", "why"), rows=stages))
    for name, submodel in provenance.get("submodels", {}).items():
        sections += _dem_sections(plan["submodels"].get(name, {}), submodel, f" of sub-model {name}")
    times = [
        ("forecast of filling and production", duration_text(provenance["forecast_seconds"])),
        ("this run, total", duration_text(provenance["wall_seconds"])),
    ]
    return [*sections, Section("Time of the run", head=("what", "time"), rows=times)]


def _dem_sections(plan: Mapping[str, Any], record: Mapping[str, Any], whose: str = "") -> list[Section]:
    """Errors, settings and times of a DEM run: that of the whole vessel, or that of a sub-model."""
    figures, sections = record["figures"], []
    errors = [(name, f"{error:.2%}") for name, error in figures.get("statistical_error", {}).items()]
    if errors:
        title = f"Statistical error of the field{whose}"
        sections.append(Section(title, head=("section", "relative error"), rows=errors))
    if "overlap_correction" in figures:
        sections.append(Section(f"Bulk{whose}", [BULK_TEXT], head=("", ""), rows=_bulk(figures)))
    if "discharge" in figures:
        sections.append(Section(f"Free discharge{whose}", head=("", "kg/s"), rows=_discharge(figures["discharge"])))
    decisions = [(c["name"], c["value"], c["criterion"]) for c in plan.get("dem", {}).get("decisions", ())]
    if decisions:
        seeds = ", ".join(map(str, record.get("seeds", ())))
        text = [f"Seeds: {seeds}."] if seeds else []
        sections.append(Section(f"Settings{whose}", text, head=("setting", "value", "criterion"), rows=decisions))
    if "produce_wall_seconds" in figures:
        sections.append(Section(f"Time{whose}", head=("what", "time"), rows=_times(figures)))
    return sections


def _bulk(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        ("reference packing", f"{figures['bulk_packing']:.4f}"),
        ("reference density", f"{figures['bulk_density_kg_per_m3']:.5g} kg/m³"),
        ("mean overlap, of a diameter", f"{figures['reference_overlap']:.2%}"),
        ("correction for it", f"{figures['overlap_correction']:.4f}"),
    ]


def _discharge(figures: Mapping[str, float | None]) -> list[tuple[str, str]]:
    named = {
        "through the outlet, averaged": figures["kg_per_s"],
        "its standard error": figures["standard_error"],
        "LIGGGHTS' own counter": figures["counted_kg_per_s"],
    }
    return [(name, f"{value:.4g}") for name, value in named.items() if value is not None]


def _notes(plan: Mapping[str, Any]) -> list[str]:
    return [*plan["warnings"], *(f"Outside the range: {breach}" for breach in plan["outside_the_range"])]


def _times(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the stages took; those that were done before took it in an earlier run."""
    return [
        ("production, each run", ", ".join(map(duration_text, figures["produce_wall_seconds"]))),
        ("of which averaging", ", ".join(map(duration_text, figures["averaging_seconds"]))),
    ]


def _pictures(folder: Path) -> list[Section]:
    pictures = sorted((folder / "figures").glob("*.png"))
    scale = "Velocities on r–z are those of the bulk at the process flow rate; those of particles are the simulation's."
    return [Section("Pictures", [scale], pictures)] if pictures else []
