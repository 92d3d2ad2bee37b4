"""Vessels other than cones for the frictional fluid: flat-bottomed silos, a funnel, a cone on the axis, a free ring.

Every opening is at least 10 d wide; particles as in benchmarks/wall_factor.py. `granpipe run` takes the files that
`write` makes; `benchmarks/friction_fluid.py pack` takes the results.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Vessel:
    """An outline in units of d; contact friction, rolling friction and wall friction; when the run ends [s].

    Parameters
    ----------
    wall : (r, z) from top to bottom
    sections : name to (z above, z below)
    obstacles : name to (r, z)
    """

    name: str
    wall: Points
    sections: dict[str, tuple[float, float]]
    friction: tuple[float, float, float] = (0.5, 0.1, 0.3)
    obstacles: dict[str, Points] = field(default_factory=dict)
    time: float = 4.0

    def text(self) -> str:
        """The case file."""
        particle, rolling, wall = self.friction
        obstacles = "".join(f"\n    {name}: {_list(points)}" for name, points in self.obstacles.items())
        sections = ", ".join(f"{name}: [{6 * top:g}, {6 * low:g}]" for name, (top, low) in self.sections.items())
        return (
            f"""\
name: {self.name}
outline:
  unit: mm
  wall: {_list(self.wall)}
  sections: {{{sections}}}
"""
            + (f"  obstacles:{obstacles}\n" if obstacles else "")
            + f"""\
material:
  density: 2500 kg/m^3
  size: {{diameter: {{normal: {{mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}}}, classes: 3}}
contact:
  friction: {particle:g}
  rolling_friction: {rolling:g}
  wall: {{friction: {wall:g}}}
flow_rate: 0.2 kg/s
model: dem
dem: {{max_time: {self.time:g} s, reservoir_height: 30 mm, ranks: 1}}
export: []
figures: []
"""
        )


def _list(points: Points) -> str:
    return "[" + ", ".join(f"[{6 * r:g}, {6 * z:g}]" for r, z in points) + "]"


VESSELS = (
    Vessel("flat-10", ((10, 18), (10, 1), (5, 1), (5, 0)), {"shaft": (18, 9), "bottom": (9, 1), "outlet": (1, 0)}),
    Vessel(
        "flat-12",
        ((9.6, 16), (9.6, 1), (6, 1), (6, 0)),
        {"shaft": (16, 8), "bottom": (8, 1), "outlet": (1, 0)},
        (0.73, 0.21, 0.5),
    ),
    Vessel(
        "pebble-funnel",
        ((10, 14), (10, 6), (5, 1), (5, 0)),
        {"shaft": (14, 6), "hopper": (6, 1), "outlet": (1, 0)},
        (0.3, 0.0, 0.3),
    ),
    Vessel(
        "axis-cone",
        ((13, 24), (13, 11), (11, 5), (11, 0)),
        {"above": (24, 17), "cone": (17, 10), "below": (10, 0)},
        obstacles={"cone": ((0, 17), (2.8, 12), (0, 10), (0, 17))},
        time=2.0,
    ),
    Vessel(
        "free-ring",
        ((16.5, 16), (16.5, 0)),
        {"above": (16, 9), "ring": (9, 6), "below": (6, 0)},
        obstacles={"ring": ((5, 7.5), (5.7, 9), (6.4, 7.5), (5.7, 6), (5, 7.5))},
        time=2.0,
    ),
)


def write(folder: Path) -> None:
    """Write the case files."""
    folder.mkdir(parents=True, exist_ok=True)
    for vessel in VESSELS:
        (folder / f"{vessel.name}.yaml").write_text(vessel.text())
