"""Heat in a flow: the solver against closed forms, and exported files as a program would use them."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest
from fakes.analytic_flow import ConvergingFlow
from fakes.comsol_text import read_sections
from fakes.vessel_mesh import mesh_below
from heat_checks import Velocity, false_source

from granpipe.analysis.heat import HeatProblem, Stream, Temperature, solve_heat
from granpipe.errors import DataError
from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported
from granpipe.field import Field, Grid, flux_from_psi
from granpipe.homogenize.conserve import scale_rows

RADIUS, HEIGHT = 0.5, 1.0
NUSSELT = 3.6568  # of the fully developed laminar flow in a tube with a wall of one temperature (Graetz)


def pipe(cells, height=HEIGHT):
    return mesh_below(lambda z: RADIUS + 0 * z, 0.0, height, cells)


def plug(speed):
    return Stream(lambda r, z: -0.5 * speed * r**2)


def constant(problem, flow):
    """Largest deviation from a feed of temperature 1, where nothing else is held."""
    return np.abs(solve_heat(problem, flow).values - 1).max()


@pytest.mark.parametrize("peclet", [0.5, 20])
def test_plug_flow_between_two_temperatures_converges_to_the_exponential(peclet):
    errors = []
    for cells in (16, 32):
        temperature = solve_heat(HeatProblem(pipe(cells), 1.0, peclet, {"inlet": 1.0, "outlet": 0.0}), plug(1.0))
        exact = np.expm1(-peclet * temperature.mesh.points[:, 1]) / np.expm1(-peclet)
        errors.append(np.abs(temperature.values - exact).max())
    assert errors[-1] < 0.03
    assert np.log2(errors[0] / errors[1]) > 1.6


def test_a_tube_loses_heat_to_its_wall_at_the_rate_of_graetz():
    def mean(temperature, z):
        x, weight = np.polynomial.legendre.leggauss(40)
        r = 0.5 * RADIUS * (x + 1)
        speed = weight * r * (1 - (r / RADIUS) ** 2)
        return speed @ temperature.at(r, np.full_like(r, z)) / speed.sum()

    speed, diffusivity, height = 1.0, 0.005, 30.0
    flow = Stream(lambda r, z: -speed * r**2 * (1 - 0.5 * (r / RADIUS) ** 2))
    errors = []
    for cells in (20, 40):
        problem = HeatProblem(pipe(cells, height), diffusivity, 1.0, {"inlet": 1.0, "wall": 0.0})
        temperature = solve_heat(problem, flow)
        decay = np.log(mean(temperature, 15.0) / mean(temperature, 5.0)) / 10.0
        errors.append(decay * speed * RADIUS**2 / diffusivity / NUSSELT - 1)
        assert temperature.outlet_mean == pytest.approx(mean(temperature, 0.0), rel=1e-2)
    assert abs(errors[1]) < 0.002  # conduction along the tube is part of it
    assert abs(errors[1]) < 0.4 * abs(errors[0])


def test_a_constant_temperature_stays_in_any_stream_function_however_rough():
    """ψ is noise but on axis and walls, where it is only nearly constant."""
    rng = np.random.default_rng(1)
    grid = Grid.covering(RADIUS, 0.0, HEIGHT, 0.05)
    psi = -0.5 * grid.r_edges**2 * (1 + 0.3 * rng.normal(size=(len(grid.z_edges), len(grid.r_edges))))
    psi[:, -1] = -0.5 * RADIUS**2 * (1 + 0.01 * rng.normal(size=len(psi)))
    problem = HeatProblem(pipe(24), 1.0, 1e3, {"inlet": 1.0})
    flow = Stream.on_grid(grid.r_edges, grid.z_edges, psi)
    assert constant(problem, flow) < 1e-9
    assert max(map(abs, false_source(problem.mesh, flow))) < 1e-9


def test_a_flow_that_loses_half_of_itself_on_its_way_is_twice_as_hot_at_its_end():
    flow = Velocity(lambda r, z: (0 * r, -(1 + z)))  # 2 in, 1 out
    problem = HeatProblem(pipe(24), 1e-4, 1.0, {"inlet": 1.0})
    np.testing.assert_allclose(false_source(problem.mesh, flow), [-0.5, 0.5], rtol=1e-12)
    assert solve_heat(problem, flow).outlet_mean == pytest.approx(2.0, rel=0.02)


def test_difference_of_two_temperatures_is_over_the_volume():
    mesh = pipe(40)
    linear = Temperature(mesh, mesh.points[:, 0], 0.0)
    rms, largest = linear.apart(Temperature(mesh, np.zeros(len(mesh.points)), 0.0))
    assert rms == pytest.approx(RADIUS / np.sqrt(2), rel=1e-3)  # ∫ r³ dr / ∫ r dr
    assert largest == RADIUS
    with pytest.raises(DataError, match="different meshes"):
        linear.apart(Temperature(pipe(10), np.zeros(121), 0.0))


def test_a_boundary_that_the_mesh_has_not_is_named():
    with pytest.raises(DataError, match=r"no boundary called 'obstacle'.*300"):
        solve_heat(HeatProblem(pipe(4), 1.0, 1.0, {"obstacle": 300.0}), plug(1.0))


VESSEL = ConvergingFlow(peak=0.5)
NOISE = 0.1


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Read back by name: files of a known flow, of it with noise on ψ, and of it with noise on the flux, rows scaled.

    The second conserves in every cell, the third at every level.
    """
    grid = Grid.covering(VESSEL.upper_radius + 0.03, 0.0, VESSEL.height, 0.025)
    wall = VESSEL.wall(grid.z_edges)[0][:, None]
    rng = np.random.default_rng(2)
    psi = VESSEL.psi(grid.r_edges[None], grid.z_edges[:, None])
    inside = np.clip((wall[1:] + wall[:-1]) / 2 - grid.r_edges[None, :-1], 0, grid.cell) / grid.cell
    flux = flux_from_psi(psi, grid)
    noisy = [part * (1 + NOISE * rng.normal(size=part.shape)) for part in flux]
    scaled = scale_rows(*noisy, grid, VESSEL.solids_flow)
    rough = psi * (1 + NOISE / 4 * np.where(grid.r_edges[None] < wall - grid.cell, rng.normal(size=psi.shape), 0))
    return {
        name: read_back(tmp_path_factory.mktemp("comsol"), grid, inside, *flux, psi)
        for name, flux, psi in (
            ("exact", flux, psi),
            ("rough psi", flux_from_psi(rough, grid), rough),
            ("rows scaled", scaled, None),
        )
    }


