"""What a slab, `outline.symmetry: plane`, cannot have: refused in one place, before anything is computed."""

from __future__ import annotations

from granpipe.case.schema import Case
from granpipe.errors import CaseError

EXPORTS = ("comsol", "vtk", "netcdf", "streamlines")
"""Formats that are made for x and z."""

DUMP_FIELDS = ("particle_velocity", "size_classes", "residence_time", "strain_rate", "age")
"""What of `homogenize.fields` dumps of a slab give: what needs every particle whole does not know where y ends."""


def check_plane(case: Case, by_dumps: bool = False) -> None:
    """Make sure that what a case asks for can be had in its vessel.

    Parameters
    ----------
    by_dumps : whether the flow comes from dumps of another simulation; no model is needed then

    Raises
    ------
    CaseError : a slab is to have what only a body of revolution can
    """
    if case.outline.symmetry == "axis":
        return
    if not by_dumps:
        if case.fluid.annulus is not None:
            raise CaseError("an annular outlet needs an axis; a slab has none", ("fluid", "annulus"))
        if case.dem.facets != "auto":
            raise CaseError("the walls of a slab are flat; leave it out", ("dem", "facets"))
        if "animation" in case.figures:
            raise CaseError("an animation is made for r and z only; leave it out in a slab", ("figures",))
    if case.homogenize.method != "psi":
        raise CaseError("in a slab only psi is possible", ("homogenize", "method"))
    if others := [name for name in case.export if name not in EXPORTS]:
        raise CaseError(f"{others[0]} is made for r and z only; in a slab choose of {', '.join(EXPORTS)}", ("export",))
    if by_dumps and (fields := [name for name in case.homogenize.fields if name not in DUMP_FIELDS]):
        raise CaseError(
            f"{fields[0]} is not made of dumps of a slab; choose of {', '.join(DUMP_FIELDS)}", ("homogenize", "fields")
        )


def depth_note(case: Case) -> str:
    """What the flow rate of a slab is that of; empty for a body of revolution."""
    depth = case.outline.depth
    return "" if depth is None else f"the flow rate is that of the whole depth of {depth:g} m"
