"""What a slab, `outline.symmetry: plane`, cannot have: refused in one place, before anything is computed."""

from __future__ import annotations

from granpipe.case.schema import Case
from granpipe.errors import CaseError, KeyPath

EXPORTS = ("comsol", "vtk", "netcdf", "streamlines")
"""Formats that are made for x and z."""

DUMP_FIELDS = ("particle_velocity", "size_classes", "residence_time", "strain_rate", "age")
"""What of `homogenize.fields` dumps of a slab give: what needs every particle whole does not know where y ends."""

NOT_OF_MEANS = ("residence_time", "age", "strain_rate", "granular_temperature")
"""What a mean over the depth does not tell where front and back walls hold solids back: paths, and shear along y."""


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
    if case.outline.walled:
        _check_means(case)
    if by_dumps and (fields := [name for name in case.homogenize.fields if name not in DUMP_FIELDS]):
        raise CaseError(
            f"{fields[0]} is not made of dumps of a slab; choose of {', '.join(DUMP_FIELDS)}", ("homogenize", "fields")
        )


def _check_means(case: Case) -> None:
    """CaseError for what does not follow from the mean over a depth along which solids are slower at its ends."""
    fields: KeyPath = ("homogenize", "fields")
    asked: list[tuple[str, KeyPath]] = [(name, fields) for name in case.homogenize.fields if name in NOT_OF_MEANS]
    asked += [(name, ("export",)) for name in case.export if name == "streamlines"]
    for name, key in asked:
        raise CaseError(
            f"{name} does not follow from a mean over the depth, and solids are slower at the front and the back "
            "wall; leave it out",
            key,
        )


def check_model_between_walls(case: Case, model: str) -> None:
    """CaseError for a model other than particles, of the whole or of a section, in a slab with front and back walls."""
    if not case.outline.walled:
        return
    asked: list[KeyPath] = [("total_error",)] if case.total_error is not None else []
    asked += [("model",)] if model not in ("auto", "dem") else []
    if case.model == "auto":
        fluid = [name for name, section in case.outline.sections.items() if section.model == "fluid"]
        asked += [("outline", "sections", name, "model") for name in fluid]
    for key in asked:
        raise CaseError(
            "a fluid knows no front and back walls, outline.front_and_back; a slab between them is computed by "
            "particles only: set model: dem" + (" and leave this out" if key != ("model",) else ""),
            key,
        )


def depth_note(case: Case) -> str:
    """What the flow rate of a slab is that of, and the field; empty for a body of revolution."""
    if case.outline.depth is None:
        return ""
    rate = f"the flow rate is that of the whole depth of {case.outline.depth:g} m"
    mean = ", and the field the mean over it: solids are slower at the front and the back wall than midway"
    return rate + mean * case.outline.walled
