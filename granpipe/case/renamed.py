"""Keys and values of earlier versions: not accepted, but the message says what they are called now."""

from __future__ import annotations

from typing import Any

from granpipe.case.yamlfile import Places, shorten
from granpipe.errors import CaseError

RENAMED_KEYS = {("fluid", "outlet"): "outlet_profile"}
"""Former key → what its last part is called now."""

RENAMED_VALUES = {
    ("homogenize", "method"): {"paper": "gaussian"},
    ("fluid", "outlet_profile"): {"open": "developed", "plate": "uniform"},
}
"""Key → former values and what they are called now."""


def refuse_renamed(data: dict[str, Any], places: Places) -> None:
    """Look for former keys and values in the plain data of a case.

    Raises
    ------
    CaseError : one is there; names the new one
    """
    for key in {**RENAMED_KEYS, **RENAMED_VALUES}:
        group: Any = data
        for part in key[:-1]:
            group = group.get(part) if isinstance(group, dict) else None
        if not isinstance(group, dict) or key[-1] not in group:
            continue
        value = group[key[-1]]
        name = RENAMED_KEYS.get(key, key[-1])
        values = RENAMED_VALUES.get((*key[:-1], name), {})
        if name != key[-1] or (isinstance(value, str) and value in values):
            current = values.get(value, value) if isinstance(value, str) else value
            message = f"{shorten(value)}; renamed: write {name}: {shorten(current)}"
            raise CaseError(message, key, places.locate(key))
