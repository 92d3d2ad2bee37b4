"""The page of the validation: what was expected and found, verdicts, figures, and what it takes to run all again."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import Any

from validation.case import Case, Verdict
from validation.suite import CASES, results_of

IMAGES = "images/validation"


def write_page(data: Path, out: Path) -> Path:
    """Write validation.md and its figures into a folder; returns the page."""
    judged = {case.name: list(case.judge(results_of(case, data)[0])) for case in CASES if results_of(case, data)[0]}
    for case in CASES:
        if case.name in judged and case.draw:
            picture(case, data, out / IMAGES)
    path = out / "validation.md"
    path.write_text("\n".join(lines(judged, data)) + "\n")
    return path


def lines(judged: dict[str, list[Verdict]], data: Path) -> Iterator[str]:
    every = [verdict for verdicts in judged.values() for verdict in verdicts]
    yield "# Compared with others"
    yield ""
    yield "Made by `make validation`; `PYTHONPATH=benchmarks python -m validation page` makes it again from the results"
    yield "in `benchmarks/references/validation` without a run. granpipe is compared with what others have measured,"
    yield "published or programmed. Each criterion was stated before the run or says that it was not; failures stay."
    yield "In the terms of ASME V&V 20 these are comparisons of codes, tests of the averaging, and comparisons with"
    yield "published laws and descriptions, whose own uncertainty u_D is hardly ever known: a validation in its sense,"
    yield "E = S − D against u_val on a measured vessel, is not among them, since no such measurement was at hand."
    yield "`make validation` may be stopped at any time: finished runs are kept, others go on from their last segment."
    yield ""
    yield tally(every) + "."
    yield ""
    yield "| case | holds | fails | not resolved | measured | processor minutes |"
    yield "|---|---|---|---|---|---|"
    for case in CASES:
        if case.name in judged:
            verdicts, kept = judged[case.name], results_of(case, data)[1]
            counts = (sum(v.passed is passed for v in verdicts) for passed in (True, False, None))
            minutes = minutes_of(list(kept.values())) if case.pieces else "as above"
            anchor = re.sub(r"[^a-z0-9 -]", "", case.title.lower()).replace(" ", "-")
            numbers = " | ".join(str(count or "") for count in counts)
            yield f"| [{case.title}](#{anchor}) | {numbers} | {max(one['made'] for one in kept.values())} | {minutes} |"
    yield ""
    if waiting := list(unrun(data)):
        yield f"Programmed and not run to the end yet: {'; '.join(waiting)}."
        yield ""
    yield "Not compared: the published rates of the DEM benchmark (Dosta et al. 2024), which could not be looked up."
    yield ""
    runs = [one for case in CASES if case.pieces for one in results_of(case, data)[1].values()]
    hours = sum(one["processor_seconds"] for one in runs) / 3600
    without = ", without the runs that are missing" if waiting else ""
    yield f"Processor minutes: {minutes_of(runs)} in all{without}, each run on one core. On two cores that do nothing"
    yield f"else this is {hours / 2:.1f} hours, since two cases run at a time and none takes half of the sum. **It was"
    yield "not shown in one piece**: all was run from nothing, but with pauses, and on a machine that did other work."
    yield "≈: partly estimated, from the particle-steps in LIGGGHTS' logs at 8e5 per second, the slowest of the cases"
    yield "that were measured ([the columns](#pressure-in-a-column-by-janssens-law)), and from the share of a core in"
    yield "LAMMPS' own logs."
    for case in CASES:
        if case.name in judged:
            yield from section(case, judged[case.name])


def tally(verdicts: Sequence[Verdict]) -> str:
    """How many hold, fail and are not resolved, as this page and the list of pages say it."""
    held, failed, open_ = (sum(one.passed is passed for one in verdicts) for passed in (True, False, None))
    return f"{len(verdicts)} comparisons: {held} hold, {failed} fail, {open_} are not resolved"


def unrun(data: Path) -> Iterator[str]:
    """Cases of which pieces are missing, with how many."""
    for case in CASES:
        missing = len(case.pieces) - len(results_of(case, data)[1])
        if case.pieces and missing:
            yield f"{case.title[0].lower()}{case.title[1:]} ({missing} of {len(case.pieces)} runs)"


def minutes_of(runs: Sequence[Mapping[str, Any]]) -> str:
    """Processor time of pieces; ≈ where it is an estimate for one of them."""
    total = sum(one["processor_seconds"] for one in runs) / 60
    return ("≈ " if any(one.get("estimated") for one in runs) else "") + f"{total:.1f}"


def section(case: Case, verdicts: list[Verdict]) -> Iterator[str]:
    yield from ("", f"## {case.title}", "", cleandoc(case.about), "")
    yield from (f"**Source.** {cleandoc(case.source)}", "", f"**Criterion.** {cleandoc(case.criterion)}", "")
    yield "| quantity | others | granpipe | verdict |"
    yield "|---|---|---|---|"
    for one in verdicts:
        yield f"| {one.quantity} | {one.expected} | {one.found} | {one.word} |"
    for cause in dict.fromkeys(one.cause for one in verdicts if one.cause and not one.passed):
        yield from ("", cleandoc(cause))
    if case.draw:
        yield from ("", f"![{case.title}]({IMAGES}/{case.name}.png)")


def picture(case: Case, data: Path, folder: Path) -> None:
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    assert case.draw
    case.draw(results_of(case, data)[0], figure)
    figure.savefig(folder / f"{case.name}.png", dpi=110, metadata={"Software": None})
