"""Fields in the plane x–z and in space against flows that are known."""

from pathlib import Path

import numpy as np
import pytest
from fakes.plane_flow import DEPTH, NARROW, WIDE, PlaneFlow
from fakes.spheres import Spheres
from scipy.stats import qmc

from granpipe.field import Box, Field, divergence, flux_from_psi, level_flow
from granpipe.homogenize.assemble import raw_field, unguided_plug
from granpipe.homogenize.average import Collector
from granpipe.homogenize.psi_fit import AXIS, WALL, NormalEquations, Weights, node_roles
from granpipe.pipeline.dump_average import Homogenized
from granpipe.pipeline.dump_files import write_homogenized
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.dumps import homogenize_files

SIDE, TALL = (0.0, 0.4), (0.0, 0.5)
PLANE = Box.within(SIDE, (0.0, 0.2), TALL, 0.02, flat=True, cut=False)
ROWS, COLUMNS = PLANE.shape
FLOW = 0.03  # m³/s


# --- flux, bulk velocity, particle velocity ---------------------------------------------------------------------------


def packing(x):
    """From 0.4 to 0.62 across the channel."""
    return 0.4 + 0.22 * x / 0.4


MOTIONS = {
    "shear": lambda x, y, z: (0 * x, 0 * x, -0.1 - 0.5 * x),
    "converging": lambda x, y, z: (-0.3 * (x - 0.2), 0 * x, -0.4 + 0.3 * z),
    "in space": lambda x, y, z: (0.2 * (y - 0.1), 0.1 * (z - 0.2), -0.2 + 0.1 * x),
}


def moving(motion, seed=1, radius=0.004):
    """Small spheres of the packing above that move as told, beyond the ends of the grid too."""
    wide, deep, tall = (-0.02, 0.42), (-0.02, 0.22), (-0.02, 0.52)
    draws = qmc.Sobol(3, rng=seed).random(2**17)
    share = np.linspace(*wide, 500)
    total = np.cumsum(packing(share))
    x = np.interp(draws[:, 0], (total - total[0]) / (total[-1] - total[0]), share)
    place = np.column_stack([x, deep[0] + draws[:, 1] * np.ptp(deep), tall[0] + draws[:, 2] * np.ptp(tall)])
    volume = packing(share).mean() * np.ptp(wide) * np.ptp(deep) * np.ptp(tall)
    radius = (volume / len(place) * 3 / 4 / np.pi) ** (1 / 3)
    velocity = np.column_stack(MOTIONS[motion](*place.T))
    return Spheres(np.arange(len(place)), place, velocity, np.full(len(place), radius))


@pytest.mark.parametrize(("motion", "flat"), [("shear", True), ("converging", True), ("in space", False)])
def test_flux_to_bulk_velocity_to_particle_velocity_and_back(motion, flat):
    grid = Box.within(SIDE, (0.0, 0.2), TALL, 0.02 if flat else 0.05, flat, cut=True)
    collector = Collector(grid)
    collector.add(0.0, moving(motion))
    sums = collector.take()
    field = raw_field(sums, np.ones(grid.shape), unguided_plug(sums), 0.01)
    x, z = np.meshgrid(grid.r_centres, grid.z_centres)
    y = np.full_like(x, 0.1)
    if not flat:
        z, y, x = np.meshgrid(
            grid.z_centres, 0.5 * (grid.y_edges[1:] + grid.y_edges[:-1]), grid.r_centres, indexing="ij"
        )
    exact = MOTIONS[motion](x, y, z)
    centred = [0.5 * (field.flux_r[..., 1:] + field.flux_r[..., :-1]), 0.5 * (field.flux_z[1:] + field.flux_z[:-1])]
    known = [exact[0], exact[2]]
    if not flat:
        centred.append(0.5 * (field.flux_y[:, 1:] + field.flux_y[:, :-1]))
        known.append(exact[1])
    assert np.abs(field.packing_fraction - packing(x)).max() < 0.03
    size = np.sqrt(sum(v**2 for v in known)).max()
    for flux, v in zip(centred, known, strict=True):
        bulk = flux * field.velocity_scale
        particle = bulk * field.bulk_packing / field.packing_fraction
        assert np.abs(particle - v).max() < 0.08 * size
        assert np.sqrt(np.mean((particle - v) ** 2)) < 0.02 * size
        assert np.allclose(particle * field.packing_fraction / field.bulk_packing / field.velocity_scale, flux)


# --- stream function --------------------------------------------------------------------------------------------------


