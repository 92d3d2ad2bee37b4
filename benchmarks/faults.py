"""Runs the tests that docs/validation/faults.md names, and writes there which of its rows held today."""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "validation" / "faults.md"

ROW = re.compile(r"^(\|[^|]*\|[^|]*\|)([^|]*)(\| `(\w+)`: `(.+)` \|)$", re.MULTILINE)
SUMMARY = re.compile(r"(which runs the tests:\n).*")

Test = tuple[str, str]  # file and name


def main() -> None:
    """Status 1 if a row did not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slow", action="store_true", help="the slow tests, too")
    parser.add_argument("files", nargs="*", help="only the tests of these, such as test_store; unless given, all")
    asked, text = parser.parse_args(), PAGE.read_text()
    outcome = run_tests(set(asked.files) or {row[4] for row in ROW.finditer(text)}, slow=asked.slow)
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()

    def renewed(row: re.Match[str]) -> str:
        new = outcome.get((row[4], row[5]))
        return f"{row[1]} {f'{new}, {today}' if new else row[2].strip()} {row[3]}"

    text = ROW.sub(renewed, text)
    states = [row[2].split(",")[0].strip() for row in ROW.finditer(text)]
    summary = f"{states.count('held')} of {len(states)} rows held when they were last tried."
    PAGE.write_text(SUMMARY.sub(rf"\g<1>{summary}", text))
    sys.exit(any(state != "held" for state in states))


def run_tests(names: set[str], *, slow: bool) -> dict[Test, str]:
    """What became of each test in the files of these names: held, failed or skipped."""
    files = sorted(path for path in (ROOT / "tests").rglob("test_*.py") if path.stem in names)
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", f"--junitxml={report}", *map(str, files)]
        subprocess.run([*command, *([] if slow else ["-m", "not slow"])], cwd=ROOT, check=False)
        cases = list(ET.parse(report).getroot().iter("testcase"))
    return {(case.get("classname", "").rpartition(".")[2], case.get("name", "")): _became(case) for case in cases}


def _became(case: ET.Element) -> str:
    if case.find("skipped") is not None:
        return "skipped"
    return "held" if case.find("failure") is None and case.find("error") is None else "failed"


if __name__ == "__main__":
    main()
