"""`make stability`: checks the stability rules of extreme settings against particle data."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from granpipe.console import Console
from granpipe.system.cores import usable_cores
from stability.rows import rows, subset
from stability.suite import is_done, run_suite, write_page


@click.command()
@click.option("--results", type=click.Path(path_type=Path), default=Path("results"), show_default=True)
@click.option("--done", is_flag=True, help="Run nothing; write the table of the rows that are done.")
@click.option("--quick", is_flag=True, help="A few rows only: automatic settings, a breach of each kind, a refusal.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of stability.md and its map; default: the rows'.")
def main(results: Path, quick: bool, done: bool, out: Path | None) -> None:
    """Run the stability suite.

    Rows that are done are not repeated: delete RESULTS/stability to begin anew. All take half an hour of one core.
    """
    folder = results / "stability"
    with Console() as console:
        wanted = [row for row in (subset(rows()) if quick else rows()) if not done or is_done(row, folder)]
        judged = run_suite(wanted, folder, usable_cores(), console)
    click.echo(f"table in {write_page(judged, folder, out or folder)}")
    wrong = [one for one in judged if one.wrong]
    for one in wrong:
        click.echo(
            f"{one.row.name}: {one.wrong}: granpipe {one.verdict}, {'; '.join(one.faults) or 'stable'}", err=True
        )
    sys.exit(4 if wrong else 0)


if __name__ == "__main__":
    main()
