"""What the computation of a model hands to the writer of results."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from granpipe.field import Field
from granpipe.pipeline.gates import Gate

if TYPE_CHECKING:
    from granpipe.fluid.fictitious import FluidSolution
    from granpipe.pipeline.production import Production


@dataclass(frozen=True)
class ModelResult:
    """What the stages hand over: the field, its gates, measured figures, the model's own data, notes for the user."""

    field: Field
    gates: tuple[Gate, ...]
    figures: dict[str, Any] = dataclasses.field(default_factory=dict)
    productions: tuple[Production, ...] = ()
    solution: FluidSolution | None = None
    notes: tuple[str, ...] = ()
