"""Quality gates: measured figures with limits. A run that fails one keeps its results, marked, and ends with 4."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from granpipe.dem.contact import MEAN_OVERLAP, P99_OVERLAP
from granpipe.field import Array

LEVEL_FLOW_LIMIT = 0.05
"""Raw flow through any level less what the filling gained above the plug, against the plug's: a balance."""

STORAGE_LIMIT = 0.1
"""Part of the flow that may gather between the plug and any level: what is taken off for it is uncertain by a fifth."""

LEAST_EFFECTIVE = 20
"""Independent blocks that an error bar needs before a run may end by it: one of 20 is itself uncertain by 16 %."""

SIZE_SHARE_LIMIT = 0.02
"""Inserted mass share of any size class against the one asked for."""

PACKING_RANGE = (0.5, 0.68)
"""Packing of a bed of spheres: looser is not at rest, denser overlaps."""


@dataclass(frozen=True)
class Gate:
    """One measured figure, its limit in words, and whether it holds."""

    name: str
    value: float
    limit: str
    passed: bool

    def as_dict(self) -> dict[str, Any]:
        """For ``provenance.json``."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.3g}, must be {self.limit}"


def level_flow_gates(raw_flow: Array, gathered: Array, solids_flow: float) -> list[Gate]:
    """Balance of every level (n,) before any adjustment against the flow in the plug [m³/s].

    Parameters
    ----------
    raw_flow : through every level
    gathered : what of it the change of the filling between the plug and the level explains
    solids_flow : in the plug
    """
    balance = float(np.abs((raw_flow - gathered) / solids_flow - 1).max())
    storage = float(np.abs(gathered / solids_flow).max())
    return [
        Gate(
            "raw flow through the worst level less what gathers below it, relative to the plug's",
            balance,
            f"at most {LEVEL_FLOW_LIMIT:.0%} (average longer: dem.max_time)",
            balance <= LEVEL_FLOW_LIMIT,
        ),
        Gate(
            "part of the flow that gathers between the plug and the worst level",
            storage,
            f"at most {STORAGE_LIMIT:.0%} (average later or longer: homogenize.start, dem.max_time)",
            storage <= STORAGE_LIMIT,
        ),
    ]


def error_gates(errors: dict[str, float], effective: float, target: float, duration: float) -> list[Gate]:
    """Statistical error of the worst section and of the whole, and on how many independent blocks it rests.

    Parameters
    ----------
    errors : section → statistical error of the final field; empty where it is not known
    effective : independent blocks
    target : the error that the case allows
    duration : simulated time that was averaged [s], for a forecast of what is missing
    """
    worst = max(errors, key=errors.__getitem__, default="whole")
    error, missing = errors.get(worst, math.inf), missing_time(errors, effective, target, duration)
    remedy = "" if missing == 0 else f" (dem.max_time: about {missing:.3g} s more)"
    return [
        Gate(f"statistical error, section {worst}", error, f"at most {target:.3g}{remedy}", error <= target),
        Gate("independent blocks", effective, f"at least {LEAST_EFFECTIVE}{remedy}", effective >= LEAST_EFFECTIVE),
    ]


def missing_time(errors: dict[str, float], effective: float, target: float, duration: float) -> float:
    """Simulated time [s] that an average still lacks, its error falling with the square root of its length."""
    share = max((max(errors.values(), default=math.inf) / target) ** 2, LEAST_EFFECTIVE / effective)
    return duration * max(0.0, share - 1)


def size_gate(share: list[float], wanted: list[float]) -> Gate:
    """Mass share of each size class in the bed against the distribution of the case."""
    worst = float(np.abs(np.array(share) - np.array(wanted)).max())
    return Gate(
        "mass share of the worst size class, deviation",
        worst,
        f"at most {SIZE_SHARE_LIMIT:g}",
        worst <= SIZE_SHARE_LIMIT,
    )


def overlap_gates(mean: float, p99: float) -> list[Gate]:
    """Overlap of the settled bed: mean and 99th percentile."""
    limits = (("mean", mean, MEAN_OVERLAP), ("99th percentile of the", p99, P99_OVERLAP))
    return [
        Gate(
            f"{name} overlap of particles, settled",
            value,
            f"at most {limit:g} (contact.youngs_modulus)",
            value <= limit,
        )
        for name, value, limit in limits
    ]


def packing_gate(packing: float) -> Gate:
    """Reference packing: of the plug above a plate, or of the bed above an open outlet."""
    low, high = PACKING_RANGE
    return Gate("reference packing", packing, f"{low:g} to {high:g}", low <= packing <= high)


def breach_gate(breach: str) -> Gate:
    """A value of the case outside the stable or accurate range."""
    return Gate(f"setting of the case: {breach}", 1.0, "inside the range", False)
