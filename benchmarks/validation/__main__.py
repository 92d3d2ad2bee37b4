"""`make validation`: runs the cases that are missing, and writes docs/validation/validation.md."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from validation.case import Case, Verdict
from validation.page import write_page
from validation.suite import run_piece, run_together, stored, wanted

ROOT = Path(__file__).resolve().parents[2]


@click.command()
@click.argument("what", type=click.Choice(["run", "page", "names"]))
@click.option("--only", multiple=True, help="Name of a case; default: all.")
@click.option("--piece", multiple=True, help="Name of a piece; default: all.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Cases that run at the same time.")
@click.option("--short", is_flag=True, help="The short form of `make verify`: nothing is kept; status 4: one fails.")
@click.option("--results", type=click.Path(path_type=Path), default=ROOT / "results" / "validation")
@click.option("--data", type=click.Path(path_type=Path), default=ROOT / "benchmarks" / "references" / "validation")
@click.option("--out", type=click.Path(path_type=Path), default=ROOT / "docs" / "validation")
def main(
    what: str,
    only: tuple[str, ...],
    piece: tuple[str, ...],
    jobs: int,
    short: bool,
    results: Path,
    data: Path,
    out: Path,
) -> None:
    """Pieces whose results are in DATA are not run again: delete its files to begin anew.

    The short form looks at no DATA, so that it judges this very code; runs of LIGGGHTS that RESULTS holds are not made
    again.
    """
    try:
        pieces = [(case, name) for case, name in wanted(only, short) if not piece or name in piece]
    except ValueError as error:
        raise click.BadParameter(str(error)) from error
    if what == "names":
        click.echo("\n".join(f"{case.name} {name}" for case, name in pieces))
        return
    if short:
        with tempfile.TemporaryDirectory() as fresh:
            sys.exit(run_short(pieces, results, Path(fresh)))
    if what == "run" and jobs > 1:
        if failed := run_together(pieces, jobs, results, data):
            raise click.ClickException(f"{', '.join(failed)} failed; see the logs, and run again for what is missing")
    elif what == "run":
        for case, name in pieces:
            run_piece(case, name, results, data)
    if not piece:
        click.echo(write_page(data, out))


def run_short(pieces: Sequence[tuple[Case, str]], results: Path, data: Path) -> int:
    """Run pieces into an empty DATA and show their verdicts; 4 if one fails, otherwise 0."""
    for case, name in pieces:
        run_piece(case, name, results, data)
    judged: list[Verdict] = []
    for case in {case.name: case for case, _ in pieces}.values():
        kept = stored(data / f"{case.name}.json")
        judged += case.judge({piece: one["found"] for piece, one in kept.items()})
    for one in judged:
        click.echo(f"{one.quantity}: others {one.expected}, granpipe {one.found}: {one.word}")
    return 4 if any(one.passed is False for one in judged) else 0


if __name__ == "__main__":
    main()
