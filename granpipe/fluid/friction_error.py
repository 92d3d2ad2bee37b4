"""What error of a fluid is to be expected: its errors against DEM in the scenes of `benchmarks/friction_fluid.py`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

_DATA = Path(__file__).with_name("friction_error.json")


@dataclass(frozen=True)
class ExpectedError:
    """Error over the whole vessel, noise taken off: mean and largest of some scenes, and their number."""

    mean: float
    worst: float
    worst_scene: str
    scenes: int

    def text(self) -> str:
        """For the user."""
        return (
            f"{self.mean:.0%} wrong on average against DEM of {self.scenes} vessels, at worst {self.worst:.0%} "
            f"({self.worst_scene})"
        )


@cache
def expected_error(rheology: str) -> ExpectedError:
    """Of a "viscous" or a "frictional" fluid."""
    errors: dict[str, float] = json.loads(_DATA.read_text())[rheology]
    worst = max(errors, key=errors.__getitem__)
    return ExpectedError(float(np.mean([*errors.values()])), errors[worst], worst, len(errors))
