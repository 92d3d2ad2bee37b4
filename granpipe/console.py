"""Progress on the terminal: a bar where somebody watches, a line now and then in a log."""

from __future__ import annotations

import time

from granpipe.progress import DONE_BEFORE


class Console:
    """Progress on standard error: a bar on a terminal, a line now and then where nobody watches.

    A stage that was named in this run is not named as done before.
    """

    _EVERY = 30.0  # s
    _BAR = 20  # columns: bar, share and the beginning of the text stay on 80

    def __init__(self) -> None:
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
        from rich.table import Column

        self._console = RichConsole(stderr=True, highlight=False, markup=False, soft_wrap=True)
        columns = (
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
            BarColumn(self._BAR, table_column=Column(min_width=self._BAR)),
            TaskProgressColumn(table_column=Column(min_width=4, no_wrap=True)),
            TextColumn(
                "{task.fields[at]}", markup=False, table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")
            ),
        )
        self._bar = Progress(
            *columns, console=self._console, transient=True, expand=True, disable=not self._console.is_terminal
        )
        self._task = self._bar.add_task("", total=1.0, at="", visible=False)
        self._stage, self._next = "", 0.0
        self._named: set[str] = set()

    def __enter__(self) -> Console:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def stage(self, name: str, detail: str = "") -> None:
        self._stage, self._next = name, time.monotonic() + self._EVERY
        self._bar.update(self._task, visible=False)
        again = name in self._named
        self._named.add(name)
        if again and detail == DONE_BEFORE:
            return
        self._console.print(f"{name}: {detail}" if detail else f"{name}, again" if again else name)

    def update(self, fraction: float, text: str) -> None:
        self._bar.update(self._task, description=self._stage, completed=fraction, at=text, visible=True)
        if not self._console.is_terminal and time.monotonic() >= self._next:
            self._next = time.monotonic() + self._EVERY
            self._console.print(f"  {self._stage} {fraction:4.0%}  {text}")

    def note(self, text: str) -> None:
        self._console.print(text)

    def ask(self, question: str) -> bool:
        """Ask whoever sits at the terminal; the bar waits."""
        import click

        self._bar.stop()
        answer = click.confirm(question, default=True, err=True)
        self._bar.start()
        return answer
