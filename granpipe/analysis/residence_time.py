"""How long the solids stay in the vessel, streamline by streamline, from the stream function of a field.

Between two neighbouring streamlines as much flows out as in, so what is there stays as long as its volume over its
flow: T = dV/dQ, V(ψ) the solids on the axis side of a streamline and Q(ψ) = −2πψ what flows there. Mixing across
streamlines is not in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field

STREAMLINES = 100
"""Streamtubes of equal flow."""

_LEVELS = 8  # in every cell
_AT_REST = 1e-9  # of the flow: nearer to the ψ of axis or wall nothing moves


@dataclass(frozen=True)
class ResidenceTime:
    """Residence times at the flow rate of the case.

    Parameters
    ----------
    within : (n,) part of the flow between the axis and the middle of each streamtube
    time : (n,) residence time in it [s]
    outside : part of the solids that no streamline from inlet to outlet passes: at rest, or in closed eddies
    """

    within: Array
    time: Array
    outside: float

    def quantile(self, part: float) -> float:
        """Time [s] within which this part of the flow has passed."""
        return float(np.interp(part, self.within, np.sort(self.time)))


def residence_time(field: Field) -> ResidenceTime:
    """Residence times of a field; DataError where it has no stream function."""
    if field.psi is None:
        raise DataError("the field has no stream function to tell residence times by; use homogenize.method: psi")
    if field.grid.measure.walled:
        raise DataError("a mean over the depth tells no residence times where front and back walls hold solids back")
    wall = -field.bulk_flow * field.bulk_packing / field.grid.measure.turn
    low, high, solids = _rows(field, field.psi / wall)
    edges = np.linspace(0, 1, STREAMLINES + 1).clip(_AT_REST, 1 - _AT_REST)
    width = np.maximum(high - low, np.finfo(float).tiny)
    inside = np.array([solids @ ((edge - low) / width).clip(0, 1) for edge in edges])
    flow = field.bulk_flow * field.bulk_packing * field.flow_scale / STREAMLINES
    return ResidenceTime(
        within=(np.arange(STREAMLINES) + 0.5) / STREAMLINES,
        time=np.diff(inside) / flow,
        outside=float(1 - (inside[-1] - inside[0]) / solids.sum()),
    )


def _rows(field: Field, part: Array) -> tuple[Array, Array, Array]:
    """Thin rows through every bulk cell: the part of the flow within at both ends, the smaller first, and solids [m³].

    ψ is interpolated linearly in z, and along the row in r², in which that of a plug is linear: solids are then spread
    evenly between its values at the ends.
    """
    rows, columns = np.nonzero(field.bulk & (field.inside_fraction > 0))
    z = ((np.arange(_LEVELS) + 0.5) / _LEVELS)[:, None]
    inner, outer = ((1 - z) * part[rows, columns + out] + z * part[rows + 1, columns + out] for out in (0, 1))
    packing = field.bulk_packing if field.packing_fraction is None else field.packing_fraction[rows, columns]
    solids = packing * field.inside_fraction[rows, columns] * field.grid.cell_volume[columns] / _LEVELS
    ends = np.sort([inner.ravel(), outer.ravel()], axis=0)
    return ends[0], ends[1], np.tile(solids, _LEVELS)
