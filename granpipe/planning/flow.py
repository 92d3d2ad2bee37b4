"""The flow rate that a case asks for, as bulk flow."""

from __future__ import annotations

from granpipe.case.schema import Case


def target_flow(case: Case, packing: float) -> float:
    """Bulk flow [m³/s] that the case asks for; a mass flow becomes bulk of this packing."""
    rate = case.flow_rate
    if rate.volume is not None:
        return rate.volume
    assert rate.mass is not None  # the case gives one of the two
    return rate.mass / (case.material.density * packing)
