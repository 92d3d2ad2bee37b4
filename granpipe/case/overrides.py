"""``--set dotted.key=value`` on the plain data of a case."""

from __future__ import annotations

from typing import Any

from granpipe.case.yamlfile import Places, parse_value
from granpipe.errors import CaseError

SOURCE = "--set"


def override(data: dict[str, Any], places: Places, dotted: str, text: str) -> None:
    """Set one key of `data` to the value that the YAML text says; missing groups are made.

    Raises
    ------
    CaseError : the key is not dotted text, or passes through a single value
    """
    path = tuple(dotted.split("."))
    if not all(path):
        raise CaseError(f"`{dotted}` is not a dotted key such as dem.seed", place=SOURCE)
    value, found = parse_value(text, SOURCE, path)
    group: dict[str, Any] = data
    for depth, part in enumerate(path[:-1], start=1):
        places.known.setdefault(path[:depth], SOURCE)
        group = _group_below(group, part, path[:depth])
    group[path[-1]] = value
    places.replace(path, found)


def _group_below(group: dict[str, Any], part: str, path: tuple[str, ...]) -> dict[str, Any]:
    below = group.get(part)
    if isinstance(below, list) and path[:-1] == ("outline", "sections"):  # the short form of a section
        below = {"z": below}
    if below is None:
        below = {}
    if not isinstance(below, dict):
        raise CaseError("is a single value in the case, not a group of keys", path, SOURCE)
    group[part] = below
    return below
