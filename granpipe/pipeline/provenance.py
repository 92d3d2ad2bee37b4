"""Reads ``provenance.json`` of a results folder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from granpipe.errors import DataError
from granpipe.pipeline.gates import Gate
from granpipe.system.jsonfile import read_json
from granpipe.system.manifest import read_manifest, verify

Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Provenance:
    """What a run has left of itself.

    Parameters
    ----------
    case : name of the case
    wall_seconds : what it took
    quality : its gates
    figures : everything measured, by name
    """

    case: str
    wall_seconds: Seconds
    quality: tuple[Gate, ...]
    figures: dict[str, Any]

    @classmethod
    def read(cls, folder: Path) -> Provenance:
        """That of a results folder.

        Raises
        ------
        DataError : there is none, or it is damaged
        """
        return read_json(folder / "provenance.json", cls)

    @classmethod
    def of_point(cls, folder: Path) -> Provenance:
        """That of a point of a sweep, whose case is named as its folder.

        Raises
        ------
        DataError : it is missing, damaged, changed since granpipe wrote it, or that of another point
        """
        verify(folder, "provenance.json")
        found = cls.read(folder)
        if found.case != folder.name:
            raise DataError(f"{folder}: the results of another point, {found.case}; run it again")
        return found

    @property
    def numbers(self) -> Iterator[tuple[str, float]]:
        """Every figure that is a single number; names of groups stand before it, with a dot."""
        return _numbers(self.figures)


def known_gates(folder: Path) -> tuple[Gate, ...] | None:
    """The quality gates of a folder that ``granpipe run``, ``homogenize`` or ``scale`` has written.

    None where it has no ``provenance.json``.

    Raises
    ------
    DataError : they are damaged
    """
    path = folder / "provenance.json"
    return read_json(path, _Quality).quality if path.exists() else None


def verified_gates(folder: Path) -> tuple[Gate, ...]:
    """The same of a folder with a manifest, where they must be as granpipe wrote them; empty where it wrote none.

    Raises
    ------
    DataError : they are missing, damaged or changed, or the manifest is
    """
    if "provenance.json" not in read_manifest(folder):
        return ()
    verify(folder, "provenance.json")
    return known_gates(folder) or ()


@dataclass(frozen=True)
class _Quality:
    quality: tuple[Gate, ...]


@dataclass(frozen=True)
class Origin:
    """Where the results of a case come from, see `results.case_origin`."""

    file: str
    outline: str
    case: str


@dataclass(frozen=True)
class Identity:
    """What tells whether results are those of a case: their key, gates and origin."""

    key: str
    quality: tuple[Gate, ...]
    origin: Origin

    @classmethod
    def read(cls, folder: Path) -> Identity:
        """That of a results folder.

        Raises
        ------
        DataError : there is none, or it is damaged
        """
        return read_json(folder / "provenance.json", cls)


def _numbers(figures: dict[str, Any], above: str = "") -> Iterator[tuple[str, float]]:
    for name, value in figures.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{above}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{above}{name}", value
