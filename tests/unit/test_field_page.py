"""The page on field.npz lists every key that is written, and no other."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from fakes.synthetic import field_of, pipe

from granpipe.field import _EXTRA, Box, Field

PAGE = Path(__file__).parents[2] / "docs/reference/field.md"
NEVER_NONE = {"grid", "extra"}
WITH_ERRORS = ("wall_contact", "wall_slip", "wall_pressure")


def keys_written(field: Field, path: Path, never: str = "") -> set[str]:
    """Keys of the file of a field in which everything is known but the extra fields that begin with `never`."""
    names = {one.name for one in dataclasses.fields(Field)} - NEVER_NONE
    unknown = {name: np.zeros(1) for name in names if getattr(field, name) is None}
    names_of_extra = [name for name in _EXTRA if not never or not name.startswith(never)]
    extra = {name: np.zeros(1) for name in (*names_of_extra, *(f"{name}_se" for name in WITH_ERRORS))}
    dataclasses.replace(field, **unknown, extra=extra).save(path)
    with np.load(path) as data:
        return set(data.files)


def test_the_page_lists_exactly_the_keys_that_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Field, "check", lambda self: None)  # arrays of one number stand for all
    rings = field_of(pipe(), 0.1)
    box = dataclasses.replace(rings, grid=Box.within((0, 1), (0, 1), (0, 1), 0.5, flat=True, cut=True))
    written = keys_written(rings, tmp_path / "rings.npz") | keys_written(box, tmp_path / "box.npz")
    rows = [line.split("|")[1] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert {key for row in rows for key in re.findall(r"`([a-z_]+)`", row)} == written