def read_back(folder, grid, inside, flux_r, flux_z, psi):
    flow = VESSEL.solids_flow / VESSEL.packing
    field = Field(grid, inside, inside > 0, flux_r, flux_z, flow, VESSEL.packing, 1.0, psi=psi)
    write_comsol(Exported(field, "vessel", 1000.0, datetime(2026, 1, 1)), folder)
    return {path.stem: read_sections(path) for path in folder.glob("*_grid.txt")}


def stream(files):
    (squares, z), psi = map(np.array, files["psi_grid"]["Grid"]), files["psi_grid"]["Data"]
    return Stream.on_grid(np.sqrt(squares), z, psi)


def velocity(files):
    r, z = map(np.array, files["w_grid"]["Grid"])
    return Velocity.on_grid(r, z, files["u_grid"]["Data"], files["w_grid"]["Data"])


@pytest.fixture(scope="module")
def vessel():
    return mesh_below(lambda z: VESSEL.wall(z)[0], 0.0, VESSEL.height, 32)


@pytest.mark.parametrize("name", ["exact", "rough psi"])
def test_exported_psi_keeps_a_constant_temperature(exported, vessel, name):
    assert constant(HeatProblem(vessel, 1.0, 5e5, {"inlet": 1.0}), stream(exported[name])) < 1e-6


def test_scaled_rows_make_heat_of_nothing_where_exported_psi_makes_none(exported, vessel):
    problem = HeatProblem(vessel, 1.0, 5e3, {"inlet": 1.0})
    assert constant(problem, velocity(exported["rows scaled"])) > 0.05
    assert constant(problem, stream(exported["rough psi"])) < 1e-6


def test_exported_psi_heats_a_cold_feed_like_the_flow_that_it_came_from(exported, vessel):
    problem = HeatProblem(vessel, 1.0, 1e3, {"wall": 1.0, "inlet": 0.0})
    packing = VESSEL.packing
    exact = solve_heat(problem, Stream(lambda r, z: VESSEL.psi(r, z) / packing))
    told = solve_heat(problem, stream(exported["exact"]))
    assert 0.3 < exact.outlet_mean < 0.9
    assert told.outlet_mean == pytest.approx(exact.outlet_mean, rel=0.02)
    assert told.apart(exact)[0] < 0.01
