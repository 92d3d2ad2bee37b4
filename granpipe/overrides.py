"""``--set dotted.key=value`` on the plain data of a case."""

from __future__ import annotations

from typing import Any

from granpipe.errors import CaseError
from granpipe.yamlfile import Places, parse_value


def override(data: dict[str, Any], places: Places, dotted: str, text: str) -> None:
    """Set one key of `data` to the value that the YAML text says; groups on the way are made where missing."""
    place = "--set"
    path = tuple(dotted.split("."))
    if not all(path):
        raise CaseError(f"`{dotted}` is not a dotted key such as dem.seed", place=place)
    value, found = parse_value(text, place, path)
    group: dict[str, Any] = data
    for depth, part in enumerate(path[:-1], start=1):
        group = _group_below(group, part, path[:depth], place)
    group[path[-1]] = value
    for key in [key for key in places.known if key[: len(path)] == path]:
        del places.known[key]
    places.known |= found.known


def _group_below(group: dict[str, Any], part: str, path: tuple[str, ...], place: str) -> dict[str, Any]:
    below = group.get(part)
    if isinstance(below, list) and path[:-1] == ("outline", "sections"):  # the short form of a section
        below = {"z": below}
    if below is None:
        below = {}
    if not isinstance(below, dict):
        raise CaseError("is a single value in the case, not a group of keys", path, place)
    group[part] = below
    return below
