"""What a case asks for beside the field, on the real LIGGGHTS: a column that sinks as a plug on its plate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case.reader import read_case
from granpipe.field import Field
from granpipe.pipeline.run import run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts

RADIUS, SPEED, DENSITY, WALL_FRICTION = 0.08, 0.04, 2000.0, 0.2
DIAMETER = 0.019  # of the particles, about

CASE = f"""
name: column
outline:
  unit: cm
  wall: [[8, 50], [8, 0]]
material:
  density: {DENSITY} kg/m^3
  size: {{diameter: {{sieve: {{edges: [17 mm, 19 mm, 21 mm], fractions: [40 %, 60 %]}}}}, by: mass}}
contact: {{friction: 0.5, rolling_friction: 0.1, wall: {{friction: {WALL_FRICTION}}}}}
flow_rate: 1 kg/s
model: dem
dem: {{max_time: 1.6 s, plate_speed: {SPEED} m/s, ranks: 1, reservoir_height: 8 cm}}
homogenize:
  start: 0.5 s
  fields: [particle_velocity, size_classes, wall_slip, wall_pressure, residence_time, stress, granular_temperature,
    coordination, mixing, strain_rate, age]
figures: []
export: [vtk]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results folder of the column."""
    folder = tmp_path_factory.mktemp("column")
    (folder / "column.yaml").write_text(CASE)
    run_case(read_case(folder / "column.yaml"), folder / "results", Silent())
    return folder / "results" / "column"


@pytest.fixture(scope="module")
def field(results: Path) -> Field:
    return Field.load(results / "field.npz")


def figures(results: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((results / "provenance.json").read_text())["figures"]
    return data


def heights(field: Field) -> np.ndarray[Any, Any]:
    return np.asarray(field.extra["wall_ends"][:, :, 1].mean(axis=1))


def test_pressure_saturates_at_what_friction_bears(field: Field) -> None:
    """Deep in a column friction bears all the weight: 2πR μ p = ρ_b g πR², whatever the ratio of stresses (Janssen)."""
    z, pressure = heights(field), field.extra["wall_pressure"]
    limit = field.bulk_packing * DENSITY * 9.81 * RADIUS / (2 * WALL_FRICTION)
    # p = limit (1 − e^(−2μK depth/R)) below the free surface; three seeds gave K of 0.65 to 0.83 in the middle third
    depth = 0.58 - z
    lowest = z < 0.12  # where it is 0.85 of the limit with that K
    deep = limit * (1 - np.exp(-2 * WALL_FRICTION * 0.74 * depth / RADIUS))
    assert np.mean(pressure[lowest]) == pytest.approx(np.mean(deep[lowest]), rel=0.2)
    low, high = (limit * (1 - np.exp(-2 * WALL_FRICTION * K * depth / RADIUS)) for K in (0.3, 0.8))
    thirds = [np.mean([p[(z > a) & (z <= a + 0.16)] for p in (low, pressure, high)], axis=1) for a in (0.16, 0.32)]
    for below, measured, above in thirds:
        assert 0.9 * below < measured < 1.1 * above


def test_pressure_has_a_standard_error_of_its_own_size(field: Field) -> None:
    pressure, error = field.extra["wall_pressure"], field.extra["wall_pressure_se"]
    assert 0.005 < np.median(error / pressure) < 0.3


def test_a_plug_slides_along_the_wall_as_fast_as_its_plate(field: Field) -> None:
    inner = (heights(field) > 0.05) & (heights(field) < 0.4)
    assert field.extra["wall_slip"][inner] == pytest.approx(SPEED, rel=0.05)
    contact = field.extra["wall_contact"][inner]
    assert contact.min() > 0.3
    assert contact.max() < 0.9  # spheres side by side cover π/√12 at the most


def test_size_classes_are_those_of_the_case(field: Field) -> None:
    volume = (field.extra["class_packing"] * field.grid.cell_volume).sum(axis=(1, 2))
    assert volume / volume.sum() == pytest.approx([0.4, 0.6], abs=0.05)
    whole = (field.packing_fraction * field.grid.cell_volume).sum()  # type: ignore[operator]
    assert volume.sum() == pytest.approx(whole, rel=1e-9)
    sauter = field.extra["sauter_diameter"]
    assert sauter[sauter > 0].min() >= field.extra["class_diameter"].min() * (1 - 1e-9)
    assert sauter.max() <= field.extra["class_diameter"].max() * (1 + 1e-9)


def middle(field: Field) -> np.ndarray[Any, Any]:
    """Cells in the column's middle, more than a window from its ends, its axis and its wall."""
    r, z = np.meshgrid(field.grid.r_centres, field.grid.z_centres)
    return np.asarray((r > 0.02) & (r < 0.06) & (z > 0.05) & (z < 0.4))


