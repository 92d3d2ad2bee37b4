"""What pydantic found wrong, as one CaseError with place, value and remedy."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from granpipe.case.yamlfile import Places, shorten
from granpipe.errors import CaseError, KeyPath

_SILENT = {"default_factory_not_called"}  # follows from another error
_WORDS = {"dict_type": "must be a group of named values", "missing": "missing"}


def case_error(error: ValidationError, data: Any, places: Places) -> CaseError:
    """The error that stands first in the file, and how many others there are."""
    found = [_one(dict(item), data, places) for item in error.errors(include_url=False) if item["type"] not in _SILENT]
    found.sort(key=lambda one: _line(one.place))
    first = found[0]
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return CaseError(first.message + more, first.key, first.place)


def _line(place: str) -> int:
    number = place.rpartition(":")[2]
    return int(number) if number.isdigit() else 0


def _one(item: dict[str, Any], data: Any, places: Places) -> CaseError:
    context = item.get("ctx", {})
    key, value, present = _follow((*item["loc"], *context.get("key", ())), data)
    message = _WORDS.get(item["type"], item["msg"])
    show = present and context.get("show_value", True)
    return CaseError(f"{shorten(value)}; {message}" if show else message, key, places.locate(key))


def _follow(location: tuple[str | int, ...], data: Any) -> tuple[KeyPath, Any, bool]:
    """The key as the user wrote it, its raw value, and whether there is one.

    Parts that only the resolved case has are dropped: `[key]` (pydantic's mark of a bad name) and the key that a short
    form stands for.
    """
    key: KeyPath = ()
    value, present = data, True
    for part in location:
        if part == "[key]":
            return key, key[-1], True
        if isinstance(part, str) and present and not isinstance(value, dict | None):
            continue
        key = (*key, part)
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            value, present = None, False
    return key, value, present
