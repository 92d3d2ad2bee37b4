"""Compiles loops with numba, cached where a cache folder is writable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function, compiled at its first call: of floats and arrays, divided by 0 as numpy does."""
    try:
        made = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(function)
    except RuntimeError:  # no folder can be written: neither beside the code, nor the user's
        made = numba.njit(nogil=True, error_model="numpy", fastmath={"contract"})(function)
    return cast(F, made)
