"""Progress on the terminal: a bar where somebody watches, a line now and then in a log."""

from __future__ import annotations

import time


class Console:
    """Progress on standard error: a bar on a terminal, a line now and then where nobody watches."""

    _EVERY = 30.0  # s

    def __init__(self) -> None:
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        self._console = RichConsole(stderr=True, highlight=False, markup=False, soft_wrap=True)
        columns = (
            TextColumn("  {task.description}"),
            BarColumn(30),
            TaskProgressColumn(),
            TextColumn("{task.fields[at]}"),
        )
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("", total=1.0, at="", visible=False)
        self._stage, self._next = "", 0.0

    def __enter__(self) -> Console:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def stage(self, name: str, detail: str = "") -> None:
        self._stage, self._next = name, time.monotonic() + self._EVERY
        self._bar.update(self._task, visible=False)
        self._console.print(f"{name}: {detail}" if detail else name)

    def update(self, fraction: float, text: str) -> None:
        self._bar.update(self._task, description=self._stage, completed=fraction, at=text, visible=True)
        if not self._console.is_terminal and time.monotonic() >= self._next:
            self._next = time.monotonic() + self._EVERY
            self._console.print(f"  {self._stage} {fraction:4.0%}  {text}")

    def note(self, text: str) -> None:
        self._console.print(text)
