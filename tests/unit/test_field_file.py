"""`field.npz` of strangers: what granpipe cannot have written is refused, in little memory, before it is used."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fakes.synthetic import field_of, pipe

from granpipe.errors import DataError
from granpipe.field import Field

FIELD = field_of(pipe(), 0.1)
Arrays = dict[str, Any]


@pytest.fixture
def stored(tmp_path: Path) -> Arrays:
    """The arrays of a good file."""
    FIELD.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as data:
        return dict(data)


def load(arrays: Arrays, tmp_path: Path) -> Field:
    np.savez(tmp_path / "field.npz", **arrays)
    return Field.load(tmp_path / "field.npz")


def with_value(name: str, index: tuple[int, ...], value: float) -> Callable[[Arrays], Arrays]:
    def change(arrays: Arrays) -> Arrays:
        array = arrays[name].astype(float)
        array[index] = value
        return arrays | {name: array}

    return change


def test_what_was_saved_is_loaded(stored: Arrays, tmp_path: Path) -> None:
    loaded = load(stored, tmp_path)
    assert loaded.grid.shape == FIELD.grid.shape
    assert np.array_equal(loaded.flux_z, FIELD.flux_z)
    assert (loaded.bulk_flow, loaded.bulk_packing) == (FIELD.bulk_flow, FIELD.bulk_packing)


WRONG: dict[str, tuple[str, Callable[[Arrays], Arrays]]] = {
    "another version": ("run again", lambda a: a | {"format_version": np.array(2)}),
    "a version that is text": ("format_version", lambda a: a | {"format_version": np.array("1")}),
    "no version": ("format_version", lambda a: {k: v for k, v in a.items() if k != "format_version"}),
    "no flux": ("flux_z", lambda a: {k: v for k, v in a.items() if k != "flux_z"}),
    "no edges": ("z_edges", lambda a: {k: v for k, v in a.items() if k != "z_edges"}),
    "edges that fall": ("z edges", lambda a: a | {"z_edges": a["z_edges"][::-1]}),
    "edges that jump": ("z edges", with_value("z_edges", (1,), 1e-4)),
    "edges that are not finite": ("r edges", with_value("r_edges", (-1,), np.inf)),
    "a grid beside the axis": ("first one on the axis", lambda a: a | {"r_edges": a["r_edges"] + 0.1}),
    "cells that are no squares": ("squares", lambda a: a | {"r_edges": 2 * a["r_edges"]}),
    "edges of another grid": ("not an array", lambda a: a | {"z_edges": a["z_edges"][:-1]}),
    "edges in two dimensions": ("r edges", lambda a: a | {"r_edges": a["r_edges"][None]}),
    "a flux with its rows as columns": ("not an array", lambda a: a | {"flux_r": a["flux_r"].T}),
    "a flux in whole numbers": ("not an array", lambda a: a | {"flux_r": a["flux_r"].astype(int)}),
    "a flux of one number": ("not an array", lambda a: a | {"flux_z": np.array(1.0)}),
    "nan in a flux": ("flux_z is not between", with_value("flux_z", (3, 2), np.nan)),
    "inf in a flux": ("flux_r is not between", with_value("flux_r", (3, 2), np.inf)),
    "a packing above 1": ("inside_fraction is not between", with_value("inside_fraction", (0, 0), 1.01)),
    "a mask of numbers": ("bulk is not an array", lambda a: a | {"bulk": a["bulk"].astype(float)}),
    "no packing": ("bulk_packing is 0", lambda a: a | {"bulk_packing": np.array(0.0)}),
    "a scale below 0": ("flow_scale is -1", lambda a: a | {"flow_scale": np.array(-1.0)}),
    "a flow of nan": ("bulk_flow is nan", lambda a: a | {"bulk_flow": np.array(np.nan)}),
    "a flow upwards": ("by bulk_flow", lambda a: a | {"bulk_flow": -a["bulk_flow"]}),
    "a flow a tenth too large": ("by bulk_flow", lambda a: a | {"bulk_flow": 1.1 * a["bulk_flow"]}),
    "ψ of another flow": ("stream function", lambda a: a | {"psi": 1.01 * field_psi(a)}),
    "ψ with a constant added": ("psi is not 0 on the axis", lambda a: a | {"psi": field_psi(a) + 1e-3}),
    "bulk nowhere": ("bulk is nowhere", lambda a: a | {"bulk": np.zeros_like(a["bulk"])}),
    "bulk outside the vessel": ("outside the vessel", with_value("inside_fraction", (3, 0), 0.0)),
    "an error along r alone": ("one is missing", lambda a: a | {"flux_r_se": np.zeros_like(a["flux_r"])}),
    "a raw flux along z alone": ("one is missing", lambda a: a | {"raw_flux_z": a["flux_z"]}),
    "what is no part of a field": ("no part of a field", lambda a: a | {"save": np.ones(3)}),
    "a path for a name": ("no part of a field", lambda a: a | {"../x": np.ones(3)}),
    "an error below 0": ("flux_z_se is not between", lambda a: a | {"flux_z_se": -np.ones_like(a["flux_z"])}),
    "a velocity of another grid": ("particle_u", lambda a: a | {"particle_u": np.ones((2, 2))}),
    "walls without names": ("wall_surface is missing", lambda a: a | {"wall_ends": np.ones((3, 2, 2))}),
    "fewer names than walls": (
        "has the shape",
        lambda a: a | {"wall_ends": np.ones((3, 2, 2)), "wall_surface": np.array(["wall"])},
    ),
    "a formula for a name": ("more than names", lambda a: a | {"wall_surface": np.array(["=cmd|' /C calc'!A0"])}),
    "times that are not finite": ("residence_w", lambda a: a | {"residence_within": np.full(2, np.nan)}),
    "objects": ("a kind that granpipe does not write", lambda a: a | {"psi": np.array([{}, 1], dtype=object)}),
    "complex numbers": ("a kind that granpipe does not write", lambda a: a | {"flux_r": a["flux_r"] + 1j}),
    "the other byte order": ("a kind that", lambda a: a | {"flux_r": a["flux_r"].astype(">f8")}),
}  # fmt: skip


def field_psi(arrays: Arrays) -> np.ndarray:
    """ψ of a uniform flow with the field's own total."""
    rows, radius = len(arrays["z_edges"]), arrays["r_edges"]
    total = float(arrays["bulk_flow"] * arrays["bulk_packing"])
    return np.tile(-total / (2 * np.pi) * radius**2 / radius[-1] ** 2, (rows, 1))


