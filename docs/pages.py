"""Writes the reference pages that are made from the code: the case file, the commands, the gates."""

from collections.abc import Iterator
from pathlib import Path

import click

from granpipe.case.reference import reference
from granpipe.cli import main
from granpipe.pipeline.gates_page import gates_page
from granpipe.repose.search import GATES

HERE = Path(__file__).parent

_INTRODUCTION = """\
# Commands

This page is made from the command line itself: run `make docs` after changing it. `granpipe COMMAND --help` shows the
same text.

**Quantities** may carry a unit: `15mm`, `'20 s'`, `5%`; without one they are in SI. **Overrides**: `--set
dem.seed=2` changes one key of [the case](case.md) for one run.

**Shell completion** completes commands, options and file names. For bash, add this line to `~/.bashrc`; for zsh, write
`zsh_source` and `~/.zshrc`:

```text
eval "$(_GRANPIPE_COMPLETE=bash_source granpipe)"
```

For fish, run this once:

```text
_GRANPIPE_COMPLETE=fish_source granpipe > ~/.config/fish/completions/granpipe.fish
```

**Exit status**

| status | meaning |
| --- | --- |
| 0 | done, and every quality gate passed |
| 2 | the case or the command line is wrong; nothing was run |
| 3 | a program or a file failed; there is no result |
| 4 | done, but a [quality gate](gates.md) failed: the result is kept and marked |
| 130 | interrupted; the same command continues |
"""


def commands_page() -> str:
    """Every command with its arguments and options, as Markdown."""
    return "\n".join([_INTRODUCTION, *(_section(context) for context in _contexts(click.Context(main)))])


def _contexts(parent: click.Context, path: str = "granpipe") -> Iterator[click.Context]:
    """Every command that is not hidden, in alphabetical order, with its whole name."""
    group = parent.command
    assert isinstance(group, click.Group)
    for name, command in sorted(group.commands.items()):
        context = click.Context(command, parent=click.Context(click.Command(path)), info_name=name)
        context.parent.info_name = path  # type: ignore[union-attr]
        if isinstance(command, click.Group):
            yield from _contexts(context, f"{path} {name}")
        elif not command.hidden:
            yield context


def _section(context: click.Context) -> str:
    command = context.command
    usage = f"{context.command_path} {' '.join(command.collect_usage_pieces(context))}"
    options = [one.get_help_record(context) for one in command.params if isinstance(one, click.Option)]
    rows = [f"| `{_cell(names)}` | {_cell(text)} |" for names, text in filter(None, options)]
    table = ["| option | meaning |", "| --- | --- |", *rows, ""] if rows else []
    return "\n".join(
        [f"## {context.command_path}", "", "```text", usage, "```", "", _paragraphs(command.help or ""), "", *table]
    )


def _paragraphs(text: str) -> str:
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


PAGES = {"case.md": reference, "commands.md": commands_page, "gates.md": lambda: gates_page(GATES)}
"""Page → what it is made by."""

if __name__ == "__main__":
    for page, make in PAGES.items():
        (HERE / "reference" / page).write_text(make())
