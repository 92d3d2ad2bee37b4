"""What the computation of a model hands to the writer of results."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from granpipe.field import Field
from granpipe.pipeline.gates import Gate

if TYPE_CHECKING:
    from granpipe.fluid.fictitious import FluidSolution
    from granpipe.pipeline.production import Production


@dataclass(frozen=True)
class ModelResult:
    """What the stages hand over: the field, its gates, measured figures, notes, and the model's own data.

    `submodels` holds, by name, what a hybrid follows.
    """

    field: Field
    gates: tuple[Gate, ...]
    figures: dict[str, Any] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    productions: tuple[Production, ...] = ()
    solution: FluidSolution | None = None
    submodels: Mapping[str, ModelResult] = dataclasses.field(default_factory=dict)
