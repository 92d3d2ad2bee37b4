"""Where solids leave a grid in space: faces beyond which an outlet lies, and what has left above each level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array, Box, Mask, level_flow
from granpipe.homogenize.average import Sums

Faces = tuple[Array, Array, Array]
"""Values on the faces across x (nz, ny, nx+1), y (nz, ny+1, nx) and z (nz+1, ny, nx)."""


@dataclass(frozen=True)
class OutletFaces:
    """The faces of one outlet.

    Parameters
    ----------
    signs : on all faces 1 or −1 where its solids leave along or against the axis, 0 elsewhere
    share : its part of the flow; None where it is not known
    """

    signs: tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.int8]]
    share: float | None

    @property
    def masks(self) -> tuple[Mask, Mask, Mask]:
        """Where its solids leave."""
        x, y, z = self.signs
        return x != 0, y != 0, z != 0

    def out(self, flow: Faces) -> float:
        """What leaves through it, of flows through the faces [m³/s]."""
        return sum(float((sign * one).sum()) for sign, one in zip(self.signs, flow, strict=True))

    def left_above(self, flow: Faces) -> Array:
        """(nz+1,) what leaves through it above each level, of flows through the faces [m³/s]."""
        x, y, z = (sign * one for sign, one in zip(self.signs, flow, strict=True))
        found = np.zeros(len(z))
        found[:-1] = np.cumsum((x.sum(axis=(1, 2)) + y.sum(axis=(1, 2)) + z[1:].sum(axis=(1, 2)))[::-1])[::-1]
        return found


@dataclass(frozen=True)
class OutletCells:
    """The cells beyond outlets.

    Parameters
    ----------
    number : (nz+2, ny+2, nx+2) of the outlet beyond which each cell of a grid lies, and of one more on every side;
        −1 where beyond none
    shares : part of the flow of each outlet, or None
    """

    number: NDArray[np.int64]
    shares: tuple[float | None, ...]

    def faces(self, cells: Mask) -> list[OutletFaces]:
        """The faces of each outlet between these cells (nz, ny, nx) and those beyond it."""
        own = np.pad(cells, 1)
        found = []
        for k, share in enumerate(self.shares):
            beyond = (self.number == k) & ~own
            signs = []
            for axis in (2, 1, 0):
                inner = tuple(slice(None) if one == axis else slice(1, -1) for one in range(3))
                low, high = ((np.delete(own, end, axis)[inner], np.delete(beyond, end, axis)[inner]) for end in (-1, 0))
                signs.append((low[0] & high[1]).astype(np.int8) - (high[0] & low[1]).astype(np.int8))
            found.append(OutletFaces((signs[0], signs[1], signs[2]), share))
        return found


def left_above(outlets: Sequence[OutletFaces], flow: Faces) -> Array:
    """(nz+1,) what leaves through all outlets above each level, of flows through the faces [m³/s]."""
    return np.asarray(sum((one.left_above(flow) for one in outlets), np.zeros(len(flow[2]))))


def fluxes(sums: Sums) -> Faces:
    """Time-averaged solids flux through the faces of a grid in space [m/s]."""
    along_y = sums.mean_flux_y
    assert along_y is not None  # of a grid in space
    return sums.mean_flux[0], along_y, sums.mean_flux[1]


def face_areas(grid: Box) -> tuple[float, float, float]:
    """Area of a face across x, y and z [m²]."""
    return float(grid.side_area[0]), grid.front_area, float(grid.ring_area[0])


def flows(sums: Sums) -> Faces:
    """Time-averaged solids flow through the faces of a grid in space [m³/s]."""
    assert isinstance(sums.grid, Box)
    x, y, z = (area * flux for area, flux in zip(face_areas(sums.grid), fluxes(sums), strict=True))
    return x, y, z


def within_vessel(segments: Sequence[Sums], inside_fraction: Array, outlets: OutletCells) -> list[Sums]:
    """Segments without what lies beyond the outlets: solids in tubes that lead down beside the vessel.

    The series of each segment become its means: flow through each level with what has left above it, and solids.

    Parameters
    ----------
    inside_fraction : (nz, ny, nx) part of each cell inside the vessel
    """
    cells = inside_fraction > 0
    kept = []
    for axis in (2, 1, 0):
        padded = np.pad(cells, [(1, 1) if one == axis else (0, 0) for one in range(3)])
        kept.append(np.delete(padded, -1, axis) | np.delete(padded, 0, axis))
    faces = outlets.faces(cells)

    def cut(one: Sums) -> Sums:
        assert one.flow_y is not None
        found = replace(
            one,
            volume=np.where(cells, one.volume, 0.0),
            gain=np.where(cells, one.gain, 0.0),
            flow_r=np.where(kept[0], one.flow_r, 0.0),
            flow_y=np.where(kept[1], one.flow_y, 0.0),
            flow_z=np.where(kept[2], one.flow_z, 0.0),
        )
        through = level_flow(found.mean_flux[1], found.grid) + left_above(faces, flows(found))
        return replace(
            found,
            level_flow=np.tile(through, (len(one.time), 1)),
            solids=np.full_like(one.solids, found.mean_volume.sum()),
        )

    return [cut(one) for one in segments]