@pytest.mark.parametrize(("message", "change"), WRONG.values(), ids=WRONG.keys())
def test_refused(message: str, change: Callable[[Arrays], Arrays], stored: Arrays, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        load(change(stored), tmp_path)


def test_a_wrong_field_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="flux_z is not between"):
        replace(FIELD, flux_z=FIELD.flux_z * np.nan).save(tmp_path / "field.npz")
    assert not (tmp_path / "field.npz").exists()


def archive(path: Path, header: str, data: bytes, entries: int = 1) -> None:
    """A file of arrays with this header."""
    raw = header.encode() + b"\n"
    whole = b"\x93NUMPY\x01\x00" + len(raw).to_bytes(2, "little") + raw + data
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as zipped:
        for number in range(entries):
            zipped.writestr(f"a{number}.npy", whole)


@pytest.mark.parametrize(
    ("shape", "entries", "message"),
    [
        ("(1000000000,)", 1, "data of another length"),
        ("(-8,)", 1, "kind"),
        ("(" * 3000 + ")" * 3000, 1, "kind"),
        ("(8,)", 101, "more than it can hold"),
    ],
)
def test_headers_that_lie_are_not_believed(shape: str, entries: int, message: str, tmp_path: Path) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    archive(tmp_path / "field.npz", header, b"\0" * 64, entries)
    with pytest.raises(DataError, match=message):
        Field.load(tmp_path / "field.npz")


def test_a_bomb_is_not_decompressed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granpipe.system.npzfile.MOST_BYTES", 1_000_000)
    archive(tmp_path / "field.npz", "{'descr': '<f8', 'fortran_order': False, 'shape': (200000,), }", b"\0" * 1_600_000)
    assert (tmp_path / "field.npz").stat().st_size < 3000
    with pytest.raises(DataError, match="more than it can hold"):
        Field.load(tmp_path / "field.npz")


def test_a_file_cut_at_any_place_is_refused(stored: Arrays, tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, **stored)
    whole = buffer.getvalue()
    for length in range(0, len(whole), 4999):
        (tmp_path / "field.npz").write_bytes(whole[:length])
        with pytest.raises(DataError):
            Field.load(tmp_path / "field.npz")


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, message in ((tmp_path / "pipe", "a pipe"), (Path("/dev/zero"), "a device"), (tmp_path, "a folder")):
        with pytest.raises(DataError, match=message):
            Field.load(path)
    with pytest.raises(DataError, match="file not found; pass the results folder of a completed run"):
        Field.load(tmp_path / "nothing.npz")