def fitted(flux, bulk=None, length=0.0):
    inside = np.ones(PLANE.shape)
    roles = node_roles(inside, inside > 0 if bulk is None else bulk)
    weights = Weights(np.ones((ROWS, COLUMNS + 1)), np.ones((ROWS + 1, COLUMNS)))
    return NormalEquations(PLANE, roles, weights, 0.0).fit(length).solve(*flux, FLOW), roles


def with_walls(psi):
    psi[:, 0], psi[:, -1] = 0, -FLOW / 0.2
    return psi


def test_a_stream_function_gives_the_flow_per_depth():
    x = PLANE.r_edges
    flux_r, flux_z = flux_from_psi(np.tile(-FLOW / 0.2 * x / 0.4, (ROWS + 1, 1)), PLANE)
    assert np.allclose(flux_z, -FLOW / (0.2 * 0.4), rtol=1e-12)
    assert not flux_r.any()
    assert np.allclose(level_flow(flux_z, PLANE), FLOW, rtol=1e-12)


def test_data_that_have_a_stream_function_give_it_back():
    rng = np.random.default_rng(0)
    psi = with_walls(0.01 * rng.normal(size=(ROWS + 1, COLUMNS + 1)))
    assert np.allclose(fitted(flux_from_psi(psi, PLANE))[0], psi, atol=1e-12)


def test_a_body_in_the_stream_finds_how_much_passes_on_either_side():
    bulk = np.ones(PLANE.shape, dtype=bool)
    bulk[10:14, 8:12] = False
    psi = with_walls(np.tile(-FLOW / 0.2 * PLANE.r_edges / 0.4, (ROWS + 1, 1)))
    roles = node_roles(np.ones(PLANE.shape), bulk)
    psi[roles > WALL] = -0.3 * FLOW / 0.2
    found, _ = fitted(flux_from_psi(psi, PLANE), bulk)
    assert np.allclose(found, psi, atol=1e-12)


def test_a_void_on_the_left_wall_has_its_psi():
    bulk = np.ones(PLANE.shape, dtype=bool)
    bulk[5:12, :6] = False
    rng = np.random.default_rng(1)
    flux = rng.normal(size=(ROWS, COLUMNS + 1)), rng.normal(size=(ROWS + 1, COLUMNS))
    psi, roles = fitted(flux, bulk, 0.03)
    assert (roles[5:13, :7] == AXIS).all()
    flux_r, flux_z = flux_from_psi(psi, PLANE)
    assert not flux_r[5:12, :6].any()
    assert np.abs(divergence(flux_r, flux_z, PLANE)).max() * PLANE.cell < 1e-12 * np.abs(flux_z).max()
    assert np.allclose(level_flow(flux_z, PLANE), FLOW, rtol=1e-12)


@pytest.mark.parametrize("name", ["shear", "converging"])
def test_smoothing_leaves_linear_fields_as_they_are_up_to_the_walls(name):
    x, z = np.meshgrid(PLANE.r_edges / 0.4, PLANE.z_edges)
    psi = -FLOW / 0.2 * {"shear": 0.5 * (x + x**2), "converging": x + 0 * z}[name]
    assert np.allclose(fitted(flux_from_psi(psi, PLANE), length=0.1)[0], psi, atol=1e-13)


# --- dumps ------------------------------------------------------------------------------------------------------------

CHANNEL = PlaneFlow()


