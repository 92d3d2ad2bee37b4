"""The animation of a run: which circles are cut, which layer a particle has, what the clock tells."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from granpipe.export.animation import FED, LAYERS, Frame, animation, clock, cut_circles, layers_of


@dataclass(frozen=True)
class Some:
    """Particles of equal size."""

    id: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray


def some(position: list[tuple[float, float, float]], first: int = 1) -> Some:
    places = np.array(position, dtype=float)
    return Some(np.arange(first, first + len(places)), places, np.zeros_like(places), np.full(len(places), 0.1))


def test_the_cut_through_a_sphere_is_a_circle_of_its_own_radius() -> None:
    centres, radii, numbers = cut_circles(some([(0.3, 0.0, 1.0), (0.0, 0.06, 2.0), (0.0, -0.11, 3.0)]))
    assert numbers.tolist() == [1, 2]
    assert centres.tolist() == [[0.3, 1.0], [0.0, 2.0]]
    assert radii == pytest.approx([0.1, 0.08])


def test_layers_are_of_equal_height_from_the_lowest_to_the_highest() -> None:
    found = layers_of(some([(0, 0, z) for z in np.linspace(-1, 1, 141)]))
    assert found[1] == 0
    assert found[141] == LAYERS - 1
    assert np.bincount(list(found.values())).tolist() == pytest.approx([141 / LAYERS] * LAYERS, abs=1)
    assert set(layers_of(some([(0, 0, 1.0)])).values()) == {0}


@pytest.mark.parametrize(
    ("seconds", "scale", "text"),
    [(3.0, 0.001, "process 50 min 00 s\nsimulation 3.0 s"), (0.0, 1.0, "process 0 s\nsimulation 0.0 s")],
)
def test_the_clock_tells_the_time_of_the_process(seconds: float, scale: float, text: str) -> None:
    assert clock(seconds, scale) == text


def test_an_animation_has_a_picture_for_each_frame(tmp_path: Path) -> None:
    from PIL import Image

    frames = [Frame(0.0, some([(0, 0, 0.2), (0.2, 0, 0.8)])), Frame(1.0, some([(0, 0, 0.1), (0.2, 0, 0.5)], first=2))]
    obstacle = {"ring": [(0.4, 0.4), (0.5, 0.4), (0.5, 0.5)]}
    animation(frames, [(0.5, 1.0), (0.5, 0.0)], obstacle, 0.5, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 2
        image.seek(1)
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}
    fed = tuple(bytes.fromhex(FED[1:]))
    assert any(np.abs(np.subtract(colour, fed)).max() <= 4 for colour in colours)  # number 3 was not there at first
