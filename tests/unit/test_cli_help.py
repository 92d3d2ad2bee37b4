"""The commands as `--help` shows them, and what commands that have moved answer."""

import re

import click
import pytest
from click.testing import CliRunner

from granpipe.cli import MOVED, main


def commands(group: click.Group, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = [path]
    for name, command in group.commands.items():
        found += commands(command, (*path, name)) if isinstance(command, click.Group) else [(*path, name)]
    return found


@pytest.mark.parametrize("path", commands(main), ids=" ".join)
def test_help_is_whole_on_a_terminal_of_80_columns(path: tuple[str, ...]) -> None:
    done = CliRunner().invoke(main, [*path, "--help"], env={"COLUMNS": "80"})
    assert done.exit_code == 0
    assert not re.findall(r"[a-z]\.\.\.", done.output)  # how click cuts a summary; metavars are in capitals
    assert all(len(line) <= 80 for line in done.output.splitlines())


@pytest.mark.parametrize(("old", "new"), [*MOVED.items(), ("sweep pyproject.toml", "sweep run pyproject.toml")])
def test_a_command_that_has_moved_says_its_new_name(old: str, new: str) -> None:
    done = CliRunner().invoke(main, [*old.split(), "more"])
    assert done.exit_code == 2
    assert f"`granpipe {old}` is now `granpipe {new}`" in done.output


def test_every_option_is_described() -> None:
    for path in commands(main):
        command: click.Command = main
        for name in path:
            assert isinstance(command, click.Group)
            command = command.commands[name]
        bare = [one.opts for one in command.params if isinstance(one, click.Option) and not one.help]
        assert not bare or command.hidden, path
