"""Which solids touch: axis, wall and obstacles, in groups that hang together.

In the (r, z) half-plane the axis bounds the vessel on the left and the wall on the right; in a slab the left wall takes
the part of the axis. Particles find a way from the
inlet to the outlet exactly if no chain of touching solids joins the two.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

from granpipe.field import Array
from granpipe.geometry.polyline import closest_approach, edges_of, farther

AXIS, WALL = "\0axis", "\0wall"  # no obstacle can have these names


class Groups:
    """Solids joined into groups."""

    def __init__(self, names: Iterable[str]) -> None:
        from scipy.cluster.hierarchy import DisjointSet

        self._sets = DisjointSet([AXIS, WALL, *names])

    def join(self, a: str, b: str) -> None:
        """Make one group of the groups of a and b."""
        self._sets.merge(a, b)

    def joined(self, a: str, b: str) -> bool:
        """Whether a and b belong to one group."""
        return bool(self._sets.connected(a, b))

    def bridged_by(self, a: str, b: str) -> bool:
        """Whether joining a and b would close the way between axis and wall."""
        return any(self.joined(a, end) and self.joined(b, other) for end, other in ((AXIS, WALL), (WALL, AXIS)))


def touching_groups(left: Array, wall: Array, obstacles: Mapping[str, Array], tolerance: float) -> Groups:
    """Groups of solids that touch: axis or left wall (m, 2), wall (n, 2), and obstacles (closed polygons)."""
    groups = Groups(obstacles)
    borders = {name: edges_of(polygon, closed=True) for name, polygon in obstacles.items()}
    for name, border in borders.items():
        if closest_approach(border, edges_of(left))[0] <= tolerance:
            groups.join(name, AXIS)
        if closest_approach(border, edges_of(wall))[0] <= tolerance:
            groups.join(name, WALL)
    for a, b in combinations(borders, 2):
        if farther(obstacles[a], obstacles[b], tolerance):
            continue
        if closest_approach(borders[a], borders[b])[0] <= tolerance:
            groups.join(a, b)
    return groups
