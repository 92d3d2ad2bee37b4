"""What the DEM stages note of themselves, as JSON in their folders of the store: written whole and read strictly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import Field

from granpipe.system.jsonfile import read_json, write_json

Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
Ranks = Annotated[int, Field(ge=1)]


@dataclass(frozen=True)
class _Record:
    name: ClassVar[str]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """That of a folder.

        Raises
        ------
        DataError : there is none, or it is not what a stage writes
        """
        return read_json(folder / cls.name, cls)

    def write(self, folder: Path) -> None:
        """Put it into a folder."""
        write_json(folder / self.name, asdict(self))


@dataclass(frozen=True)
class WallRecord(_Record):
    """Of the stage walls: `granpipe.geometry.walls.Walls` without its files; lengths in m, the area in m²."""

    name: ClassVar[str] = "walls.json"
    facets: Count
    sides: tuple[tuple[Finite, Finite], tuple[Finite, Finite]]
    inward: Amount
    triangles: Mapping[str, Count]
    plate_area: Amount


@dataclass(frozen=True)
class OverlapRecord:
    """Mean overlap of the contacts of a bed, and its 99th percentile, as parts of a diameter."""

    mean: Amount
    p99: Amount


@dataclass(frozen=True)
class SettleRecord(_Record):
    """Of the stage settle.

    LIGGGHTS inserts the largest particles first: a shortfall distorts the sizes, so their shares of the mass are noted.
    `inserted` counts those of the packed bed as well.
    """

    name: ClassVar[str] = "settle.json"
    steps: Count
    particles: Count
    inserted: Count
    short_insertions: Count
    mass_share: tuple[Amount, ...]
    wanted_mass_share: tuple[Amount, ...]
    youngs_modulus: Positive
    overlap: OverlapRecord
    wall_seconds: Amount
    processor_seconds: Amount
    ranks: Ranks


@dataclass(frozen=True)
class SegmentRecord(_Record):
    """Of a segment of production. Seconds are counted since LIGGGHTS was last started.

    Parameters
    ----------
    particles : in the bed at its end
    inserted, discharged, discharged_mass_kg : LIGGGHTS' own counters, up to the step `counted_to_step`
    overlap : of the bed at the end
    reference_overlap : mean overlap where the reference packing is taken
    averaging_seconds, checking_seconds : processor time of granpipe
    """

    name: ClassVar[str] = "segment.json"
    particles: Count
    inserted: int
    discharged: int
    discharged_mass_kg: Annotated[float, Field(allow_inf_nan=False)]
    counted_to_step: Count
    overlap: OverlapRecord
    reference_overlap: Amount
    averaging_seconds: Amount
    checking_seconds: Amount
    wall_seconds: Amount
    processor_seconds: Amount
    ranks: Ranks
