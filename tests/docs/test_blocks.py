"""Every command and Python block of the docs is run, page by page, as a reader would type it.

A block with a title is a file that the page asks for. A comment before a block says that it is `slow`, or why it is
`not run`.
"""

import importlib.util
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_BLOCK = re.compile(
    r"(?:^[ ]*<!-- (?P<mark>slow|not run: [^\n]+) -->\n\s*)?"
    r'^(?P<indent>[ ]*)```[ ]?(?P<language>\w*)(?: title="(?P<title>[\w.-]+)")?[ ]*\n(?P<text>.*?)^(?P=indent)```[ ]*$',
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text without indent, the file that it is, and what is said about running it."""

    language: str
    text: str
    title: str | None
    mark: str

    @property
    def slow(self) -> bool:
        return self.mark == "slow"

    @property
    def runs(self) -> bool:
        return self.language in ("bash", "python") and not self.mark.startswith("not run")


def blocks(page: Path) -> list[Block]:
    found = []
    for match in _BLOCK.finditer(page.read_text()):
        text = re.sub(rf"^{match['indent']}", "", match["text"], flags=re.MULTILINE)
        found.append(Block(match["language"], text, match["title"], match["mark"] or ""))
    return found


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def with_blocks(slow: bool) -> list[Path]:
    return [page for page in PAGES if any(block.runs and block.slow >= slow for block in blocks(page))]


def run(page: Path, folder: Path, slow: bool) -> None:
    """Type a page's blocks in an empty folder that has the cases of the repository."""
    (folder / "bin").mkdir()
    command = folder / "bin" / "granpipe"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m granpipe "$@"\n')
    command.chmod(0o755)
    (folder / "cases").symlink_to(ROOT / "cases")
    path = f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    env = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    for block in blocks(page):
        if block.title is not None:
            (folder / block.title).write_text(block.text)
        elif block.runs and block.slow <= slow:
            start = ["bash", "-euo", "pipefail", "-c"] if block.language == "bash" else [sys.executable, "-c"]
            done = subprocess.run(
                [*start, block.text], cwd=folder, env=env, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{block.text}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


@pytest.mark.parametrize("page", with_blocks(slow=False), ids=name)
def test_the_blocks_of_a_page_run(page: Path, tmp_path: Path) -> None:
    run(page, tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("page", with_blocks(slow=True), ids=name)
def test_the_blocks_of_a_page_run_with_the_slow_ones(page: Path, tmp_path: Path) -> None:
    run(page, tmp_path, slow=True)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_no_command_hides_in_a_block_without_a_language(page: Path) -> None:
    plain = [block.text for block in blocks(page) if not block.language]
    assert not [
        text for text in plain if re.search(r"^(granpipe|make|python|pip|apt-get|sbatch|cd) ", text, re.MULTILINE)
    ]


def test_every_block_is_seen() -> None:
    for page in PAGES:
        assert len(blocks(page)) * 2 == len(re.findall(r"^ *```", page.read_text(), re.MULTILINE)), page.name


def test_every_command_that_is_named_exists() -> None:
    from granpipe.cli import main

    sweep = main.commands["sweep"]
    assert isinstance(sweep, click.Group)
    for page in set(PAGES) - {ROOT / "docs" / "reference" / "case.md"}:  # that one is the schema's own text
        lines = [line for block in blocks(page) if block.language == "bash" for line in block.text.splitlines()]
        for code in [*re.findall(r"`([^`\n]+)`", page.read_text()), *lines]:
            words = re.match(r"(?:\S*/)?granpipe ([a-z]+)(?: ([a-z]+)\b)?", code)
            if words is None:
                continue
            assert words[1] in main.commands, f"{name(page)}: {code}"
            assert words[1] != "sweep" or not words[2] or words[2] in sweep.commands, f"{name(page)}: {code}"


def test_the_site_is_built_strictly_and_loads_nothing_from_the_network(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    for page in tmp_path.rglob("*.html"):
        assert not re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="?(?:https?:)?//[^>]+', page.read_text()), (
            page.name
        )


def test_the_page_of_the_commands_is_current() -> None:
    spec = importlib.util.spec_from_file_location("pages", ROOT / "docs" / "pages.py")
    assert spec is not None
    assert spec.loader is not None
    pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pages)
    assert (ROOT / "docs" / "reference" / "commands.md").read_text() == pages.commands_page(), "run `make docs`"
