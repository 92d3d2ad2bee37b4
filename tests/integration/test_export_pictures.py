"""Pictures are made without an X server and are not blank."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fakes.synthetic import field_of, hopper, ring_vessel

from granpipe.export.pictures import rz_figures


def pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return imread(path)[..., :3]


def coloured(picture: np.ndarray) -> np.ndarray:
    """Pixels that are no shade of grey."""
    return np.ptp(picture, axis=-1) > 0.15


@pytest.mark.parametrize("known", [True, False], ids=["packing and raw average", "fluid"])
def test_figures_show_the_field(known: bool, tmp_path: Path) -> None:
    vessel = ring_vessel()
    field = field_of(vessel, 0.04, with_packing=known, with_psi=known)
    if known:
        field = replace(field, raw_flux_r=field.flux_r, raw_flux_z=1.02 * field.flux_z)
    paths = rz_figures(field, vessel.wall, vessel.obstacles, tmp_path)
    panels = [*(["rz_packing.png"] if known else []), "rz_u.png", "rz_w.png", "rz_streamlines.png"]
    assert [path.name for path in paths] == ["rz_field.png", "rz_flow.png", *panels]
    fields, flow = map(pixels, paths[:2])
    assert fields.std() > 0.1
    assert 0.1 < coloured(fields).mean() < 0.9
    assert len(np.unique(fields[coloured(fields)].round(2), axis=0)) > 300
    assert 0.0005 < coloured(flow).mean() < 0.2
    red = (flow[..., 0] - flow[..., 2] > 0.3).sum()
    assert (red > 200) == known  # the plain average is there where it is known


def test_the_cavity_is_white_and_the_heap_is_not(tmp_path: Path) -> None:
    vessel = ring_vessel()
    path, *_ = rz_figures(field_of(vessel, 0.04), vessel.wall, vessel.obstacles, tmp_path)
    picture = pixels(path)
    panel = packing_panel(picture)
    height, width = panel.shape[:2]

    def at(r: float, z: float) -> np.ndarray:
        return panel[round((1 - z / 2) * height), round(r / 0.5 * width)]

    assert (at(0.45, 0.75) == 1).all()
    assert np.ptp(at(0.45, 1.2)) > 0.2
    assert np.ptp(at(0.1, 0.75)) > 0.2
    assert np.ptp(at(0.4, 0.95)) < 0.05 < 1 - at(0.4, 0.95).max()  # the ring is grey


def packing_panel(picture: np.ndarray) -> np.ndarray:
    """The part of the picture that the colours of the packing fill, in the first quarter."""
    yellow = (picture[..., 0] > 0.7) & (picture[..., 2] < 0.5) & (picture[..., 1] > 0.6)
    yellow = yellow[:, : picture.shape[1] // 4]
    rows, columns = np.flatnonzero(yellow.sum(axis=1) > 50), np.flatnonzero(yellow.sum(axis=0) > 400)
    rows = rows[rows > 0.1 * len(picture)]  # below the colour bar
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def test_a_wide_flat_vessel_is_laid_out_too(tmp_path: Path) -> None:
    vessel = hopper()
    wide = replace(vessel, wall=[(2 * r, 0.5 * z) for r, z in vessel.wall])
    field = field_of(vessel, 0.05)
    grid = replace(field.grid, r_edges=2 * field.grid.r_edges, z_edges=0.5 * field.grid.z_edges)
    for path in rz_figures(replace(field, grid=grid), wide.wall, {}, tmp_path):
        height, width = pixels(path).shape[:2]
        assert 0.1 < height / width < 1
        assert max(height, width) < 4000


VESSEL = """
import sys
from pathlib import Path
import numpy as np
import pyvista
from granpipe.export.pictures import vessel_figure

folder = Path(sys.argv[1])
tube = pyvista.Cylinder(center=(0, 0, 1), direction=(0, 0, 1), radius=0.5, height=2, resolution=24, capping=False)
tube.triangulate().save(folder / "vessel.stl")
pyvista.Disc(center=(0, 0, 0.05), inner=0, outer=0.5, c_res=24).triangulate().save(folder / "plate.stl")
pyvista.Cylinder(center=(0, 0, 1.2), direction=(0, 0, 1), radius=0.2, height=0.2).triangulate().save(
    folder / "obstacle_disc.stl"
)
random = np.random.default_rng(3)
position = random.uniform([-0.45, -0.45, 0.1], [0.45, 0.45, 1.0], (3000, 3))
position = position[np.hypot(position[:, 0], position[:, 1]) < 0.45]
radius = random.uniform(0.02, 0.04, len(position))
velocity = np.zeros_like(position)
velocity[:, 2] = -0.01 * (1 - position[:, 0])
vessel_figure(sorted(folder.glob("*.stl")), position, radius, velocity, folder / "vessel.png", 0.5, (0.2, 1.5))
vessel_figure(sorted(folder.glob("*.stl")), position, radius, velocity, folder / "whole.png", 0.5, (0.2, 2.0))
"""


def test_vessel_and_particles_are_drawn_without_an_x_server(tmp_path: Path) -> None:
    without = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", VESSEL, tmp_path], env=without, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    picture = pixels(tmp_path / "vessel.png")
    assert picture.std() > 0.1
    height = len(picture)
    filled, empty = picture[int(0.6 * height) : int(0.85 * height)], picture[int(0.2 * height) : int(0.3 * height)]
    assert coloured(filled).mean() > 0.3  # particles in the lower half
    assert coloured(empty).mean() < 0.02  # the open vessel above them is grey
    assert (empty.min(axis=-1) < 0.9).mean() > 0.2
    wide, tall = (np.divide(*pixels(tmp_path / f"{name}.png").shape[:2]) for name in ("vessel", "whole"))
    assert wide < 0.9 * tall  # a quarter of the tube, above inlet and particles, is cut away
