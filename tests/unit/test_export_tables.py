"""What a case asks for beside the field, in its tables, in field.vtu, and in the plan."""

import csv
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from fakes.synthetic import PACKING, SCALE, field_of, hopper, pipe

from granpipe.case.reader import load_case
from granpipe.errors import CaseError
from granpipe.export.tables import write_tables
from granpipe.export.vtk import write_vtu
from granpipe.pipeline.extra_fields import ExtraSums, particle_velocity, with_derived
from granpipe.planning.make import make_plan
from granpipe.planning.submodel import sub_case

ROOT = Path(__file__).parents[2]


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_wall_table_is_at_the_flow_rate_of_the_case(tmp_path):
    extra = {
        "wall_surface": np.array(["wall", "ring"]),
        "wall_ends": np.array([[[0.5, 1.0], [0.5, 0.9]], [[0.2, 0.4], [0.3, 0.4]]]),
        "wall_slip": np.array([0.2, 0.0]),
        "wall_slip_se": np.array([0.01, 0.0]),
        "wall_pressure": np.array([1500.0, 200.0]),
    }
    write_tables(replace(field_of(pipe(), 0.1), extra=extra), tmp_path)
    first, second = rows(tmp_path / "wall.csv")
    assert (first["surface"], second["surface"]) == ("wall", "ring")
    assert float(first["slip_m_per_s"]) == pytest.approx(0.2 * SCALE)
    assert float(first["slip_m_per_s_standard_error"]) == pytest.approx(0.01 * SCALE)
    assert float(first["pressure_pa"]) == 1500
    assert [float(second[name]) for name in ("r_m", "z_m", "length_m")] == pytest.approx([0.25, 0.4, 0.1])
    assert not (tmp_path / "residence_time.csv").exists()


def test_the_residence_table_holds_both_curves(tmp_path):
    field, figures = with_derived(field_of(pipe(1.0), 0.02), ["residence_time"])
    write_tables(field, tmp_path)
    table = rows(tmp_path / "residence_time.csv")
    time = np.array([float(row["time_s"]) for row in table])
    assert float(table[0]["flow_between_axis_and_streamline"]) < 0.01
    assert np.sort(time) == pytest.approx([float(row["its_time_s"]) for row in table])
    middle = np.interp(0.5, [float(row["flow_that_is_faster"]) for row in table], np.sort(time))
    assert middle == pytest.approx(figures["residence_time_s"]["P50"], rel=1e-6)
    mean = np.pi * 0.5**2 / (0.02 * SCALE)  # volume over flow rate
    assert figures["residence_time_s"]["P50"] == pytest.approx(mean / (2 * np.sqrt(0.5)), rel=0.02)
    assert not (tmp_path / "wall.csv").exists()


def test_particle_velocity_is_flux_over_packing_up_to_a_wall_that_cuts_cells():
    field = field_of(hopper(), 0.02)
    u, w = particle_velocity(field)
    r, z = np.meshgrid(field.grid.r_centres, field.grid.z_centres)
    exact = np.array(hopper().bulk_velocity(r, z)) / SCALE
    whole = field.inside_fraction == 1
    assert np.abs(w - exact[1])[whole].max() < 0.02 * np.abs(exact[1]).max()
    assert np.abs(u - exact[0])[whole].max() < 0.02 * np.abs(exact[1]).max()
    looser = replace(field, packing_fraction=0.5 * field.packing_fraction)
    assert np.allclose(particle_velocity(looser)[1], 2 * w)


def test_cells_in_the_vtu_hold_what_is_asked_for(tmp_path):
    field = field_of(pipe(), 0.1)
    field, _ = with_derived(field, ["particle_velocity"])
    share = np.array([0.3, 0.7])[:, None, None] * PACKING * field.bulk
    field = replace(field, extra=field.extra | {"class_packing": share, "class_diameter": np.array([0.01, 0.02])})
    write_vtu(field, tmp_path / "field.vtu")
    data = meshio.read(tmp_path / "field.vtu").cell_data
    assert data["class_packing_2"][0] == pytest.approx(0.7 * PACKING)
    plug = -0.02 * SCALE / (np.pi * 0.5**2)
    assert data["cell_particle_velocity"][0][:, 2] == pytest.approx(plug, rel=1e-6)
    write_vtu(field_of(pipe(), 0.1), tmp_path / "plain.vtu")
    assert not [name for name in meshio.read(tmp_path / "plain.vtu").cell_data if name.startswith(("class", "cell_"))]


def test_a_fluid_leaves_out_what_only_particles_tell():
    case = load_case(
        ROOT / "cases" / "hopper.yaml", {"homogenize.fields": "[wall_slip, residence_time, particle_velocity]"}
    )
    plan = make_plan(case)
    left = {stage.name for stage in plan.left_out}
    assert {"wall_slip", "particle_velocity"} <= left
    assert "residence_time" not in left
    assert "field.npz, residence_time, comsol" in plan.stages[-1].reason


def test_sub_models_of_a_hybrid_collect_nothing_more():
    case = load_case(ROOT / "cases" / "reactor_hybrid.yaml", {"homogenize.fields": "[wall_slip]"})
    plan = make_plan(case)
    assert not [part.case.homogenize.fields for _, part in plan.submodels if part.case.homogenize.fields]
    assert not sub_case(case, plan.submodels[0][0]).homogenize.fields


def test_the_key_of_the_sums_follows_what_is_collected():
    plain, other = (
        make_plan(load_case(ROOT / "cases" / "smoke.yaml", {"homogenize.fields": fields}))
        for fields in ("[residence_time]", "[wall_slip]")
    )
    assert ExtraSums.of(plain).key == {}
    assert not ExtraSums.of(plain).extras
    assert ExtraSums.of(other).key["extra"] == ["wall_slip"]


@pytest.mark.parametrize("name", ["stress", "granular_temperature", "coordination"])
def test_a_fluid_knows_nothing_of_single_particles(name):
    plan = make_plan(load_case(ROOT / "cases" / "hopper.yaml", {"homogenize.fields": f"[{name}, strain_rate, age]"}))
    assert name in {stage.name for stage in plan.left_out}
    assert "field.npz, strain_rate, age, comsol" in plan.stages[-1].reason


def test_mixing_of_one_size_is_refused_before_the_run():
    with pytest.raises(CaseError, match="one size alone"):
        make_plan(load_case(ROOT / "cases" / "smoke.yaml", {"homogenize.fields": "[mixing]"}))


def test_residence_times_need_a_stream_function():
    with pytest.raises(CaseError, match="residence_time follows the stream function"):
        load_case(
            ROOT / "cases" / "smoke.yaml", {"homogenize.method": "gaussian", "homogenize.fields": "[residence_time]"}
        )
