"""The r–z grid, the field on it and other data that the rooms of granpipe hand to each other.

Cells are indexed ``[iz, ir]``; z points up, r from the axis, downward flow is negative. Fluxes live on the faces of
the cells (staggered), so that the balance of every cell is a plain sum of its four faces.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from math import pi
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granpipe.errors import CaseError, DataError
from granpipe.system.npzfile import read_npz

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Length = TypeVar("Length", float, NDArray[np.float64])

FORMAT_VERSION = 1

MOST_CELLS = 2e6
"""Far more than a case needs (the article's own particles ask for 25 000): a wrong unit must not fill the memory."""

MOST_LENGTH, LEAST_CELL = 1e5, 1e-9
"""Bounds on a grid [m]."""

MOST = 1e12
"""Bound on the size of any figure in a field, SI."""

LEAST_PACKING = 1e-3
"""Bulk of fewer solids is none."""

FLOW_TOLERANCE, PSI_TOLERANCE = 0.05, 1e-6
"""How far the mean flow through the levels may be from `bulk_flow`, and fluxes from those of ψ, relative."""


_EXTRA = {
    "particle_u": "zr",
    "particle_w": "zr",
    "sauter_diameter": "zr",
    "stress_rr": "zr",
    "stress_tt": "zr",
    "stress_zz": "zr",
    "stress_rz": "zr",
    "pressure": "zr",
    "strain_rr": "zr",
    "strain_tt": "zr",
    "strain_zz": "zr",
    "strain_rz": "zr",
    "shear_rate": "zr",
    "granular_temperature": "zr",
    "coordination": "zr",
    "mechanical_coordination": "zr",
    "rattlers": "zr",
    "mixing_index": "zr",
    "age": "zr",
    "sensitivity": "zr",
    "class_diameter": "k",
    "class_packing": "kzr",
    "wall_surface": "m",
    "wall_ends": "m22",
    "wall_contact": "m",
    "wall_slip": "m",
    "wall_pressure": "m",
    "residence_time": "n",
    "residence_within": "n",
}
"""What `homogenize.fields` and a frictional fluid add → its sizes, a letter each: z and r those of the grid, 2 two."""

FLOW_RATE_POWER = {
    "strain_rr": 1,
    "strain_tt": 1,
    "strain_zz": 1,
    "strain_rz": 1,
    "shear_rate": 1,
    "granular_temperature": 2,
    "age": -1,
    "sensitivity": 1,
}
"""What of it goes with a power of the flow rate, slow flow supposed."""

_MAY_LACK = re.compile("strain_..|shear_rate|granular_temperature|(mechanical_)?coordination|rattlers|mixing_index|age")
"""What of it is NaN where it is not known."""

_COMPONENT = re.compile("(flux_|strain_|stress_)([rtxyz]+)")
"""A vector or tensor in a file, and its components."""

_TO_PLANE, _TO_RINGS = str.maketrans("rt", "xy"), str.maketrans("xy", "rt")

_NAME = re.compile(r"[\w.-]{1,64}")


class Particles(Protocol):
    """All particles at one time: numbers (n,), centres (n, 3) and radii (n,) [m], velocities (n, 3) [m/s]."""

    @property
    def id(self) -> NDArray[np.int64]: ...

    @property
    def position(self) -> Array: ...

    @property
    def velocity(self) -> Array: ...

    @property
    def radius(self) -> Array: ...


@dataclass(frozen=True)
class Measure:
    """What a plane section of a vessel stands for: a body of revolution, or a slab of some depth.

    A volume is `turn` times the integral of `weight` over the section; the flow between two points is `turn` times the
    difference of ψ, where u = −∂ψ/∂z and w = ∂ψ/∂r, both over `weight`.

    Parameters
    ----------
    turn : 2π, or the depth of the slab [m]
    axial : whether r is the distance from an axis; in a slab it is the coordinate x
    walled : whether a slab ends at a front and a back wall; otherwise it is deep, and a slice stands for it
    """

    turn: float = 2 * pi
    axial: bool = True
    walled: bool = False

    def weight(self, r: Array) -> Array:
        """r, or 1 in a slab."""
        return r if self.axial else np.ones_like(r)

    def reach(self, r: Array) -> Array:
        """The integral of `weight` from 0 to r: r²/2, or r. In it, a plug's ψ is linear."""
        return 0.5 * r**2 if self.axial else r

    def area(self, inner: ArrayLike, outer: ArrayLike) -> Array:
        """Area of a level between two r [m²]."""
        return np.asarray(self.turn * (self.reach(np.asarray(outer)) - self.reach(np.asarray(inner))))

    def share(self, depth: float | None) -> float:
        """Its part of a slab of some depth [m]; 1 of a body of revolution, which has none."""
        return 1.0 if depth is None else self.turn / depth

    def within_depth(self, y: Array) -> Mask:
        """Whether points are between the front and the back wall of a slab; those without walls hold all y [m]."""
        return (y > 0) & (y < self.turn) | (not self.walled)

    def from_reach(self, reach: Array) -> Array:
        """The r whose `reach` is this."""
        return np.sqrt(2 * reach) if self.axial else reach

    def across(self, x: Array, y: Array) -> Array:
        """r of points: their distance from the axis, or x [m]."""
        return np.hypot(x, y) if self.axial else x

    def components(self, position: Array, vector: Array) -> tuple[Array, Array, Array]:
        """Vectors (n, 3) at positions (n, 3) along r, round the axis and along z; in a slab along x, y and z."""
        vx, vy, vz = vector.T
        if not self.axial:
            return vx, vy, vz
        x, y = position[:, :2].T
        r = np.maximum(np.hypot(x, y), 1e-300)
        return (vx * x + vy * y) / r, (vy * x - vx * y) / r, vz

    def radius(self, area: ArrayLike) -> Array:
        """Radius of a circle, or half the width of a strip as deep as the slab, of some area [m]."""
        return np.asarray(np.sqrt(np.asarray(area) / pi) if self.axial else np.asarray(area) / (2 * self.turn))

    def hydraulic_diameter(self, width: Length) -> Length:
        """4 × area / perimeter of levels [m]: their diameter; of a slab twice its width, or that of its rectangle."""
        if self.axial:
            return width
        return 2 * width * self.turn / (width + self.turn) if self.walled else 2 * width

    @property
    def letter(self) -> str:
        """What the coordinate across is called."""
        return "r" if self.axial else "x"


ROUND = Measure()
"""Of a body of revolution."""


@dataclass(frozen=True)
class Frustum:
    """What lies between two heights and two lines that are linear in z [m].

    Round the axis the lines are inner and outer radii (inner radii 0: no hole), in a slab left and right ends in x;
    there it begins at `front` [m] and is `measure.turn` deep.
    """

    z_low: float
    z_high: float
    inner_low: float
    inner_high: float
    outer_low: float
    outer_high: float
    measure: Measure = ROUND
    front: float = 0.0

    @property
    def height(self) -> float:
        """[m]."""
        return self.z_high - self.z_low

    @property
    def width(self) -> float:
        """Larger of the widths at its two ends [m]; the diameter where it has no hole."""
        low, high = (
            outer - inner if inner > 0 or not self.measure.axial else 2 * outer
            for inner, outer in ((self.inner_low, self.outer_low), (self.inner_high, self.outer_high))
        )
        return max(low, high)

    @property
    def volume(self) -> float:
        """[m³]."""
        if not self.measure.axial:
            widths = self.outer_low - self.inner_low, self.outer_high - self.inner_high
            return 0.5 * self.measure.turn * self.height * sum(widths)
        outer = self.outer_low**2 + self.outer_low * self.outer_high + self.outer_high**2
        inner = self.inner_low**2 + self.inner_low * self.inner_high + self.inner_high**2
        return pi / 3 * self.height * (outer - inner)

    def cut(self, low: float, high: float) -> Frustum:
        """The part of it between two heights [m]."""
        shares = [(z - self.z_low) / self.height for z in (low, high)]
        inner = [self.inner_low + (self.inner_high - self.inner_low) * share for share in shares]
        outer = [self.outer_low + (self.outer_high - self.outer_low) * share for share in shares]
        return replace(
            self,
            z_low=low,
            z_high=high,
            inner_low=inner[0],
            inner_high=inner[1],
            outer_low=outer[0],
            outer_high=outer[1],
        )


@dataclass(frozen=True)
class Boxes:
    """Upright blocks in space, one beside or below the other.

    Parameters
    ----------
    blocks : ends along x, along y and along z of each [m]
    """

    blocks: tuple[tuple[float, ...], ...]

    @property
    def z_low(self) -> float:
        """[m]."""
        return min(block[4] for block in self.blocks)

    @property
    def z_high(self) -> float:
        """[m]."""
        return max(block[5] for block in self.blocks)

    @property
    def volume(self) -> float:
        """[m³]."""
        return sum((b - a) * (d - c) * (f - e) for a, b, c, d, e, f in self.blocks)

    def cut(self, low: float, high: float) -> Boxes:
        """The part of them between two heights [m]."""
        parts = ((*block[:4], max(block[4], low), min(block[5], high)) for block in self.blocks)
        return Boxes(tuple(part for part in parts if part[4] < part[5]))


@dataclass(frozen=True)
class Grid:
    """A uniform grid of annular cells.

    Parameters
    ----------
    r_edges : (nr+1,) radii of the cell edges [m], from 0
    z_edges : (nz+1,) heights of the cell edges [m], rising
    """

    r_edges: Array
    z_edges: Array

    @classmethod
    def covering(cls, r_max: float, z_min: float, z_max: float, cell: float) -> Grid:
        """Grid whose rows fill [z_min, z_max] exactly, with cells as near to `cell` [m] as that allows.

        Raises
        ------
        CaseError : the grid would have more than `MOST_CELLS` cells
        """
        _check_number(r_max, z_max - z_min, cell)
        rows = max(1, round((z_max - z_min) / cell))
        size = (z_max - z_min) / rows
        columns = max(1, int(np.ceil(r_max / size - 1e-9)))
        return cls(size * np.arange(columns + 1.0), np.linspace(z_min, z_max, rows + 1))

    @property
    def shape(self) -> tuple[int, ...]:
        """(nz, nr)."""
        return len(self.z_edges) - 1, len(self.r_edges) - 1

    @property
    def cell(self) -> float:
        """Edge length h of a cell [m]."""
        return float(self.z_edges[-1] - self.z_edges[0]) / self.shape[0]

    @property
    def r_centres(self) -> Array:
        """(nr,) [m]."""
        return 0.5 * (self.r_edges[1:] + self.r_edges[:-1])

    @property
    def z_centres(self) -> Array:
        """(nz,) [m]."""
        return 0.5 * (self.z_edges[1:] + self.z_edges[:-1])

    @property
    def ring_area(self) -> Array:
        """(nr,) area of the horizontal face of each ring [m²]."""
        return self.measure.area(self.r_edges[:-1], self.r_edges[1:])

    @property
    def side_area(self) -> Array:
        """(nr+1,) area of the cylindrical face at each edge radius [m²]; 0 on the axis."""
        return self.measure.turn * self.measure.weight(self.r_edges) * self.cell

    @property
    def measure(self) -> Measure:
        """What the section of its cells stands for."""
        return ROUND

    @property
    def cell_volume(self) -> Array:
        """(nr,) volume of a cell [m³], the same in every row."""
        return np.asarray(self.ring_area * self.cell)

    def check(self) -> None:
        """Check that the edges are those of a grid of square cells from the axis.

        Raises
        ------
        ValueError : says what is wrong
        """
        for name, edges in self._edges.items():
            steps = np.diff(edges) if edges.dtype == float and edges.ndim == 1 and 2 <= len(edges) <= MOST_CELLS else 0
            even = np.all(steps > 0) and np.allclose(steps, np.mean(steps), rtol=1e-6, atol=0)
            if not even or not np.abs(edges).max() <= MOST_LENGTH or np.mean(steps) < LEAST_CELL:
                raise ValueError(f"the {name} edges are not evenly spaced, rising, and within {MOST_LENGTH:g} m")
        if np.prod(self.shape) > MOST_CELLS:
            raise ValueError(f"more than {MOST_CELLS:.0e} cells")
        if self.measure.axial and (
            self.r_edges[0] != 0 or not np.isclose(self.r_edges[1], self.cell, rtol=1e-6, atol=0)
        ):
            raise ValueError("the cells are not squares, the first one on the axis")

    def part(self, rows: slice, columns: slice) -> Self:
        """Some of its rows and columns of cells, counted from the lowest and from the least r (x)."""
        return replace(self, r_edges=_edges_of(self.r_edges, columns), z_edges=_edges_of(self.z_edges, rows))

    def where(self, part: Grid) -> tuple[slice, slice]:
        """Rows and columns of cells of a grid with the same cells that is a part of this one."""
        return _cells_of(part.z_edges, self.z_edges), _cells_of(part.r_edges, self.r_edges)

    @property
    def period(self) -> float:
        """Distance along y after which what particles do repeats itself [m]; 0 where it does not."""
        return 0.0

    def of_slice(self, measure: Measure) -> Grid:
        """The grid of the part that particles fill; a body of revolution has no slices, and keeps its own."""
        return self

    @property
    def _edges(self) -> dict[str, Array]:
        """Direction → edges."""
        return {"r": self.r_edges, "z": self.z_edges}

    def stored(self) -> dict[str, Any]:
        """The grid as arrays for a file; `restored` makes it again."""
        return {"r_edges": self.r_edges, "z_edges": self.z_edges}

    def name_of(self, array: str) -> str:
        """Name in a file of what the code calls ``flux_r``, ``strain_rz`` and the like."""
        return array

    def named_in_file(self, name: str) -> str:
        """What the code calls an array of this name in a file."""
        return name


def _edges_of(edges: Array, cells: slice) -> Array:
    """The edges of some of the cells between edges."""
    return edges[cells.start : cells.stop + 1]


def _cells_of(part: Array, edges: Array) -> slice:
    """Which cells between edges those between the edges of a part are."""
    first = int(np.abs(edges - part[0]).argmin())
    return slice(first, first + len(part) - 1)


def _check_number(width: float, height: float, cell: float) -> None:
    if not height * max(width, cell) < MOST_CELLS * cell**2:
        raise CaseError(
            f"cells of {cell:.3g} m in a vessel of {width:.3g} m × {height:.3g} m are more than "
            f"{MOST_CELLS:.0e}; choose a larger cell, or larger particles, by which it goes unless it is given",
            ("homogenize", "cell"),
        )


@dataclass(frozen=True)
class Box(Grid):
    """A uniform Cartesian grid, in the plane x–z of a vessel that is alike all along y, or in space.

    What rings call r is x here. Arrays are indexed ``[iz, ix]`` in the plane, ``[iz, iy, ix]`` in space.

    Parameters
    ----------
    r_edges : (nx+1,) edges along x [m]
    y_edges : (ny+1,) edges along y [m]; in the plane both ends of the depth
    flat : whether it lies in the plane
    cut : whether the ends of the depth cut particles, which otherwise count wholly
    walled : whether the depth ends at a front and a back wall
    """

    y_edges: Array
    flat: bool
    cut: bool = True
    walled: bool = False

    @classmethod
    def within(
        cls, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], cell: float, flat: bool, cut: bool
    ) -> Box:
        """Grid that fills these ranges [m] exactly, with cells as near to `cell` [m] as that allows.

        Raises
        ------
        CaseError : a grid in the plane would have more than `MOST_CELLS` cells
        """
        if flat:
            _check_number(x[1] - x[0], z[1] - z[0], cell)

        def edges(ends: tuple[float, float], size: float) -> Array:
            return np.linspace(*ends, max(1, round((ends[1] - ends[0]) / size)) + 1)

        return cls(edges(x, cell), edges(z, cell), np.array(y) if flat else edges(y, cell), flat, cut)

    @property
    def shape(self) -> tuple[int, ...]:
        """(nz, nx) or (nz, ny, nx)."""
        rows, columns = len(self.z_edges) - 1, len(self.r_edges) - 1
        return (rows, columns) if self.flat else (rows, len(self.y_edges) - 1, columns)

    @property
    def _steps(self) -> tuple[float, float, float]:
        """Edge lengths of a cell along x, y and z [m]."""
        dx, dy, dz = (float(e[-1] - e[0]) / (len(e) - 1) for e in (self.r_edges, self.y_edges, self.z_edges))
        return dx, dy, dz

    @property
    def lines(self) -> tuple[Array, Array, Array]:
        """Edges along z, y and x [m], in the order of the arrays."""
        return self.z_edges, self.y_edges, self.r_edges

    @property
    def ring_area(self) -> Array:
        """(nx,) area of the horizontal face of a cell [m²]."""
        dx, dy, _ = self._steps
        return np.full(len(self.r_edges) - 1, dx * dy)

    @property
    def side_area(self) -> Array:
        """(nx+1,) area of the face of a cell across x [m²]."""
        _, dy, dz = self._steps
        return np.full(len(self.r_edges), dy * dz)

    def of_slice(self, measure: Measure) -> Box:
        """The grid of a slice between periodic faces, or of all between two walls, neither of which cuts a particle."""
        return replace(self, y_edges=np.array([0.0, measure.turn]), cut=False, walled=measure.walled)

    @property
    def period(self) -> float:
        """The depth of a slice between periodic faces [m]."""
        return 0.0 if self.cut or self.walled or not self.flat else self.measure.turn

    @property
    def front_area(self) -> float:
        """Area of the face of a cell across y [m²]."""
        dx, _, dz = self._steps
        return dx * dz

    @property
    def measure(self) -> Measure:
        """A slab between the ends of y."""
        return Measure(float(self.y_edges[-1] - self.y_edges[0]), axial=False, walled=self.walled)

    @property
    def _edges(self) -> dict[str, Array]:
        return {"x": self.r_edges, "y": self.y_edges, "z": self.z_edges}

    def stored(self) -> dict[str, Any]:
        """The grid as arrays for a file."""
        ends = {"flat": self.flat, "cut": self.cut, "walled": self.walled}
        return {"x_edges": self.r_edges, "y_edges": self.y_edges, "z_edges": self.z_edges} | ends

    def name_of(self, array: str) -> str:
        """``flux_x`` for ``flux_r``, ``strain_xz`` for ``strain_rz``."""
        return _COMPONENT.sub(lambda found: found[1] + found[2].translate(_TO_PLANE), array)

    def named_in_file(self, name: str) -> str:
        """``flux_r`` for ``flux_x``, ``strain_rz`` for ``strain_xz``; those of y of a grid in space stay."""
        return (
            _COMPONENT.sub(lambda found: found[1] + found[2].translate(_TO_RINGS), name)
            if self.flat
            else (name.replace("flux_x", "flux_r"))
        )


