"""What other methods would have made of the plain average that a result holds."""

from __future__ import annotations

from dataclasses import replace

from granpipe.field import Field
from granpipe.homogenize.conserve import scale_rows
from granpipe.homogenize.smooth import flowing_faces, smooth


def plain(field: Field) -> Field:
    """The plain average."""
    assert field.raw_flux_r is not None
    assert field.raw_flux_z is not None
    return replace(field, flux_r=field.raw_flux_r, flux_z=field.raw_flux_z, psi=None)


def paper(field: Field, passes: int) -> Field:
    """The article's way: rows scaled to one flow, smoothed by the 5×5 Gaussian so many times, scaled again."""
    raw, flow = plain(field), field.bulk_flow * field.bulk_packing
    faces = flowing_faces(field.bulk, field.inside_fraction)
    flux = scale_rows(raw.flux_r * faces[0], raw.flux_z * faces[1], field.grid, flow)
    flux = scale_rows(*smooth(*flux, faces, passes), field.grid, flow)
    return replace(raw, flux_r=flux[0], flux_z=flux[1])
