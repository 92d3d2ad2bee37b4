"""What the user reads when a run has ended: errors, gates, where the files are, what to do next."""

from __future__ import annotations

from pathlib import Path

from granpipe.pipeline.provenance import Provenance


def closing_text(folder: Path) -> str:
    """A few lines on a results folder.

    Raises
    ------
    DataError : it is not one, or is damaged
    """
    provenance = Provenance.read(folder)
    failed = [gate for gate in provenance.quality if not gate.passed]
    passed = f"{len(provenance.quality) - len(failed)} of {len(provenance.quality)} passed"
    rows = []
    if errors := provenance.figures.get("statistical_error"):
        rows.append(("error", ", ".join(f"{name} {error:.1%}" for name, error in errors.items()) + " (statistical)"))
    rows.append(("gates", f"{passed}; marked: do not use the field before you have read why" if failed else passed))
    rows.append(("report", f"{folder / 'report.html'}"))
    comsol = folder / "comsol"
    if comsol.is_dir():
        rows.append(("COMSOL", f"{comsol / 'import_comsol.java'} and its tables"))
    rows.append(("next", _next(folder, bool(failed), comsol.is_dir())))
    return "\n".join(f"  {name:<7} {text}" for name, text in rows)


def _next(folder: Path, marked: bool, comsol: bool) -> str:
    if marked:
        return "open the report; it says what each failed gate means and what to change"
    if comsol:
        return f"open the report; in {folder / 'comsol'}: comsol compile import_comsol.java"
    return "open the report"