def restored(stored: dict[str, Any]) -> Grid:
    """Take the arrays that `Grid.stored` gave out of what a file holds, and make the grid."""
    if "x_edges" not in stored:
        return Grid(stored.pop("r_edges"), stored.pop("z_edges"))
    x, y, z = (stored.pop(f"{axis}_edges") for axis in "xyz")
    return Box(x, z, y, bool(stored.pop("flat")), bool(stored.pop("cut")), bool(stored.pop("walled", False)))


@dataclass(frozen=True)
class Field:
    """A flow field on the outline's own z-range; the same for DEM, fluid and hybrid.

    Fluxes are solids flux F = φ v [m/s], averaged over the whole annular face (its part outside the outline counts as
    area without flow), at DEM scale: multiply by `flow_scale` for the flow rate that the case asks for. What a model
    does not know is None.

    Parameters
    ----------
    grid : r and z edges
    inside_fraction : (nz, nr) part of each cell's volume inside the outline
    bulk : (nz, nr) True where solids flow or rest
    flux_r, flux_z : (nz, nr+1), (nz+1, nr) the final field [m/s]
    bulk_flow : bulk flow Φ at DEM scale [m³/s], positive downwards
    bulk_packing : φ_ref, the packing that turns solids flux into bulk velocity U = F/φ_ref
    flow_scale : s_Φ = target flow / bulk_flow
    packing_fraction : (nz, nr) solids fraction φ of the part of each cell inside the outline; a fluid knows none
    raw_flux_r, raw_flux_z : the plain average, before any adjustment [m/s]
    *_se : standard error of the like-named array [m/s]; nan where it is not known: where a hybrid's fluid is alone
    psi : (nz+1, nr+1) Stokes stream function of the final field [m³/s per radian], −φ_ref Φ/2π on the outer wall
    flux_y : (nz, ny+1, nx) the final field of a grid in space [m/s]
    extra : what the case asks for beside (`homogenize.fields`), and the sensitivity of a frictional fluid, by name
    """

    grid: Grid
    inside_fraction: Array
    bulk: Mask
    flux_r: Array
    flux_z: Array
    bulk_flow: float
    bulk_packing: float
    flow_scale: float
    packing_fraction: Array | None = None
    raw_flux_r: Array | None = None
    raw_flux_z: Array | None = None
    flux_r_se: Array | None = None
    flux_z_se: Array | None = None
    raw_flux_r_se: Array | None = None
    raw_flux_z_se: Array | None = None
    psi: Array | None = None
    flux_y: Array | None = None
    flux_y_se: Array | None = None
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def velocity_scale(self) -> float:
        """Factor from solids flux at DEM scale to bulk velocity at the flow rate of the case."""
        return self.flow_scale / self.bulk_packing

    def of_depth(self, depth: float) -> Field:
        """That of a slab of another depth [m]: the same velocities, the flow in proportion."""
        assert isinstance(self.grid, Box)
        deep = replace(self.grid, y_edges=np.array([0.0, depth]), cut=True)
        return replace(self, grid=deep, bulk_flow=self.bulk_flow * depth / self.grid.measure.turn)

    def save(self, path: Path) -> None:
        """Write ``field.npz``: every array and scalar that is known, under its name in this class.

        Raises
        ------
        DataError : the field is not what `load` would take
        """
        try:
            self.check()
        except ValueError as error:
            raise DataError(f"{path}: not written, for the field is wrong: {error}") from error
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("grid", "extra")}
        arrays = {name: value for name, value in (known | dict(self.extra)).items() if value is not None}
        named = {self.grid.name_of(name): value for name, value in arrays.items()}
        everything: dict[str, Any] = {"format_version": FORMAT_VERSION} | self.grid.stored() | named
        np.savez_compressed(path, **everything)

    @classmethod
    def load(cls, path: Path) -> Field:
        """Read ``field.npz``.

        Raises
        ------
        DataError : no such file, damaged, of another format version, or not a field that granpipe can have made
        """
        try:
            stored = read_npz(path)
        except FileNotFoundError:
            raise DataError(f"{path}: file not found; pass the results folder of a completed run") from None
        version = stored.pop("format_version", None)
        if version is None or version.dtype != int or version.size != 1:
            raise DataError(f"{path}: not a field.npz: it has no format_version")
        if version != FORMAT_VERSION:
            raise DataError(f"{path}: field format {version}; this granpipe reads {FORMAT_VERSION}: run again")
        try:
            grid = restored(stored)
            arrays = {grid.named_in_file(name): value for name, value in stored.items()}
            extra = {name: arrays.pop(name) for name in arrays.keys() - {f.name for f in fields(cls)}}
            values = {name: float(value) if value.ndim == 0 else value for name, value in arrays.items()}
            loaded = cls(grid=grid, extra=extra, **values)  # type: ignore[arg-type]
            loaded.check()
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(f"{path}: not a field that granpipe wrote ({' '.join(map(str, error.args))})") from error
        return loaded

    def check(self) -> None:
        """Check what every field holds to: shapes, ranges, signs, and that its parts tell of one flow.

        Raises
        ------
        ValueError : says what is wrong
        """
        self.grid.check()
        for name, array, shape, low, high in self._arrays():
            kind = np.dtype(bool if name == "bulk" else float)
            if not isinstance(array, np.ndarray) or array.dtype != kind or array.shape != shape:
                raise ValueError(f"{name} is not an array {shape} of {kind}")
            unknown = np.isnan(array) if name in ("flux_r_se", "flux_z_se") else False
            if not (unknown | ((array >= low) & (array <= high))).all():
                raise ValueError(f"{name} is not between {low:g} and {high:g} everywhere")
        for name, low in (("bulk_flow", -MOST), ("bulk_packing", LEAST_PACKING), ("flow_scale", 1 / MOST)):
            value, high = getattr(self, name), 1.0 if name == "bulk_packing" else MOST
            if not (isinstance(value, int | float) and low <= value <= high):
                raise ValueError(f"{name} is {value}, not between {low:g} and {high:g}")
        self._check_parts()
        self._check_extra()
        self._check_flow()

    def _arrays(self) -> Iterator[tuple[str, NDArray[Any], tuple[int, ...], float, float]]:
        """Arrays that are there but for `extra`: name, values, and the shape and range that they must have."""
        cells = self.grid.shape
        nodes = tuple(size + 1 for size in cells)
        shapes = {"inside_fraction": cells, "packing_fraction": cells, "bulk": cells, "psi": nodes}
        for axis, direction in enumerate("zyr" if len(cells) == 3 else "zr"):
            faces = (*cells[:axis], nodes[axis], *cells[axis + 1 :])
            shapes |= {f"{kind}flux_{direction}{se}": faces for kind in ("", "raw_") for se in ("", "_se")}
        for one in fields(self):
            array = getattr(self, one.name)
            if array is not None and one.name not in ("grid", "extra", "bulk_flow", "bulk_packing", "flow_scale"):
                part = one.name in ("inside_fraction", "packing_fraction", "bulk")
                low = 0.0 if part or one.name.endswith("_se") else -MOST
                yield one.name, array, shapes.get(one.name, ()), low, 1.0 if part else MOST

    def _check_parts(self) -> None:
        """There is bulk, and none of it outside; both directions of a flux are there; ψ is 0 on the axis."""
        if not self.bulk.any() or (self.bulk & (self.inside_fraction == 0)).any():
            raise ValueError("bulk is nowhere, or outside the vessel")
        if (self.flux_y is None) == (len(self.grid.shape) == 3):
            raise ValueError("flux_y is missing, or there is no y")
        for one, other in (
            ("flux_r_se", "flux_z_se"),
            ("raw_flux_r", "raw_flux_z"),
            ("raw_flux_r_se", "raw_flux_z_se"),
        ):
            if (getattr(self, one) is None) != (getattr(self, other) is None):
                raise ValueError(f"of {one} and {other} one is missing")
        if self.psi is not None and self.grid.measure.axial and self.psi[:, 0].any():
            raise ValueError("psi is not 0 on the axis")

    def _check_extra(self) -> None:
        """Sizes that have the same letter in `_EXTRA` must be equal; numbers must be finite, text must be names."""
        sizes = dict(zip("zr" if len(self.grid.shape) == 2 else "zyr", self.grid.shape, strict=True)) | {"2": 2}
        for name, array in self.extra.items():
            letters = _EXTRA.get(name.removesuffix("_se"))
            if letters is None:
                raise ValueError(f"it holds {name!r:.40}, which is no part of a field")
            if len(letters) != array.ndim or array.shape != tuple(map(sizes.setdefault, letters, array.shape)):
                raise ValueError(f"{name} has the shape {array.shape}")
            if (array.dtype.kind == "U") != (name == "wall_surface"):
                raise ValueError(f"{name} holds {array.dtype}")
            if array.dtype.kind == "U" and not all(_NAME.fullmatch(text) for text in array.flat):
                raise ValueError(f"{name} holds more than names")
            known = array[~np.isnan(array)] if _MAY_LACK.fullmatch(name.removesuffix("_se")) else array
            if array.dtype.kind == "f" and not (np.abs(known) <= MOST).all():
                raise ValueError(f"{name} is not finite everywhere")
        for first, then in (("wall_ends", "wall_surface"), ("residence_time", "residence_within")):
            if first in self.extra and then not in self.extra:
                raise ValueError(f"{then} is missing beside {first}")

    def _check_flow(self) -> None:
        """The flow through the levels is that of `bulk_flow`, and ψ that of the fluxes."""
        flows, told = level_flow(self.flux_z, self.grid), self.bulk_flow * self.bulk_packing
        flow = float(flows.mean())
        if self.flux_y is not None and abs(flows[-1] - told) < abs(flow - told):
            flow = float(flows[-1])  # outlets may lie at several heights: all solids pass the top
        if not abs(flow - told) <= FLOW_TOLERANCE * max(np.abs(flows).max(), abs(told)):
            raise ValueError(f"the solids flow through its levels is {flow:.3g} m³/s, by bulk_flow {told:.3g}")
        if self.psi is not None:
            for own, other in zip((self.flux_r, self.flux_z), flux_from_psi(self.psi, self.grid), strict=True):
                if not (np.abs(own - other) <= PSI_TOLERANCE * np.abs(self.flux_z).max()).all():
                    raise ValueError("psi is not the stream function of flux_r and flux_z")


