"""Scenes that several tests use."""

from __future__ import annotations

from pathlib import Path

import pytest

TINY = """
name: tiny
outline:
  unit: cm
  wall: [[6, 10], [6, 0]]
material:
  density: 2000 kg/m^3
  size: {diameter: 2 cm}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 1 kg/s
model: dem
dem: {max_time: 1.2 s, plate_speed: 0.03 m/s, start_speed: 0.03 m/s, ranks: 1, reservoir_height: 8 cm}
homogenize: {start: 0.4 s, method: gaussian}
figures: []
export: [comsol]
"""


@pytest.fixture(scope="session")
def tiny_text() -> str:
    """Case of a short cylinder with a few hundred spheres: a DEM run of some seconds."""
    return TINY


@pytest.fixture
def tiny(tmp_path: Path, tiny_text: str) -> Path:
    """That case in a file of its own."""
    path = tmp_path / "tiny.yaml"
    path.write_text(tiny_text)
    return path


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="write the pinned figures of tests/regression anew")
    parser.addoption("--inputs", type=int, default=800, help="damaged inputs for each reader in tests/fuzz")


@pytest.fixture
def fuzz_inputs(request: pytest.FixtureRequest) -> int:
    """How many damaged inputs each reader gets."""
    return int(request.config.getoption("--inputs"))
