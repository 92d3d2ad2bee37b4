"""Friction of the bulk and of its walls, and the angle of its surfaces, for a frictional fluid: value and source."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.fluid.bulk_friction import bulk_friction_law

REPOSE_SLOPE, REPOSE_START = 1.92, 0.146
"""tan of the angle of free surfaces = 1.92 (μ_i − 0.146), at least μ_i: the line through the flowing surfaces of
docs/validation/free_surface.md (22°, 28° and 33° for μ_i = 0.36, 0.42 and 0.49)."""


@dataclass(frozen=True)
class BulkFriction:
    """What a frictional fluid goes by.

    Parameters
    ----------
    internal, wall : μ_i, μ_w
    repose : angle of free surfaces from the horizontal [rad]
    sources : of the three, in words
    """

    internal: float
    wall: float
    repose: float
    sources: tuple[str, str, str]

    def decisions(self) -> Iterator[Decision]:
        """The three as lines of the plan."""
        values = (f"{self.internal:.3g}", f"{self.wall:.3g}", f"{math.degrees(self.repose):.3g}°")
        names = ("bulk friction", "wall friction of the bulk", "angle of free surfaces")
        for name, value, source in zip(names, values, self.sources, strict=True):
            yield Decision(name, value, source)


def bulk_friction(case: Case) -> BulkFriction:
    """By the angles of shear tests that the case gives, or else by the law measured for its contact parameters.

    In simple shear the effective angle δ of a shear test is sin δ = μ_i (the principal stresses lie at 45°), a wall's
    is tan δ_w = μ_w.
    """
    contact, material, law = case.contact, case.material, bulk_friction_law()
    by_law = "law fit to shear cells of DEM"
    internal = law.internal(contact.friction, contact.rolling_friction)
    source = f"{by_law}, scatter {law.scatter:.2g}; "
    source += f"contact.friction {contact.friction:g}, rolling_friction {contact.rolling_friction:g}"
    if (angle := material.internal_friction_angle) is not None:
        internal, source = math.sin(angle), "sin of material.internal_friction_angle"
    wall = law.wall(contact.wall.friction, contact.friction, contact.wall.rolling_friction)
    wall_source = f"{by_law}, scatter {law.wall_scatter:.2g}; contact.wall.friction {contact.wall.friction:g}"
    if (angle := material.wall_friction_angle) is not None:
        wall, wall_source = math.tan(angle), "tan of material.wall_friction_angle"
    if wall > internal:
        wall, wall_source = internal, "as within the bulk: no wall rubs more"
    repose = repose_of(internal)
    repose_source = "from the bulk friction, by surfaces measured in DEM"
    if material.repose_angle is not None:
        repose, repose_source = material.repose_angle, "material.repose_angle"
    return BulkFriction(internal, wall, repose, (source, wall_source, repose_source))


def repose_of(internal: float) -> float:
    """Angle of free surfaces [rad] of a bulk with friction μ_i, by `REPOSE_SLOPE`."""
    return math.atan(max(internal, REPOSE_SLOPE * (internal - REPOSE_START)))