def flux_from_psi(psi: Array, grid: Grid) -> tuple[Array, Array]:
    """Face fluxes of a stream function on the nodes: exactly divergence-free in every cell.

    With u = −(1/r)∂ψ/∂z and w = (1/r)∂ψ/∂r, the flow through a face is 2π times the difference of ψ between its ends;
    in the plane x–z, with u = −∂ψ/∂z and w = ∂ψ/∂x, it is the depth times that.

    Parameters
    ----------
    psi : (nz+1, nr+1) [m³/s per radian, or per metre of depth], 0 on the axis

    Returns
    -------
    flux_r, flux_z : (nz, nr+1), (nz+1, nr) [m/s]
    """
    turn = grid.measure.turn
    through_r, through_z = -turn * np.diff(psi, axis=0), turn * np.diff(psi, axis=1)
    flux_r = np.divide(through_r, grid.side_area, out=np.zeros_like(through_r), where=grid.side_area > 0)
    flux_z = through_z / grid.ring_area
    return flux_r, flux_z


def level_flow(flux_z: Array, grid: Grid) -> Array:
    """(nz+1,) flow through each horizontal level [m³/s], positive downwards."""
    return np.asarray(-(flux_z @ grid.ring_area).reshape(len(flux_z), -1).sum(axis=1))


