"""Attacks on drawings, through ``granpipe outline`` and cases that name a drawing."""

from __future__ import annotations

from attacks.attack import Attack


def attacks() -> list[Attack]:
    """Every attack on drawings."""
    return []
