"""`material.name`: values of a material from the library, each with its source.

Only values with a source are used. What is typical but has no source is shown, and the case must give it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from granpipe.case.values import did_you_mean
from granpipe.case.yamlfile import Places
from granpipe.errors import CaseError

MaterialName = Literal[
    "coke",
    "iron ore pellets",
    "sinter",
    "lime",
    "quartz sand",
    "glass beads",
    "steel balls",
    "wheat",
    "soybeans",
    "plastic pellets",
    "graphite pebbles",
]

NEEDED = ("material.density", "contact.friction", "contact.rolling_friction", "contact.restitution")
"""Keys without which a material is not described: a default of the case would be that of another material."""

_FILE = Path(__file__).with_name("materials.json")
_KEY = ("material", "name")


@dataclass(frozen=True)
class LibraryMaterial:
    """A material.

    Parameters
    ----------
    values : key of the case → value and name of its source
    shown : figures for the reader, which no key of the case takes from here → value and name of its source
    typical : key of the case, or a figure → range without a source, never used
    """

    values: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    shown: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    typical: Mapping[str, str] = field(default_factory=dict)


@cache
def library() -> dict[str, LibraryMaterial]:
    """The materials by name."""
    return {name: LibraryMaterial(**one) for name, one in _data()["materials"].items()}


def sources() -> dict[str, str]:
    """Short name of a source → where to find it."""
    return dict(_data()["sources"])


def with_material(data: dict[str, Any], places: Places) -> tuple[str, ...]:
    """Put the library's values where the case gives none; each of them with its source, in words.

    `data` is changed. A name that is not even text is left to the schema.

    Raises
    ------
    CaseError : there is no such material, or the library has no value with a source for a key that the material
        needs, and the case gives none
    """
    material = data.get("material")
    name = material.get("name") if isinstance(material, dict) else None
    if not isinstance(name, str):
        return ()
    if name not in library():
        message = f"{name}: not in the library; {did_you_mean(name, library())}"
        raise CaseError(message, _KEY, places.locate(_KEY))
    known, taken = library()[name], []
    for dotted, (value, source) in known.values.items():
        group, key = dotted.split(".")
        keys = data.get(group)
        if keys is None:
            keys = data[group] = {}
        if isinstance(keys, dict) and keys.get(key) is None:
            keys[key] = value
            places.known.setdefault((group, key), places.locate(_KEY))
            taken.append(f"{dotted}: {value}, of {name} in the library ({source})")
    missing = [dotted for dotted in NEEDED if not _given(data, dotted)]
    if missing:
        hints = [f"{dotted} (typical {known.typical[dotted]}, no source)" for dotted in missing]
        raise CaseError(
            f"{name}: the library has no value with a source for {', '.join(hints)}; give it in the case",
            _KEY,
            places.locate(_KEY),
        )
    return tuple(taken)


def library_text() -> str:
    """All materials with their values and sources, for the terminal."""
    lines = [line for name, one in library().items() for line in (f"{name}:", *_lines(one))]
    return "\n".join([*lines, "", "sources:", *(f"  {short}: {whole}" for short, whole in sources().items())])


def _lines(one: LibraryMaterial) -> Iterator[str]:
    for key, (value, source) in one.values.items():
        yield f"  {key}: {value}  ({source})"
    for name, (value, source) in one.shown.items():
        yield f"  {name}: {value}  ({source}; not used)"
    for name, value in one.typical.items():
        yield f"  {name}: {value}  (typical, no source; {'give it in the case' if name in NEEDED else 'not used'})"


def _given(data: dict[str, Any], dotted: str) -> bool:
    """Whether the case has the key, or a group that the schema refuses; without rolling its friction is not needed."""
    group, key = dotted.split(".")
    keys = data.get(group)
    if keys is not None and not isinstance(keys, dict):
        return True
    keys = keys or {}
    return keys.get(key) is not None or (key == "rolling_friction" and keys.get("rolling_model") == "none")


@cache
def _data() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(_FILE.read_text(encoding="utf-8"))
    return found
