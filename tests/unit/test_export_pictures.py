"""What the pictures show: units, ranges of colours and scales, names of sections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.synthetic import FLOW, SCALE, field_of, pipe, ring_vessel

from granpipe.errors import DataError
from granpipe.export.nodes import nodal_values
from granpipe.export.pictures import draw_panel, flow_range, flow_text, overview, packing_range, readable_unit


@pytest.mark.parametrize(
    ("speed", "unit"),
    [(3.0, "m/s"), (0.05, "mm/s"), (6.7e-4, "m/h"), (6.6e-5, "mm/h"), (1e-12, "mm/h"), (0.0, "mm/h")],
)
def test_speeds_get_a_unit_in_which_they_are_at_least_one_where_there_is_one(speed: float, unit: str) -> None:
    chosen, factor = readable_unit(speed)
    assert chosen == unit
    seconds = {"s": 1, "h": 3600}[unit[-1]]
    length = {"m": 1, "mm": 1000}[unit.split("/")[0]]
    assert factor == seconds * length


@pytest.mark.parametrize(
    ("flow", "text"),
    [(2.0, "2 m³/s"), (1 / 3600, "1 m³/h"), (5e-3 / 3600, "5 l/h"), (1e-9, "0.0036 l/h")],
)
def test_flow_rates_get_a_readable_unit(flow: float, text: str) -> None:
    assert flow_text(flow) == text


def test_one_noisy_cell_on_the_axis_does_not_take_the_colours_of_the_packing() -> None:
    field = field_of(pipe(), 0.02)
    cells = nodal_values(field).cells
    noisy = np.where(cells, 0.6, 0.0)
    noisy[:, 0] = 1.0  # the whole column on the axis: 1/625 of the volume
    assert packing_range(replace(field, packing_fraction=noisy), cells) == 0.65
    dense = np.where(cells, 0.7, 0.0)  # crushed soft particles are shown as they are
    assert packing_range(replace(field, packing_fraction=dense), cells) == pytest.approx(0.7)


def test_the_flow_through_levels_is_drawn_on_the_scale_of_the_data() -> None:
    low, high = flow_range(np.array([98.0, 103.0]))
    assert (low, high) == pytest.approx((97.6, 103.4))
    low, high = flow_range(np.array([100.0, 100.001]))
    assert low < 99.5 < 100.5 < high  # rounding is not blown up
    assert flow_range(np.array([20.0]))[0] < 20


def test_sections_title_and_units_are_on_the_overview() -> None:
    vessel = ring_vessel()
    sections = {"top": (2.0, 1.0), "b": (1.0, 0.0)}
    figure = overview(field_of(vessel, 0.05), vessel.wall, vessel.obstacles, sections, "silo: 1 m³/h of bulk")
    assert [text.get_text() for text in figure.texts] == ["silo: 1 m³/h of bulk"]
    first, *others = figure.axes[:4]
    names = {text.get_text(): text.xy[1] for text in first.texts}
    assert names == {"top": 1.5, "b": 0.5}
    assert not any(axis.texts for axis in others)
    assert first.get_ylabel() == "z [m]"
    assert {axis.get_xlabel() for axis in figure.axes[:4]} == {"r [m]"}
    heads = [bar.get_title() for axis in figure.axes for bar in axis.child_axes]
    assert [head for head in heads if "[" in head] == ["radial velocity [mm/s]", "vertical velocity [mm/s]"]
    assert len(first.get_yticks()) >= 8


def test_velocities_are_those_of_the_process() -> None:
    field = field_of(pipe(), 0.05)
    axis = overview(field, pipe().wall, {}).axes[2]
    (mesh,) = (one for one in axis.collections if one.get_array() is not None)
    plug = SCALE * FLOW / (np.pi * 0.5**2)
    assert mesh.get_array().min() == pytest.approx(-plug * 3.6e6, rel=0.01)  # drawn in mm/h


def test_a_field_without_errors_has_no_map_of_them() -> None:
    from matplotlib.figure import Figure

    with pytest.raises(DataError, match="not have standard errors"):
        draw_panel(Figure().add_subplot(), field_of(pipe(), 0.1), "error", pipe().wall, {})


def test_the_map_of_errors_shows_the_standard_error_of_the_bulk_velocity() -> None:
    from matplotlib.figure import Figure

    field = field_of(pipe(), 0.05)
    field = replace(field, flux_r_se=np.zeros_like(field.flux_r), flux_z_se=np.full_like(field.flux_z, 0.002))
    axis = Figure().add_subplot()
    draw_panel(axis, field, "error", pipe().wall, {})
    (mesh,) = (one for one in axis.collections if one.get_array() is not None)
    expected = 0.002 * field.velocity_scale
    unit = axis.child_axes[0].get_title()
    factor = {"standard error [mm/h]": 3.6e6, "standard error [m/h]": 3600.0}[unit]
    assert np.median(mesh.get_array()) == pytest.approx(expected * factor, rel=1e-6)
