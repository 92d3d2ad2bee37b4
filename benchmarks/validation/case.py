"""What a case of the validation is made of."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Data = Mapping[str, Any]
"""Results of a case's pieces by their names: numbers, lists and texts, as JSON holds them."""


@dataclass(frozen=True)
class Verdict:
    """One comparison.

    Parameters
    ----------
    quantity : what was compared
    expected : the value of others, with its range or error
    found : granpipe's value, with its error
    passed : whether the criterion of the case is met; None where the errors are too large to tell
    cause : of a failure, as far as it is known
    """

    quantity: str
    expected: str
    found: str
    passed: bool | None
    cause: str = ""

    def __post_init__(self) -> None:
        """Truth values of numpy become those of Python, which are counted by identity."""
        if self.passed is not None:
            object.__setattr__(self, "passed", bool(self.passed))

    @property
    def word(self) -> str:
        """The verdict as the page says it."""
        return {True: "holds", False: "**fails**", None: "not resolved"}[self.passed]


@dataclass(frozen=True)
class Case:
    """A comparison with others.

    Parameters
    ----------
    name : of its files
    title : heading on the page
    about : what is compared, how; a paragraph
    source : who found what is expected
    criterion : what has to be met; stated before the run
    pieces : what has to be run, each resumable on its own: a function of a folder that returns the piece's results
    judge : verdicts from the results of all pieces
    draw : puts the case's figure together
    short : the pieces of `make verify`; their verdicts must not fail
    """

    name: str
    title: str
    about: str
    source: str
    criterion: str
    pieces: Mapping[str, Callable[[Path], Data]]
    judge: Callable[[Data], Sequence[Verdict]]
    draw: Callable[[Data, Figure], None] | None = None
    short: Sequence[str] = ()


def file_name(*parts: object) -> str:
    """The parts joined to the name of a scene, which granpipe takes as the name of a case."""
    return re.sub(r"[^a-z0-9-]", "_", "-".join(f"{part:g}" if isinstance(part, float) else str(part) for part in parts))
