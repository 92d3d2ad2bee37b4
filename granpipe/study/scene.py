"""What a difference of fields means to who uses them: surfaces, voids, zones at rest, times of stay, temperatures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from granpipe.analysis.heat import HeatProblem, Stream, Temperature, solve_heat
from granpipe.analysis.residence_time import residence_time
from granpipe.analysis.surfaces import bulk_edge, displacement, stagnant_area, void_area
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Array, Field
from granpipe.geometry.outline import Outline
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

PECLET = 100.0
"""w D/κ at the outlet of the stated heat problem: a cold feed at 0, walls and obstacles at 1."""

QUANTILES = (0.1, 0.5, 0.9)

_ACROSS, _CORNERS = 20, 4  # elements of the heat problem's mesh


@dataclass(frozen=True)
class Measures:
    """Of one field.

    Parameters
    ----------
    edge : (n, 2) points on free surfaces and round cavities [m]
    void, stagnant : areas in the r–z section [m²]
    residence : part of the flow → time within which it has passed [s]; empty without a stream function
    temperature : of the stated problem, which has an axis; None without a stream function, and in a slab
    """

    edge: Array
    void: float
    stagnant: float
    residence: Mapping[float, float]
    temperature: Temperature | None

    def against(self, other: Measures) -> Iterator[tuple[str, float]]:
        """Differences from another field's measures, by name.

        Raises
        ------
        DataError : one of the surfaces has no point
        """
        if len(self.edge) and len(other.edge):
            yield "free surface, displacement [m]", displacement(self.edge, other.edge)
        yield "void area, difference [m²]", self.void - other.void
        yield "stagnant area, difference [m²]", self.stagnant - other.stagnant
        for part in self.residence.keys() & other.residence.keys():
            yield f"residence time P{100 * part:.0f}, difference", self.residence[part] / other.residence[part] - 1
        if self.temperature is not None and other.temperature is not None:
            yield "temperature, RMS difference", self.temperature.apart(other.temperature)[0]
            yield (
                "temperature at the outlet, difference",
                (self.temperature.outlet_mean - other.temperature.outlet_mean),
            )


class Scene:
    """The vessel of a study, with the mesh of its heat problem."""

    def __init__(self, case: Case) -> None:
        self._case, self._outline = case, Outline.from_case(case)
        self._mesh: RZMesh | None = None

    def measures(self, field: Field) -> Measures:
        """All measures of a field."""
        ends = (self._outline.z_bottom, self._outline.z_top)
        return Measures(
            edge=bulk_edge(field),
            void=void_area(field, ends),
            stagnant=stagnant_area(field, ends),
            residence=_residence(field),
            temperature=self._temperature(field),
        )

    def _temperature(self, field: Field) -> Temperature | None:
        if field.psi is None or not field.grid.measure.axial:
            return None
        if self._mesh is None:
            outline = self._outline
            self._mesh = mesh_section(
                outline.wall,
                outline.obstacles,
                self._case.outline.levels,
                cells_across=_ACROSS,
                corner_refinement=_CORNERS,
            )
        flow = Stream.on_grid(field.grid.r_edges, field.grid.z_edges, field.psi * field.velocity_scale)
        hot = {"wall": 1.0} | ({"obstacle": 1.0} if self._outline.obstacles else {})
        diffusivity = 2 * field.bulk_flow * field.flow_scale / (np.pi * self._outline.outlet_radius * PECLET)
        return solve_heat(HeatProblem(self._mesh, diffusivity, 1.0, hot | {"inlet": 0.0}), flow)


def _residence(field: Field) -> dict[float, float]:
    try:
        times = residence_time(field)
    except DataError:
        return {}
    return {part: times.quantile(part) for part in QUANTILES}
