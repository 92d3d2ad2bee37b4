"""STL and OBJ: the profile of a triangulated surface of revolution."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granpipe.drawings.lines import LARGEST, Line, Lines, Points
from granpipe.drawings.obj import read_obj
from granpipe.errors import CaseError

FEWEST_FACETS = 8
"""Facets per turn that a surface of revolution has at least: fewer are a polygonal vessel."""

MOST_BYTES = 500_000_000
"""Of a file of triangles: a hundred bytes for each of ten times as many triangles as any vessel may have."""

_PRECISION = 2e-6
"""STL holds numbers in single precision."""

_AXES = ("z", "y", "x")


def read_surface(path: Path, sagitta: float | None = None, up: str = "") -> Lines:
    """The profile of a surface of revolution, as radius and height.

    Every edge of a triangle is drawn between the radii and heights of its ends; those round the axis vanish.

    Parameters
    ----------
    up : coordinate that points up: x, y, z, or -x, -y, -z; found unless given

    Raises
    ------
    CaseError : no such file, no triangles, or not a surface of revolution
    """
    points, triangles = read_triangles(path)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.ptp(points, axis=0).max())
    reasons = []
    for name in [up.lstrip("-")] if up else _AXES:
        vertical = "xyz".index(name)
        flat = np.delete(points - centre, vertical, axis=1)
        height = points[:, vertical] * (-1.0 if up.startswith("-") else 1.0)
        profile = np.stack([np.hypot(*flat.T), height], axis=1)
        ring = _rings(profile, 2 * _PRECISION * size)
        wide = profile[:, 0] > 1e-3 * size
        if not wide.any():
            continue
        gap = _widest_gap(np.arctan2(flat[:, 1], flat[:, 0])[wide], ring[wide])
        if gap <= 2 * np.pi / FEWEST_FACETS + 1e-6:
            return Lines(_profile(profile, ring, triangles), half=True, precision=2 * _PRECISION)
        reasons.append(f"about {name} {np.degrees(gap):.0f}° of a ring are without a corner")
    raise CaseError(f"not a surface of revolution with {FEWEST_FACETS} facets per turn or more: {', '.join(reasons)}")


def read_triangles(path: Path) -> tuple[Points, NDArray[np.int64]]:
    """(n, 3) corners and (m, 3) which of them each triangle of an STL or OBJ file has.

    Raises
    ------
    CaseError : no triangles can be read
    """
    from meshio import stl

    if (size := path.stat().st_size) > MOST_BYTES:
        raise CaseError(f"{size / 1e6:.0f} MB are more than {MOST_BYTES / 1e6:.0f} MB; make the mesh coarser")
    if path.suffix.lower() == ".obj":
        return _checked(*read_obj(path))
    try:
        with np.errstate(over="ignore"):  # meshio takes the first bytes of a text file for a number
            mesh = stl.read(path)
        points, triangles = np.asarray(mesh.points, dtype=float), np.concatenate([one.data for one in mesh.cells])
    except Exception:  # meshio's readers raise whatever a damaged file makes them stumble over
        raise CaseError(
            "no triangles can be read from it: cut short, damaged, or of another format; export it anew"
        ) from None
    return _checked(points, triangles)


def _checked(points: Points, triangles: NDArray[np.int64]) -> tuple[Points, NDArray[np.int64]]:
    """Corners and triangles as they are; CaseError where they cannot be those of a vessel."""
    if points.shape[1:] != (3,):
        raise CaseError("damaged: its points have not three coordinates each")
    if len(triangles) == 0 or not (np.abs(points) <= LARGEST).all():
        raise CaseError(f"damaged: no triangles, or points that are no numbers or beyond {LARGEST:g}")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise CaseError("damaged: triangles with corners that are not there")
    return points, triangles


def _rings(profile: Points, tolerance: float) -> NDArray[np.int64]:
    """(n,) which ring of equal radius and height each corner belongs to."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    _, unique, of = np.unique(np.round(profile / tolerance), axis=0, return_index=True, return_inverse=True)
    near = cKDTree(profile[unique]).query_pairs(2 * tolerance, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(unique), len(unique)))
    return np.asarray(connected_components(graph, directed=False)[1][of.reshape(-1)], dtype=np.int64)


def _widest_gap(angle: Points, ring: NDArray[np.int64]) -> float:
    """Largest angle between neighbouring corners of any ring [rad]."""
    order = np.lexsort((angle, ring))
    angle, ring = angle[order], ring[order]
    starts = np.flatnonzero(np.r_[True, np.diff(ring) != 0])
    following = np.r_[angle[1:], 0.0]
    ends = np.r_[starts[1:] - 1, len(ring) - 1]
    following[ends] = angle[starts] + 2 * np.pi
    return float((following - angle).max(initial=0.0))


def _profile(profile: Points, ring: NDArray[np.int64], triangles: NDArray[np.int64]) -> list[Line]:
    """A line between each two rings that an edge connects."""
    mean = np.stack([np.bincount(ring, profile[:, k]) for k in (0, 1)], axis=1) / np.bincount(ring)[:, None]
    corners = ring[triangles]
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]))
    pairs = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
    single = np.array([float(f"{value:.7g}") for value in mean.flat]).reshape(mean.shape)  # what STL's precision holds
    return [Line(single[pair]) for pair in pairs]