def cell_vectors(flux_r: Array, flux_z: Array) -> Array:
    """(2, nz, nr) a vector given on the faces, its components averaged to the middle of each cell."""
    return np.array([0.5 * (flux_r[:, 1:] + flux_r[:, :-1]), 0.5 * (flux_z[1:] + flux_z[:-1])])


def cell_squares(flux_r: Array, flux_z: Array) -> Array:
    """(nz, nr) square of that vector."""
    return np.asarray((cell_vectors(flux_r, flux_z) ** 2).sum(axis=0))


def section_rows(grid: Grid, levels: Mapping[str, tuple[float, float]]) -> dict[str, Mask]:
    """(nz,) masks of the rows of the whole and of each section, from upper and lower levels [m]."""
    rows = {"whole": np.ones(grid.shape[0], dtype=bool)}
    return rows | {name: (grid.z_centres < top) & (grid.z_centres > low) for name, (top, low) in levels.items()}


def divergence(flux_r: Array, flux_z: Array, grid: Grid) -> Array:
    """(nz, nr) net outflow of each cell divided by its volume [1/s]."""
    outflow = np.diff(flux_r * grid.side_area, axis=1) + np.diff(flux_z, axis=0) * grid.ring_area
    return np.asarray(outflow / grid.cell_volume)