@pytest.fixture(scope="module")
def dumps(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """Seventeen snapshots of the channel, 0.1 s apart: up to 0.36 diameters of travel."""
    return CHANNEL.dumps(tmp_path_factory.mktemp("channel"), 0.1, 17)


def averaged(dumps: tuple[Path, ...], **frame) -> Homogenized:
    frame = {"plane": "xz", "cell": 0.02, "z": (0.0, 1.0)} | frame
    return homogenize_files(Request(dumps=dumps, frame=Frame(**frame), time_step=1e-4), None)


@pytest.fixture(scope="module")
def plane(dumps: tuple[Path, ...]) -> Homogenized:
    return averaged(dumps)


def test_the_depth_is_that_of_the_box_and_the_width_that_of_the_particles(plane):
    grid = plane.field.grid
    assert grid.y_edges.tolist() == [0.0, DEPTH]
    assert grid.r_edges[[0, -1]] == pytest.approx([-CHANNEL.radius, WIDE + CHANNEL.radius], abs=0.003)


def test_the_channel_is_sampled_by_displacement_and_carries_its_flow_through_every_level(plane):
    assert plane.sampling.startswith("displacement")
    assert plane.method == "psi"
    flow = level_flow(plane.field.flux_z, plane.field.grid)
    assert np.allclose(flow, CHANNEL.flow * DEPTH, rtol=0.05)
    assert np.allclose(flow, flow[0], rtol=1e-10)
    assert np.abs(divergence(plane.field.flux_r, plane.field.flux_z, plane.field.grid)).max() < 1e-10


def test_away_from_walls_the_fit_is_the_known_flux(plane):
    field: Field = plane.field
    z = field.grid.z_edges[5:-5]
    width, slope = CHANNEL.wall(z)
    x = field.grid.r_centres
    inner = (x > 2 * CHANNEL.radius) & (x < width[:, None] - 3 * CHANNEL.radius)
    exact = np.broadcast_to(-CHANNEL.flow / width[:, None], inner.shape)
    error = (field.flux_z[5:-5] - exact)[inner]
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.abs(exact).mean()
    middle = 0.5 * (field.grid.z_edges[6:-5] + field.grid.z_edges[5:-6])
    width, slope = CHANNEL.wall(middle)
    across = -CHANNEL.flow * field.grid.r_edges * (slope / width**2)[:, None]
    inner = (field.grid.r_edges > 2 * CHANNEL.radius) & (field.grid.r_edges < width[:, None] - 3 * CHANNEL.radius)
    error = (field.flux_r[5:-5] - across)[inner]
    assert np.sqrt(np.mean(error**2)) < 0.05 * CHANNEL.flow / NARROW


def test_standard_errors_are_those_of_a_steady_flow(plane):
    field = plane.field
    inner = np.abs(field.flux_z) > 0.5 * CHANNEL.flow / WIDE
    assert 0 < np.median(field.flux_z_se[inner]) < 0.05 * CHANNEL.flow / NARROW


def test_in_space_the_flow_through_every_level_and_its_balance_are_kept(dumps):
    made = averaged(dumps, plane="xyz", cell=0.05)
    field = made.field
    assert made.method == "plain average"
    assert len(field.grid.shape) == 3
    # particles are cut at the front and back, which they overlap
    assert np.allclose(level_flow(field.flux_z, field.grid), CHANNEL.flow * DEPTH, rtol=0.1)
    flat = averaged(dumps, cell=0.05, y=(0.0, DEPTH)).field
    assert np.allclose(flat.raw_flux_z, field.flux_z.mean(axis=1), rtol=1e-9, atol=1e-12)
    assert np.allclose(flat.raw_flux_r, field.flux_r.mean(axis=1), rtol=1e-9, atol=1e-12)
    assert field.flux_y_se is not None
    assert field.flux_y_se.shape == field.flux_y.shape


@pytest.mark.parametrize("frame", [{}, {"plane": "xyz", "cell": 0.1}], ids=["plane", "space"])
def test_files_hold_the_field(dumps, tmp_path, frame):
    made = averaged(dumps, **frame)
    field = made.field
    write_homogenized(made, None, tmp_path / "out")
    loaded = Field.load(tmp_path / "out" / "field.npz")
    assert isinstance(loaded.grid, Box)
    assert np.array_equal(loaded.flux_r, field.flux_r)
    assert np.array_equal(loaded.grid.y_edges, field.grid.y_edges)
    with np.load(tmp_path / "out" / "field.npz") as stored:
        assert {"x_edges", "flux_x", "flux_z", "flux_x_se"} <= set(stored.files)
        assert not [name for name in stored.files if name.startswith(("r_", "flux_r"))]
    text = (tmp_path / "out" / "comsol" / "flow_spreadsheet.txt").read_text()
    assert "% x " in text
    assert "at the scale of the dumps" in (tmp_path / "out" / "report.html").read_text() or frame
    assert (tmp_path / "out" / "figures" / "rz_field.png").is_file() == (not frame)
    rows = np.loadtxt(text.splitlines(), comments="%")
    if frame:
        import pyvista

        mesh = pyvista.read(tmp_path / "out" / "field.vtr")
        assert mesh.dimensions == tuple(n + 1 for n in reversed(field.grid.shape))
        assert np.allclose(mesh.cell_data["packing_fraction"], field.packing_fraction.ravel())
        w = 0.5 * (field.flux_z[1:] + field.flux_z[:-1]) * field.velocity_scale
        assert np.allclose(rows[:, 3 + 4], w.ravel())
        assert np.allclose(mesh.cell_data["bulk_velocity"][:, 2], w.ravel())
        centre = mesh.cell_centers().points
        assert np.allclose(centre, rows[:, :3], atol=1e-6)
    else:
        assert (tmp_path / "out" / "field.vtu").is_file()
        at = (np.abs(rows[:, 0] - 0.1) < 0.01) & (np.abs(rows[:, 1] - 0.1) < 0.01)
        exact = -CHANNEL.flow / NARROW / field.bulk_packing
        assert rows[at, 3] == pytest.approx(exact, rel=0.15)
