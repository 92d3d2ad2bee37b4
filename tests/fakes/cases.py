"""Cases from plain data, changed key by key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places


def changed_data(data: Mapping[str, Any], changes: Mapping[str, object]) -> dict[str, Any]:
    """The data of a case with other keys: `group` or `group__key`."""
    found = dict(data)
    for key, value in changes.items():
        group, _, name = key.partition("__")
        found[group] = {**found.get(group, {}), name: value} if name else value
    return found


def case_of(data: Mapping[str, Any], **changes: object) -> Case:
    """The case that the data describe, changed."""
    return resolve(changed_data(data, changes), Places("slab.yaml"), {}).case
