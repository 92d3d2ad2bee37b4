"""What the user reads when a run has ended: errors, gates, where the files are, what to do next."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

from granpipe.export.run_report import PROGRAMS, in_space
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
    if failed:
        rows.append(("next", "open the report; it says what each failed gate means and what to change"))
    else:
        steps = _next(folder, in_space(provenance.figures))
        rows += [("next" if number == 0 else "", step) for number, step in enumerate(steps)]
    return "\n".join(f"  {name:<7} {text}" for name, text in rows)


def _next(folder: Path, spatial: bool) -> list[str]:
    """What to do with a field that is good to use: any one of the ways that its files offer."""
    comsol = folder / "comsol"
    steps = ["open the report, then use the field in one of these ways"]
    if comsol.is_dir() and spatial:
        steps.append(f"COMSOL Desktop by hand: load the files of {comsol} as docs/how-to/vessels-in-space.md says")
    elif comsol.is_dir():
        steps += [
            f"COMSOL: cd {quote(str(comsol))}; comsol compile import_comsol.java; "
            "comsol batch -inputfile import_comsol.class -outputfile ../../flow.mph",
            f"COMSOL by way of MPh (pip install mph): python {quote(str(comsol / 'import_comsol.py'))} flow.mph",
            f"COMSOL Desktop by hand: load the files of {comsol} as docs/how-to/comsol.md says",
        ]
    programs = [f"{name}/ ({text})" for name, text in PROGRAMS.items() if (folder / name).is_dir()]
    if programs:
        steps.append(f"{', '.join(programs)} in {folder}: docs/how-to/other-programs.md")
    steps.append(f"Python: granpipe.load_result({str(folder)!r}).field.velocity({'x, y, z' if spatial else 'r, z'})")
    return steps
