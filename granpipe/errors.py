"""Every failure that granpipe explains to its user, one class per kind of remedy."""

from __future__ import annotations

from pathlib import Path

KeyPath = tuple[str | int, ...]


def dotted(key: KeyPath) -> str:
    """Write a key path as users write it: ``("wall", 3, "r")`` becomes ``wall[3].r``."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


class GranpipeError(Exception):
    """Base class. The text says what is wrong, where, the value, and what to do.

    ``exit_status`` is what the command line returns: 2 the case is wrong, 3 a program or file failed. ``evidence`` is
    the folder with what a failed program has left, once that is kept.
    """

    exit_status = 3
    evidence: Path | None = None


class CaseError(GranpipeError):
    """The case asks for something wrong or impossible.

    Parameters
    ----------
    message : what is wrong, the value included, and the remedy
    key : path of the offending key in the case, e.g. ``("outline", "wall", 3)``
    place : ``file:line`` of that key, once known
    """

    exit_status = 2

    def __init__(self, message: str, key: KeyPath = (), place: str = "") -> None:
        self.message, self.key, self.place = message, key, place
        super().__init__(message, key, place)

    def __str__(self) -> str:
        head = " ".join(part for part in (self.place, dotted(self.key)) if part)
        return f"{head}: {self.message}" if head else self.message


class MeshError(GranpipeError):
    """gmsh could not make a usable mesh, or LIGGGHTS would refuse it."""


class RunError(GranpipeError):
    """A program that granpipe started failed, or its result is not to be trusted."""


class DataError(GranpipeError):
    """A file is truncated, inconsistent or of another kind than expected."""


class SolveError(GranpipeError):
    """A numerical solution does not exist or missed its accuracy."""
