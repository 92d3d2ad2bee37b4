"""What a field holds beside its own arrays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from fakes.synthetic import field_of, pipe

from granpipe.field import Field


def test_extra_arrays_come_back_under_their_names(tmp_path: Path) -> None:
    names = np.array(["wall", "ring"])
    field = replace(field_of(pipe(), 0.1), extra={"wall_surface": names, "wall_slip": np.array([0.1, 0.0])})
    field.save(tmp_path / "field.npz")
    loaded = Field.load(tmp_path / "field.npz")
    assert loaded.extra.keys() == field.extra.keys()
    assert loaded.extra["wall_surface"].tolist() == ["wall", "ring"]
    assert np.array_equal(loaded.extra["wall_slip"], [0.1, 0.0])


def test_a_field_without_extra_stores_none(tmp_path: Path) -> None:
    field_of(pipe(), 0.1).save(tmp_path / "field.npz")
    assert not Field.load(tmp_path / "field.npz").extra
