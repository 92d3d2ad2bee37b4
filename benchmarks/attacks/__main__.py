"""Hostile input to every door of granpipe: ``PYTHONPATH=benchmarks:tests python -m attacks [MODULE …] [--only TEXT]``.

Each attack says beforehand what is right: refused, marked, told, or a value that is computed without granpipe. The
counts go to docs/validation/faults.md; folders of attacks that were not held are kept.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from attacks import MODULES
from attacks.attack import HELD, Outcome, preload, try_attack

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "faults.md"

COLUMNS = ("attacks", *HELD, "not held")


def main() -> None:
    """Status 1 if an attack was not held."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", default=MODULES, help=f"of {', '.join(MODULES)}; unless given, all")
    parser.add_argument("--only", default="", help="attacks whose kind or name holds this text; writes no page")
    parser.add_argument("--folder", type=Path, help="where to work; unless given, a temporary folder")
    asked = parser.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="attacks-"))
    preload()
    lost = False
    for module in asked.modules:
        outcomes = []
        for number, attack in enumerate(importlib.import_module(f"attacks.{module}").attacks()):
            if asked.only in f"{attack.kind}: {attack.name}":
                outcomes.append(try_attack(attack, folder / module / str(number)))
                report(outcomes[-1], folder / module / str(number))
        print("\n".join(table(outcomes)))
        lost |= not all(one.held for one in outcomes)
        if not asked.only:
            write(module, outcomes)
    sys.exit(lost)


def report(outcome: Outcome, folder: Path) -> None:
    """Print one outcome on a line, more of it where the attack was not held."""
    text = " | ".join(outcome.why.splitlines())
    place = "" if outcome.held else f" [{folder}]"
    print(f"{outcome.verdict:9} {outcome.seconds:5.1f} s  {outcome.attack.kind}: {outcome.attack.name}{place}")
    print(f"          {text[:300] if outcome.held else text[-1500:]}", flush=True)


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Rows of a Markdown table: how many attacks of each kind there were and what became of them."""
    rows = [f"| kind | {' | '.join(COLUMNS)} |", f"|---|{'---:|' * len(COLUMNS)}"]
    for kind in [*dict.fromkeys(one.attack.kind for one in outcomes), "all"]:
        these = [one for one in outcomes if kind in (one.attack.kind, "all")]
        found = Counter(one.verdict if one.held else "not held" for one in these)
        numbers = [len(these), *(found[column] for column in COLUMNS[1:])]
        rows.append(f"| {kind} | {' | '.join(str(number or '') for number in numbers)} |")
    return rows


def write(module: str, outcomes: Sequence[Outcome]) -> None:
    """Replace the table of a module in the page."""
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    rows = "\n".join([f"<!-- attacks: {module} -->", *table(outcomes), "", f"Tried on {day}.", "<!-- end -->"])
    text = PAGE.read_text()
    new = re.sub(rf"<!-- attacks: {module} -->.*?<!-- end -->", lambda _: rows, text, flags=re.DOTALL)
    if new == text and f"<!-- attacks: {module} -->" not in text:
        raise SystemExit(f"{PAGE} has no place for the attacks of {module}")
    PAGE.write_text(new)


if __name__ == "__main__":
    main()