def test_contacts_and_walls_bear_the_weight(results: Path) -> None:
    """div σ + ρg = 0, from bottom to top; the walls bear most of it in a column as slender as this."""
    forces = figures(results)["forces"]
    assert abs(forces["imbalance"]) < 0.05
    assert 0.5 < forces["by_walls"] < 1.0
    assert forces["agitation"] < 0.02


def test_vertical_stress_is_weight_less_what_friction_bears(field: Field) -> None:
    """Level by level: A σ_zz grows with depth by the weight, less μ_w times the wall pressure (which slides)."""
    grid, z = field.grid, field.grid.z_centres
    stress = field.extra["stress_zz"] @ grid.ring_area
    weight = (field.packing_fraction @ grid.ring_area) * DENSITY * 9.81  # type: ignore[operator]
    pressure = np.interp(z, heights(field)[::-1], field.extra["wall_pressure"][::-1])
    support = WALL_FRICTION * pressure * 2 * np.pi * RADIUS
    low, high = (int(np.argmin(np.abs(z - at))) for at in (0.08, 0.4))
    borne = (weight - support)[low:high].sum() * grid.cell
    assert stress[low] - stress[high] == pytest.approx(borne, abs=0.1 * weight[low:high].sum() * grid.cell)


def test_stress_at_the_wall_is_the_pressure_on_it(field: Field) -> None:
    """σ_rr of the outermost window, which is 1.5 diameters wide, against the forces on the wall itself."""
    rows = (field.grid.z_centres > 0.08) & (field.grid.z_centres < 0.4)
    own = field.extra["stress_rr"][rows, -1].mean()
    on_wall = field.extra["wall_pressure"][(heights(field) > 0.08) & (heights(field) < 0.4)].mean()
    assert own == pytest.approx(on_wall, rel=0.15)
    assert field.extra["pressure"] == pytest.approx(
        sum(field.extra[f"stress_{one}"] for one in ("rr", "tt", "zz")) / 3, abs=1e-9
    )


def test_a_plug_is_hardly_sheared_and_its_particles_hardly_stir(field: Field) -> None:
    """Its speed changes by less than a fiftieth over a diameter, also in the layers along the wall."""
    rows = (field.grid.z_centres > 0.05) & (field.grid.z_centres < 0.4)
    sheared = np.nanmedian(field.extra["shear_rate"][rows, :-1], axis=0)  # a wall cuts the last cell
    assert sheared.max() < 0.02 * SPEED / DIAMETER
    assert 0 < np.sqrt(np.nanmedian(field.extra["granular_temperature"][middle(field)])) < SPEED


def test_spheres_with_friction_touch_four_to_six_others(field: Field) -> None:
    """Between the isostatic numbers with friction, 4, and without, 6, and a little more for softness."""
    inside = middle(field)
    assert 4 < np.nanmean(field.extra["mechanical_coordination"][inside]) < 6.5
    assert np.nanmean(field.extra["rattlers"][inside]) < 0.15


def test_sizes_that_were_filled_at_random_are_mixed(results: Path, field: Field) -> None:
    assert figures(results)["mixing_index"] == pytest.approx(1, abs=0.15)
    assert np.nanmean(field.extra["mixing_index"]) == pytest.approx(1, abs=0.15)


def test_age_in_a_plug_is_depth_over_speed(field: Field) -> None:
    inside = middle(field)
    _, z = np.meshgrid(field.grid.r_centres, field.grid.z_centres)
    age = field.extra["age"]
    assert np.nanmedian(age[inside] * SPEED / (0.5 - z[inside])) == pytest.approx(1, abs=0.05)


def test_particles_of_the_plug_move_with_the_plate(field: Field) -> None:
    w = field.extra["particle_w"][10:60, :5]
    assert np.mean(w) == pytest.approx(-SPEED, rel=0.05)


def test_the_plug_stays_as_long_as_it_is_high(results: Path, field: Field) -> None:
    expected = 0.5 / SPEED / field.flow_scale
    assert figures(results)["residence_time_s"]["P50"] == pytest.approx(expected, rel=0.05)
    assert {"wall.csv", "residence_time.csv", "field.vtu"} <= {path.name for path in results.iterdir()}
