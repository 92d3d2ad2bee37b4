"""The flow of solids as its user sees it: bulk velocity at any point, at the flow rate of the process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granpipe.api.interpolation import Places, StreamSurface, bilinear, cells_at
from granpipe.errors import DataError
from granpipe.export.nodes import Nodes, nodal_errors, nodal_values
from granpipe.field import Array, Field
from granpipe.geometry.outline import Outline

if TYPE_CHECKING:
    import pyvista
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Profile:
    """A flow along a straight line, (n,) each; NaN outside the solids, None where the field does not know it.

    Parameters
    ----------
    r, z : the points [m]; without an axis r is x
    u, w : bulk velocity [m/s]
    packing : solids fraction
    u_error, w_error : standard errors of u and w [m/s]
    """

    r: Array
    z: Array
    u: Array
    w: Array
    packing: Array | None
    u_error: Array | None
    w_error: Array | None


@dataclass(frozen=True, eq=False, repr=False)
class Flow:
    """Flow on the r–z section of a vessel, or in a plane x–z, at the flow rate of the process.

    Velocities are bulk velocities U = F/φ_ref in SI (F the solids flux, φ_ref = `reference_packing`): U·dA is a volume
    flow of bulk, and ρ_s φ_ref U the mass flux. z points up, so what sinks has w < 0. Where dumps were averaged without
    a case there is no process, and all is at the scale of the dumps.

    Points are plain numbers in metres, scalars or arrays of any shapes that broadcast; values come back in that shape,
    NaN outside the solids: outside the vessel, in obstacles and in voids, and where a point is NaN or masked. Points on
    a wall have a value. In a plane x–z, r means x.

    Parameters
    ----------
    stored : the field as ``field.npz`` holds it, at simulation scale
    outline : the vessel; without one the cells of the grid tell where the solids end
    """

    stored: Field
    outline: Outline | None = None

    @property
    def flow_rate(self) -> float:
        """Flow of bulk that the velocities add up to [m³/s]."""
        return self.stored.bulk_flow * self.stored.flow_scale

    @property
    def reference_packing(self) -> float:
        """φ_ref, the solids fraction that turns solids flux into bulk velocity."""
        return self.stored.bulk_packing

    def velocity(self, r: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Radial and vertical bulk velocity u, w [m/s] at points r, z [m].

        Where the field has a stream function they are its derivatives: continuous, and free of divergence at every
        point (`granpipe.api.interpolation`). Otherwise they are bilinear between the nodes of the grid, as in the text
        files for COMSOL, and balance only as far as ``comsol/flow_levels.txt`` says.

        Raises
        ------
        ValueError : shapes of r and z that do not broadcast
        TypeError : a coordinate that is not made of real numbers, or has a unit of its own
        """
        if self._surface is None:
            u, w = self._bilinear(r, z, self.nodes.bulk_u, self.nodes.bulk_w)
            return u, w
        u, w = self._sampled(r, z, self._surface.velocity)
        return u, w

    def velocity_error(self, r: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Standard errors of u and w [m/s], bilinear between nodes; without those of flow rate and φ_ref.

        Raises
        ------
        DataError
            the field has none throughout: it is a fluid's, a hybrid's, or was averaged from fewer than 7 segments
        """
        errors = self._nodal_errors
        if errors is None:
            raise DataError(
                "this field does not have standard errors throughout: "
                "it is a fluid's or a hybrid's, or too few segments were averaged"
            )
        u, w = self._bilinear(r, z, errors.bulk_u, errors.bulk_w)
        return u, w

    def packing(self, r: ArrayLike, z: ArrayLike) -> Array:
        """Solids fraction φ, bilinear between nodes.

        Raises
        ------
        DataError : the field has none: a fluid knows only the packing of the case
        """
        if self.nodes.packing is None:
            raise DataError("this field has no packing: a fluid knows reference_packing alone")
        return self._bilinear(r, z, self.nodes.packing)[0]

    def psi(self, r: ArrayLike, z: ArrayLike) -> Array:
        """Stokes stream function of the bulk velocity [m³/s per radian]: u = −(1/r)∂ψ/∂z, w = (1/r)∂ψ/∂r.

        It is 0 on the axis and −`flow_rate`/2π on the outer wall. In a plane x–z: u = −∂ψ/∂z, w = ∂ψ/∂x, per metre of
        depth [m²/s].

        Raises
        ------
        DataError : the field has none: it is a plain or a Gaussian average
        """
        return self._sampled(r, z, lambda r, at: (self._stream.value(r, at),))[0]

    def profile(self, *, z: float | None = None, r: float | None = None, count: int = 201) -> Profile:
        """The flow along a level z, or along a vertical r [m], at `count` points from one end of the grid to the other.

        Raises
        ------
        ValueError : neither z nor r is given, or both are; it is not one number; fewer than 2 points
        TypeError : `count` is no whole number
        """
        if (z is None) == (r is None):
            raise ValueError("give either z or r")
        place = r if z is None else z
        assert place is not None
        if np.ndim(_coordinate(place)) or not np.isfinite(place):
            raise ValueError(f"a profile is along one level or vertical, a number in metres, not {place!r}")
        if _whole(count, "count") < 2:
            raise ValueError(f"count: a profile has at least 2 points, not {count}")
        edges = self.nodes.r if r is None else self.nodes.z
        along = np.linspace(edges[0], edges[-1], count)
        at_r, at_z = (along, np.full(count, z)) if r is None else (np.full(count, r), along)
        errors = (None, None) if self._nodal_errors is None else self.velocity_error(at_r, at_z)
        packing = None if self.nodes.packing is None else self.packing(at_r, at_z)
        return Profile(at_r, at_z, *self.velocity(at_r, at_z), packing, *errors)

    def streamlines(self, n: int = 10) -> list[Array]:
        """Lines (k, 2) of points r, z [m] from inlet to outlet, the innermost first; each carries an n-th of the flow.

        Raises
        ------
        DataError : the field has no stream function
        ValueError, TypeError : `n` is no whole number above 0
        """
        if _whole(n, "the number of stream lines") < 1:
            raise ValueError(f"the number of stream lines must be above 0, not {n}")
        from contourpy import contour_generator

        surface = self._stream
        part = -surface.psi * self.stored.grid.measure.turn / self.flow_rate
        lines = contour_generator(surface.x, surface.z, np.ma.array(part, mask=~self.nodes.solids))
        found = []
        for middle in (np.arange(n) + 0.5) / n:
            pieces: Any = lines.lines(middle)
            if pieces:
                line = max(pieces, key=len)  # shorter ones are closed eddies
                line = line if line[0, 1] > line[-1, 1] else line[::-1]
                r = np.sqrt(line[:, 0]) if surface.axial else line[:, 0]
                found.append(np.column_stack([r, line[:, 1]]))
        return found

    def plot(self, what: str = "w", axes: Axes | None = None) -> Axes:
        """Draw ``"u"``, ``"w"``, ``"speed"``, ``"packing"`` or ``"streamlines"`` with the vessel round it.

        Parameters
        ----------
        axes : what to draw on; matplotlib's pyplot makes new ones unless given

        Raises
        ------
        ValueError : `what` is none of these
        DataError : the field does not have it
        """
        from granpipe.export.pictures import draw_panel

        if axes is None:
            from matplotlib import pyplot

            axes = pyplot.subplots(layout="constrained")[1]
        draw_panel(axes, self.stored, what, *self._vessel, left=self._left)
        return axes

    def to_xarray(self) -> xarray.Dataset:
        """Values at the middles of the cells, dimensions z and r (or x), with units; NaN outside the solids.

        Raises
        ------
        ImportError : xarray is not installed; it comes with ``pip install granpipe[netcdf]``
        """
        import xarray

        across = self.nodes.measure.letter
        r, z = self.stored.grid.r_centres, self.stored.grid.z_centres
        places = r[None, :], z[:, None]
        values = {"u": (self.velocity(*places)[0], "m/s"), "w": (self.velocity(*places)[1], "m/s")}
        if self._nodal_errors is not None:
            u_error, w_error = self.velocity_error(*places)
            values |= {"u_error": (u_error, "m/s"), "w_error": (w_error, "m/s")}
        if self.nodes.packing is not None:
            values["packing"] = (self.packing(*places), "1")
        if self._surface is not None:
            values["psi"] = (self.psi(*places), "m3/s" if self.nodes.measure.axial else "m2/s")
        return xarray.Dataset(
            {name: (("z", across), array, {"units": unit}) for name, (array, unit) in values.items()},
            {"z": ("z", z, {"units": "m"}), across: (across, r, {"units": "m"})},
            {"flow_rate_m3_per_s": self.flow_rate, "reference_packing": self.reference_packing},
        )

    def to_pyvista(self) -> pyvista.UnstructuredGrid:
        """What ``field.vtu`` holds: cells as quads in the plane (x, z) = (r, z), velocities at their corners.

        Raises
        ------
        DataError : a value of the field is not a number
        """
        from pyvista import from_meshio

        from granpipe.export.vtk import vtu_mesh

        return from_meshio(vtu_mesh(self.stored))

    @cached_property
    def nodes(self) -> Nodes:
        """The flow on the nodes of the grid, as it is exported.

        Raises
        ------
        DataError : a value of the field is not a number
        """
        return nodal_values(self.stored)

    def __repr__(self) -> str:
        return _described(self.stored, f"{self.nodes.measure.letter}–z", self.flow_rate)

    def _repr_png_(self) -> bytes:
        """The picture that a notebook shows."""
        from granpipe.export.pictures import overview

        stream = BytesIO()
        overview(self.stored, *self._vessel, left=self._left).savefig(stream, format="png", dpi=80)
        return stream.getvalue()

    @property
    def _left(self) -> list[tuple[float, float]] | None:
        """The left wall of a slab."""
        return None if self.outline is None else self.outline.left_wall

    @property
    def _vessel(self) -> tuple[Any, Mapping[str, Any]]:
        """Wall and obstacles to draw; without an outline the grid's edge."""
        if self.outline is not None:
            return self.outline.wall, self.outline.obstacles
        r, z = self.nodes.r[-1], self.nodes.z
        return [(r, z[-1]), (r, z[0])], {}

    @cached_property
    def _surface(self) -> StreamSurface | None:
        return None if self.nodes.psi is None else StreamSurface.of(self.stored, self.nodes)

    @property
    def _stream(self) -> StreamSurface:
        if self._surface is None:
            raise DataError("this field has no stream function; homogenize.method: psi makes one")
        return self._surface

    @cached_property
    def _nodal_errors(self) -> Nodes | None:
        return nodal_errors(self.stored)

    def _bilinear(self, r: ArrayLike, z: ArrayLike, *values: Array) -> tuple[Array, ...]:
        return self._sampled(r, z, lambda _, at: tuple(bilinear(array, at) for array in values))

    def _sampled(
        self, r: ArrayLike, z: ArrayLike, values: Callable[[Array, Places], tuple[Array, ...]]
    ) -> tuple[Array, ...]:
        """Values of functions of r and of places in cells, in the shape of the points."""
        nodes = self.nodes
        points = np.broadcast_arrays(_coordinate(r), _coordinate(z))
        radius, height = points[0].ravel(), points[1].ravel()
        (row, column), found = cells_at((nodes.r, nodes.z), (radius, height), nodes.cells)
        if self.outline is not None:
            found &= self.outline.contains(radius, height)
        row, column, radius, height = row[found], column[found], radius[found], height[found]
        up, out = ((place - edges[cell]) / (edges[cell + 1] - edges[cell])
                   for place, edges, cell in ((height, nodes.z, row), (radius, nodes.r, column)))  # fmt: skip
        return tuple(
            _scattered(array, found, points[0].shape) for array in values(radius, Places(row, column, up, out))
        )


@dataclass(frozen=True, eq=False, repr=False)
class SpaceFlow:
    """Flow in space: of a case with a ``vessel``, or averaged from dumps (``granpipe homogenize --plane xyz``).

    At the flow rate of the process, or, without a case, at the scale of the dumps.

    Values are linear between the middles of the cells that hold solids, and NaN in those that hold none. Velocities are
    bulk velocities U = F/φ_ref in SI.

    Parameters
    ----------
    stored : the field as ``field.npz`` holds it
    """

    stored: Field

    def velocity(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[Array, Array, Array]:
        """Bulk velocity along x, y and z [m/s] at points [m]; arrays of any shapes that broadcast."""
        return self._velocity(self.stored, x, y, z)

    def velocity_error(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[Array, Array, Array]:
        """Standard errors of the velocity [m/s].

        Raises
        ------
        DataError : the field has none
        """
        field = self.stored
        if field.flux_r_se is None or field.flux_y_se is None or field.flux_z_se is None:
            raise DataError("this field has no standard errors: too few snapshots were averaged")
        errors = replace(field, flux_r=field.flux_r_se, flux_y=field.flux_y_se, flux_z=field.flux_z_se)
        return self._velocity(errors, x, y, z)

    def packing(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
        """Solids fraction φ."""
        assert self.stored.packing_fraction is not None  # dumps tell it
        return self._sampled(self.stored.packing_fraction, x, y, z)

    def to_xarray(self) -> xarray.Dataset:
        """Values at the middles of the cells, dimensions z, y and x, with units; NaN where no solids are.

        Raises
        ------
        ImportError : xarray is not installed; it comes with ``pip install granpipe[netcdf]``
        """
        import xarray

        places = dict(zip("zyx", self._middles, strict=True))
        z, y, x = np.meshgrid(*self._middles, indexing="ij", sparse=True)
        values = {name: (array, "m/s") for name, array in zip("uvw", self.velocity(x, y, z), strict=True)}
        values["packing"] = (self.packing(x, y, z), "1")
        return xarray.Dataset(
            {name: (("z", "y", "x"), array, {"units": unit}) for name, (array, unit) in values.items()},
            {name: (name, middles, {"units": "m"}) for name, middles in places.items()},
            {"reference_packing": self.stored.bulk_packing},
        )

    def to_pyvista(self) -> pyvista.RectilinearGrid:
        """What ``field.vtr`` holds."""
        from granpipe.export.space import vtr_mesh

        return vtr_mesh(self.stored)

    def __repr__(self) -> str:
        return _described(self.stored, "space", self.stored.bulk_flow * self.stored.flow_scale)

    @property
    def _middles(self) -> list[Array]:
        return [0.5 * (edges[1:] + edges[:-1]) for edges in self._edges]

    @property
    def _edges(self) -> tuple[Array, Array, Array]:
        from granpipe.export.space import box_of

        grid = box_of(self.stored)
        return grid.z_edges, grid.y_edges, grid.r_edges

    def _velocity(self, field: Field, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[Array, Array, Array]:
        from granpipe.export.space import cell_fluxes

        u, v, w = (self._sampled(flux * field.velocity_scale, x, y, z) for flux in cell_fluxes(field))
        return u, v, w

    def _sampled(self, values: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
        from scipy.ndimage import map_coordinates

        points = np.broadcast_arrays(*map(_coordinate, (x, y, z)))
        flat = tuple(array.ravel() for array in points)
        _, found = cells_at(tuple(reversed(self._edges)), flat, self.stored.bulk)
        places = np.array(
            [(place[found] - middles[0]) / (edges[1] - edges[0])
             for place, middles, edges in zip(reversed(flat), self._middles, self._edges, strict=True)]
        )  # fmt: skip
        total, weight = (map_coordinates(np.where(self.stored.bulk, array, 0.0), places, order=1, mode="nearest")
                         for array in (values, np.ones(values.shape)))  # fmt: skip
        return _scattered(total / weight, found, points[0].shape)


def _coordinate(values: ArrayLike) -> Array:
    """Coordinates [m] as floats, NaN where they are masked.

    TypeError where they are no real numbers, or a quantity whose unit would be lost.
    """
    united = hasattr(values, "magnitude") and hasattr(values, "units")
    array = np.empty(0) if united else np.asanyarray(values)
    if united or not (array.dtype.kind in "iuf" or array.size == 0):
        remedy = ", such as by q.m_as('m')" if united else ""
        raise TypeError(f"coordinates are plain numbers in metres, not {type(values).__name__}: {values!r:.60}{remedy}")
    return np.ma.filled(array.astype(float), np.nan)


def _whole(value: Any, name: str) -> int:
    """A whole number; TypeError where it is none."""
    try:
        return index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, not {value!r}") from None


def _scattered(values: Array, where: Any, shape: tuple[int, ...]) -> Array:
    """Values at the points that have one, NaN at the others, in the shape of the points."""
    array = np.full(where.shape, np.nan)
    array[where] = values
    return np.asarray(array).reshape(shape)[()]


def _described(field: Field, where: str, flow_rate: float) -> str:
    known = ["velocity"]
    known += ["packing"] if field.packing_fraction is not None else []
    known += ["psi"] if field.psi is not None else []
    known += ["standard errors"] if field.flux_z_se is not None and not np.isnan(field.flux_z_se).any() else []
    cells = " × ".join(map(str, field.grid.shape))
    return f"<Flow in {where}: {', '.join(known)} on {cells} cells of {field.grid.cell:.3g} m, {flow_rate:.4g} m³/s>"
