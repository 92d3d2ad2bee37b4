"""The uncertainty of a field as engineers report it: parts, combined and expanded.

Terms of ASME V&V 20-2009. *Numerical* uncertainty u_num comes from solving the model only approximately: the length
of the average, particle size, plate speed, stiffness, time step, grid. *Input* uncertainty u_input comes from
parameters that are known only as ranges. All are standard uncertainties, of which U = 2 u covers about 95 %. The
model's own error is not among them: it is seen only against a measurement, as the comparison error E with the
validation uncertainty u_val = √(u_num² + u_input² + u_D²), where u_D is the measurement's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from granpipe.study.budget import ErrorBound
from granpipe.study.inputs import RANGE_SHARE

COVERAGE = 2.0
"""Expanded over standard uncertainty, for about 95 %."""


@dataclass(frozen=True)
class Part:
    """One source of uncertainty.

    Parameters
    ----------
    name : of the source
    kind : statistical, numerical or input
    standard : standard uncertainty u, relative to the field; None where it was not determined
    basis : where the figure comes from
    bound : whether u is an upper bound, because noise hides the difference that it comes from
    """

    name: str
    kind: str
    standard: float | None
    basis: str
    bound: bool = False


@dataclass(frozen=True)
class Uncertainty:
    """All parts for the whole field of the case, or for one section of it."""

    parts: tuple[Part, ...]

    def standard(self, *kinds: str) -> float:
        """Parts of some kinds together (of all, where none is named), as independent ones: √(Σ u²)."""
        chosen = [part.standard or 0.0 for part in self.parts if not kinds or part.kind in kinds]
        return math.sqrt(sum(value**2 for value in chosen))

    @property
    def missing(self) -> list[str]:
        """Sources that were not determined."""
        return [part.name for part in self.parts if part.standard is None]


def statistical_part(standard_error: float) -> Part:
    """The standard error of the average, which is a standard uncertainty as it stands."""
    return Part("length of the average", "statistical", standard_error, "standard error from blocks of segments")


def numerical_part(name: str, error: ErrorBound | None, basis: str) -> Part:
    """A numerical error that is estimated but not corrected: its 95 % bound is the expanded uncertainty."""
    return Part(name, "numerical", None if error is None else error.upper / COVERAGE, basis)


def input_part(key: str, ends: Sequence[str], apart: ErrorBound | None) -> Part:
    """An input, from the difference of the fields at both ends of its range.

    The noise of both runs is taken off; where nothing is left of it, its 95 % bound stands.
    """
    if apart is None:
        return Part(key, "input", None, "a run at an end of its range is missing")
    return Part(
        key,
        "input",
        RANGE_SHARE * (apart.value if apart.resolved else apart.upper),
        f"{ends[0]} to {ends[1]}, any value alike; linear between runs at both ends",
        bound=not apart.resolved,
    )
