"""How rooms report progress: through an object passed in; only the command line prints."""

from __future__ import annotations

from typing import Protocol

DONE_BEFORE = "done before"
"""Detail of a stage that was found in the store."""


def duration_text(seconds: float) -> str:
    """``2 h 05 min``, ``3 min 20 s``, ``12 s`` or ``0.42 s``."""
    if seconds < 10:
        return f"{seconds:.2g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def counted(number: int, noun: str) -> str:
    """``1 rank``, ``2 ranks``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


class Progress(Protocol):
    """Receiver of progress reports."""

    def stage(self, name: str, detail: str = "") -> None:
        """A stage begins (or was found done: the detail says so)."""

    def update(self, fraction: float, text: str) -> None:
        """The present stage is at `fraction` (0–1); `text` is one short line."""

    def note(self, text: str) -> None:
        """Something that the user should read, printed once."""


class Silent:
    """Progress that nobody watches."""

    def stage(self, name: str, detail: str = "") -> None:
        pass

    def update(self, fraction: float, text: str) -> None:
        pass

    def note(self, text: str) -> None:
        pass


class Both:
    """Two that watch."""

    def __init__(self, one: Progress, other: Progress) -> None:
        self._watching = one, other

    def stage(self, name: str, detail: str = "") -> None:
        for progress in self._watching:
            progress.stage(name, detail)

    def update(self, fraction: float, text: str) -> None:
        for progress in self._watching:
            progress.update(fraction, text)

    def note(self, text: str) -> None:
        for progress in self._watching:
            progress.note(text)
