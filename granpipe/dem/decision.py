"""A setting, with the rule that it was chosen by."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """One setting with the rule behind it.

    `breach` says what is wrong when a value of the case lies outside the stable or accurate range (such a run ends with
    status 4), `warning` what to keep in mind.
    """

    name: str
    value: str
    criterion: str
    breach: str = ""
    warning: str = ""
