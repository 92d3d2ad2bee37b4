"""Attacks on drawings, through ``granpipe outline`` and cases that name a drawing."""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from fakes.drawings import write_csv, write_dxf, write_mphtxt, write_step
from numpy.typing import NDArray

from attacks.attack import Attack, Ran, Right, granpipe, not_wrong, refused, right, run, told, unique
from attacks.cases import SILO, varied, volume

Points = Sequence[Sequence[float]]
Maker = Callable[[Path], object]
Triangles = NDArray[np.float64]
"""(n, 3, 3) corners."""

WALL: Points = [(1.0, 4.0), (1.0, 2.0), (0.5, 1.0), (0.5, 0.0)]
RING: Points = [(0.7, 3.0), (1.0, 3.0), (1.0, 2.5), (0.7, 2.5)]
INSIDE: Points = [(0.0, 4.0), *WALL, (0.0, 0.0)]

EMPTY = math.pi * (2 + 1.75 / 3 + 0.25)
RINGED = EMPTY - math.pi * 0.5 * (1 - 0.7**2)


def attacks() -> list[Attack]:
    """Every attack on drawings."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (dxf, csv, mphtxt, stl, obj, cad, files, options, cases)
    return unique([attack for kind in kinds for attack in kind()])


def drawn(
    kind: str, name: str, file: str, made: Maker | str | bytes, what: Right, *options: str, pinned: bool = False
) -> Attack:
    """An attack on ``granpipe outline`` by what is in a file; its unit is the metre unless options give one."""
    unit = () if "--unit" in options or "--no-unit" in options else ("--unit", "m")
    more = tuple(one for one in options if one != "--no-unit")
    return Attack(kind, name, granpipe("outline", file, *unit, *more, files={file: made}), what, pinned)


def moved(points: Points, by: tuple[float, float] = (0, 0), turn: float = 0.0, times: float = 1.0) -> Points:
    """Points scaled, turned [deg] about the origin and shifted."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return [(times * (c * x - s * y) + by[0], times * (s * x + c * y) + by[1]) for x, y in points]


def mirrored(points: Points) -> Points:
    """The other half."""
    return [(-x, y) for x, y in points]


# --- DXF --------------------------------------------------------------------------------------------------------------


def lines(*drawn_lines: tuple[str, Points, bool], insunits: int = 0) -> Maker:
    """A DXF of polylines: layer, points, closed."""
    return lambda path: write_dxf(path, drawn_lines, insunits)


def entities(text: str) -> str:
    """A DXF of entities written by hand, a group's code and value on each line."""
    pairs = "\n".join("\n".join(row.split(" ", 1)) for row in text.splitlines())
    return f"0\nSECTION\n2\nENTITIES\n{pairs}\n0\nENDSEC\n0\nEOF\n"


def dxf() -> Iterator[Attack]:
    """Drawings of CAD programs."""

    def of(name: str, made: Maker | str | bytes, what: Right, *options: str, pinned: bool = False) -> Attack:
        return drawn("DXF", name, "a.dxf", made, what, *options, pinned=pinned)

    wall, ring, silo = ("0", WALL, False), ("0", RING, True), right(volume(EMPTY))
    yield of("half section", lines(wall), silo)
    yield of("with a ring", lines(wall, ring), right(volume(RINGED)))
    yield of("both halves", lines(wall, ("0", mirrored(WALL), False)), silo)
    yield of("left half alone", lines(("0", mirrored(WALL), False)), not_wrong("axis", check=volume(EMPTY)))
    both = [("0", moved(one, (5, 7)), False) for one in (WALL, mirrored(WALL))]
    yield of("both halves far from the origin", lines(*both), silo, pinned=True)
    yield of("half section beside x = 0", lines(("0", moved(WALL, (5, 0)), False)), told("axis at 0"))
    yield of("the same with --axis", lines(("0", moved(WALL, (5, 0)), False)), silo, "--axis", "5")
    yield of("left of x = 0 and not symmetrical", lines(("0", moved(WALL, (-0.7, 0)), False)), refused("axis"))
    yield of("lying", lines(("0", moved(WALL, turn=-90), False)), refused())
    yield of("lying, --up x", lines(("0", moved(WALL, turn=-90), False)), not_wrong(check=volume(EMPTY)), "--up", "x")
    yield of("upside down, --up -y", lines(("0", [(x, -y) for x, y in WALL], False)), silo, "--up", "-y")
    slanted = [("0", moved(one, turn=1), False) for one in (WALL, mirrored(WALL))]
    yield of("turned by 1°", lines(*slanted), refused("axis"), pinned=True)
    yield of("mm by the file", lines(("0", moved(WALL, times=1e3), False), insunits=4), silo, "--no-unit")
    yield of(
        "mm by the file, cm by hand",
        lines(("0", moved(WALL, times=1e2), False), insunits=4),
        told("the file says mm", check=volume(EMPTY)),
        "--unit",
        "cm",
    )
    yield of("no unit", lines(wall), refused("unit"), "--no-unit", pinned=True)
    yield of("an unknown unit of the file", lines(wall, insunits=99), refused("unit"), "--no-unit")
    for unit in ("kg", "parsek", "m/s", "../x"):
        yield of(f"unit {unit}", lines(wall), refused("unit"), "--unit", unit)
    yield of("drawn twice", lines(wall, wall), silo)
    yield of("drawn twice, 1e-9 apart", lines(wall, ("0", moved(WALL, (1e-9, 0)), False)), silo)
    yield of("drawn twice, 5 mm apart", lines(wall, ("0", moved(WALL, (5e-3, 0)), False)), refused())
    yield of("ring drawn twice", lines(wall, ring, ring), right(volume(RINGED)), pinned=True)
    yield of("ring with a point twice", lines(wall, ("0", [RING[0], *RING], True)), right(volume(RINGED)))
    yield of("gap of 1 cm", lines(("0", WALL[:2], False), ("0", moved(WALL[1:], (0, -0.01)), False)), refused("gap"))
    yield of("gap of 1e-9", lines(("0", WALL[:2], False), ("0", [(1, 2 - 1e-9), *WALL[2:]], False)), silo)
    yield of("gap of half the vessel", lines(("0", WALL[:2], False), ("0", WALL[2:], False)), refused())
    yield of(
        "pieces in any order",
        lines(*(("0", piece, False) for piece in ([WALL[3], WALL[2]], [WALL[0], WALL[1]], [WALL[2], WALL[1]]))),
        silo,
    )
    yield of("closed with the axis", lines(("0", INSIDE, True)), silo)
    yield of("wall with its thickness", lines(("0", [*WALL, *moved(WALL[::-1], (0.1, 0))], True)), refused("thickness"))
    yield of(
        "layer wall among others",
        lines(("wall", WALL, False), ("dim", [(0, 0), (9, 9)], False)),
        told("left out: layers dim", check=volume(EMPTY)),
    )
    yield of("layer wall twice", lines(("wall", WALL, False), ("WALL", WALL, False)), silo)
    yield of("an obstacle on the layer wall", lines(("wall", WALL, False), ("wall", RING, True)), right(volume(RINGED)))
    yield of(
        "an obstacle on a layer of its own", lines(wall, ("obstacle", RING, True)), right(volume(RINGED)), pinned=True
    )
    yield of("obstacles alone", lines(("obstacle", RING, True)), refused("no wall"), pinned=True)
    yield of("a slanted axis", lines(wall, ("axis", [(0, 0), (0.5, 4)], False)), refused("upright"))
    yield of(
        "an axis at 0.25",
        lines(("wall", WALL, False), ("axis", [(0.25, 0), (0.25, 4)], False)),
        right(volume(math.pi * (2 * 0.75**2 + (0.75**2 + 0.75 * 0.25 + 0.25**2) / 3 + 0.25**2))),
    )
    yield of("a line across", lines(wall, ("0", [(0, 1.5), (0.75, 1.5)], False)), refused("crosses"))
    yield of("a loose line", lines(wall, ("0", [(0.2, 3), (0.4, 2.8)], False)), refused("loose"))
    yield of("two vessels", lines(wall, ("0", moved(WALL, (5, 0)), False)), refused())
    yield of("ends in a point above", lines(("0", [(0, 5), *WALL[1:]], False)), refused("inlet"))
    yield of("ends in a point below", lines(("0", [*WALL[:-1], (0, 0)], False)), refused("outlet"))
    crossing = [(1, 4), (0.5, 1), (1.2, 2), (0.4, 3), (0.5, 0)]
    yield of("a wall that crosses itself", lines(("0", crossing, False)), refused())
    yield of(
        "an overhang", lines(("0", [(1, 4), (1, 2), (0.6, 2.3), (0.5, 1), (0.5, 0)], False)), right(volume(_overhang()))
    )
    circle = entities("0 LINE\n8 0\n10 1\n20 4\n11 1\n21 0\n0 CIRCLE\n8 0\n10 0.5\n20 2\n40 0.1")
    torus = 2 * math.pi**2 * 0.5 * 0.1**2
    yield of("a hole that is a circle", circle, right(volume(4 * math.pi - torus, 1e-3)))
    for value in ("nan", "inf", "1e300", "-1e300", "1e15", "x", ""):
        text = entities(f"0 LINE\n8 0\n10 1\n20 4\n11 1\n21 {value}")
        yield of(f"a coordinate {value!r}", text, refused(), pinned=value in ("nan", "inf"))
    yield of("all at one place", lines(("0", [(1, 1), (1, 1)], False)), refused())
    yield of("1e-9 m small", lines(("0", moved(WALL, times=1e-9), False)), not_wrong(check=volume(EMPTY * 1e-27)))
    yield of("1e8 m large", lines(("0", moved(WALL, times=1e8), False)), not_wrong(check=volume(EMPTY * 1e24)))
    curve = [(1 + 0.5 * math.cos(t), 2 * (1 - t / math.pi)) for t in np.linspace(0, math.pi, 3000).tolist()]
    yield of("3000 points", lines(("0", curve, False)), right(volume(2.25 * math.pi, 1e-4)))
    yield of("nothing drawn", lines(), refused("no lines"))
    yield of("a text alone", entities("0 TEXT\n8 0\n10 0\n20 0\n40 1\n1 vessel"), refused("no lines"))
    yield of("empty", "", refused("DXF"), pinned=True)
    yield of("a picture", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), refused("DXF"))
    yield of("zeros", bytes(4000), refused("DXF"))
    yield of("a table of numbers", "1,4\n1,0\n", refused("DXF"))
    for share in (0.3, 0.6, 0.9):
        yield of(f"cut at {share:.0%}", _cut(lines(wall, ring), share), refused())
    yield of(
        "a thousand rings",
        lines(
            wall,
            *(("0", [(0.5, 3.9 - k / 600), (0.6, 3.9 - k / 600), (0.6, 3.8995 - k / 600)], True) for k in range(1000)),
        ),
        refused("obstacles, more than"),
    )


def _overhang() -> float:
    """Volume below the lip of `an overhang`: the shadow of the lip between z = 2 and 2.3 holds solids, too [m³]."""
    upper = math.pi * 1.7  # z 2.3 … 4
    # z 2 … 2.3: from the lip's upper face out to the wall, and within its lower face
    outer = math.pi * (0.3 * 1 - 0.3 * (1 + 0.6 + 0.36) / 3)
    r_top, r_low = 0.6, 0.6 - 0.1 * 0.3 / 1.3
    inner = math.pi * 0.3 * (r_top**2 + r_top * r_low + r_low**2) / 3
    below = math.pi * (1.0 * (r_low**2 + r_low * 0.5 + 0.25) / 3 + 0.25)
    return upper + outer + inner + below


def _cut(made: Maker, share: float) -> Maker:
    """The first part of what is made."""

    def cut(path: Path) -> None:
        made(path)
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return cut


# --- tables -----------------------------------------------------------------------------------------------------------


def csv() -> Iterator[Attack]:
    """Tables of r and z."""

    def of(name: str, made: Maker | str | bytes, what: Right, *options: str, pinned: bool = False) -> Attack:
        return drawn("CSV", name, "a.csv", made, what, *options, pinned=pinned)

    rows, silo = "\n".join(f"{r},{z}" for r, z in WALL), right(volume(EMPTY))
    yield of("with a head", "r,z\n" + rows, silo)
    yield of("without a head", rows, silo)
    yield of("from the bottom up", "\n".join(rows.splitlines()[::-1]), silo)
    yield of(
        "lines of Windows and a mark",
        ("r;z\r\n" + rows.replace(",", ";").replace("\n", "\r\n")).encode("utf-8-sig"),
        silo,
    )
    yield of("decimal commas", rows.replace(",", ";").replace(".", ","), silo, pinned=True)
    yield of("decimal commas between commas", rows.replace(".", ","), refused("line 1"), pinned=True)
    yield of("tabs", rows.replace(",", "\t"), silo)
    yield of("comments", "# vessel\n% of mine\n" + rows, silo)
    yield of("points twice", "\n".join(row for row in rows.splitlines() for _ in (0, 1)), silo)
    yield of("columns swapped", "\n".join(f"{z},{r}" for r, z in WALL), refused())
    yield of("three columns", rows.replace("\n", ",0\n") + ",0", refused("two numbers"))
    yield of("one column", "1\n2\n3\n", refused("two numbers"))
    yield of("one row", "1,4\n", refused())
    yield of("text in a row", rows + "\nend of the wall\n", refused("line 5"))
    yield of("units in the rows", rows.replace(",", " m,"), refused("line 1|two numbers"))
    yield of("a quote", '"1.0","4.0"\n"1.0","0.0"\n', not_wrong(check=volume(4 * math.pi)))
    for value in ("nan", "inf", "1e400", "1e300", "0x1", "1_0"):
        yield of(f"a number {value}", f"1,4\n{value},2\n0.5,0\n", refused())
    yield of("fullwidth digits", "１,4\n１,0\n", not_wrong(check=volume(4 * math.pi)))
    yield of("negative radius", "-1,4\n-1,2\n-0.5,0\n", refused("negative radius"))
    yield of(
        "wall with its thickness",
        "\n".join(f"{r},{z}" for r, z in [*WALL, *moved(WALL[::-1], (0.1, 0)), WALL[0]]),
        refused("thickness"),
    )
    yield of("ring of two rows", rows + "\n\n0.3,3\n0.4,3\n", refused("loose"))
    yield of("ring outside", rows + "\n\n1.2,3\n1.4,3\n1.4,2.5\n1.2,3\n", refused())
    yield of("blank", "\n\n\n", refused("no polyline"))
    yield of("UTF-16", ("r,z\n" + rows).encode("utf-16"), refused("UTF-8"))
    yield of("Latin-1", ("Höhe\n" + rows).encode("latin-1"), refused("UTF-8"))
    yield of("zeros between", rows.replace("\n", "\0\n"), refused())
    yield of("a DXF", lambda path: write_dxf(path, [("0", WALL, False)]), refused("two numbers"))
    yield of("1 GB", lambda path: os.truncate(_touched(path), 10**9), refused("larger than"))
    yield of(
        "200 000 rows", "\n".join(f"1,{4 - k / 50_000}" for k in range(200_001)), not_wrong(check=volume(4 * math.pi))
    )


def _touched(path: Path) -> Path:
    path.touch()
    return path


# --- meshes of COMSOL -------------------------------------------------------------------------------------------------

CORNERS: Points = [(0, 0), (1, 0), (1, 2), (0, 2), (1, 4), (0, 4)]
TRIANGLES = [(0, 1, 2), (0, 2, 3), (3, 2, 4), (3, 4, 5)]


def mphtxt() -> Iterator[Attack]:
    """Text meshes."""

    def of(name: str, made: Maker | str | bytes, what: Right, pinned: bool = False) -> Attack:
        return drawn("mphtxt", name, "a.mphtxt", made, what, pinned=pinned)

    def text(old: str, new: str) -> Maker:
        def made(path: Path) -> None:
            whole = write_mphtxt(path, CORNERS, TRIANGLES).read_text()
            assert old in whole
            path.write_text(whole.replace(old, new, 1))

        return made

    def mesh(corners: Points, triangles: Sequence[Sequence[int]]) -> Maker:
        return lambda path: write_mphtxt(path, corners, triangles)

    pipe = right(volume(4 * math.pi))
    yield of("a pipe", mesh(CORNERS, TRIANGLES), pipe)
    yield of("triangles inside out", mesh(CORNERS, [one[::-1] for one in TRIANGLES]), pipe)
    yield of(
        "counted from 1",
        lambda path: write_mphtxt(path, CORNERS, [[i + 1 for i in one] for one in TRIANGLES]).write_text(
            path.read_text().replace("0 # lowest", "1 # lowest")
        ),
        pipe,
    )
    yield of("a triangle twice", mesh(CORNERS, [*TRIANGLES, TRIANGLES[0]]), refused(), pinned=True)
    yield of("a triangle missing", mesh(CORNERS, TRIANGLES[:-1]), refused())
    yield of("a point of its own", mesh([*CORNERS, (9, 9)], TRIANGLES), pipe)
    yield of("vertex beyond", mesh(CORNERS, [*TRIANGLES[:-1], (3, 4, 50)]), refused("damaged|vertices"))
    yield of("vertex −1", mesh(CORNERS, [*TRIANGLES[:-1], (3, 4, -1)]), refused("damaged|vertices"))
    yield of(
        "more vertices than there are", text("6 # number of mesh vertices", "600 # number"), refused("cut short|mesh")
    )
    yield of("1e18 vertices", text("6 # number of mesh", "1000000000000000000 # number of mesh"), refused())
    yield of("−6 vertices", text("6 # number of mesh", "-6 # number of mesh"), refused())
    yield of("in 3-D", text("2 # sdim", "3 # sdim"), refused("3 dimensions"))
    yield of("version 99", text("4 # version", "99 # version"), not_wrong(check=volume(4 * math.pi)))
    yield of("no number", text("1 4", "nan 4"), refused())
    yield of("negative radius", mesh([(x - 0.5, y) for x, y in CORNERS], TRIANGLES), refused("negative radius"))
    yield of("not at the axis", mesh([(x + 3, y) for x, y in CORNERS], TRIANGLES), refused())
    yield of("nothing", "", refused())
    yield of("binary", bytes(range(256)) * 20, refused())
    for share in (0.2, 0.5, 0.8):
        yield of(f"cut at {share:.0%}", _cut(mesh(CORNERS, TRIANGLES), share), refused())


# --- surfaces ---------------------------------------------------------------------------------------------------------


def facets(profile: Points = WALL, turns: int = 24, part: float = 1.0) -> Triangles:
    """(n, 3, 3) corners of the triangles of a profile turned about z, or part of a turn."""
    angles = 2 * math.pi * part * np.arange(turns + 1) / turns
    found = []
    for (r0, z0), (r1, z1) in pairwise(profile):
        for a, b in pairwise(angles):
            p = [[r * math.cos(t), r * math.sin(t), z] for r, z in ((r0, z0), (r1, z1)) for t in (a, b)]
            found += [[p[0], p[1], p[2]], [p[1], p[3], p[2]]]
    return np.array(found)


def text_stl(triangles: Triangles) -> str:
    """An STL in text."""
    rows = ["solid a"]
    for triangle in triangles:
        rows += ["facet normal 0 0 0", "outer loop", *(f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangle)]
        rows += ["endloop", "endfacet"]
    return "\n".join([*rows, "endsolid a", ""])


def binary_stl(triangles: Triangles, count: int | None = None, head: bytes = b"") -> bytes:
    """A binary STL whose head may lie about the number of triangles."""
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *one.ravel(), 0) for one in triangles)
    return head.ljust(80, b"\0") + struct.pack("<I", len(triangles) if count is None else count) + body


def stl() -> Iterator[Attack]:
    """Triangulated surfaces."""

    def of(name: str, made: Maker | str | bytes, what: Right, *options: str, pinned: bool = False) -> Attack:
        return drawn("STL", name, "a.stl", made, what, *options, pinned=pinned)

    whole, silo = facets(), right(volume(EMPTY))
    yield of("text", text_stl(whole), silo)
    yield of("binary", binary_stl(whole), silo)
    yield of("binary that begins with solid", binary_stl(whole, head=b"solid a"), not_wrong(check=volume(EMPTY)))
    yield of("inside out", text_stl(whole[:, ::-1]), silo, pinned=True)
    yield of(
        "every other facet inside out",
        text_stl(np.where(np.arange(len(whole))[:, None, None] % 2, whole, whole[:, ::-1])),
        silo,
    )
    yield of("facets in any order", text_stl(np.random.default_rng(1).permutation(whole)), silo)
    yield of("every facet twice", text_stl(np.concatenate([whole, whole])), silo)
    yield of("beside the axis", text_stl(whole + np.array([5, 3, 0])), silo)
    yield of("lying", text_stl(np.roll(whole, 1, axis=2)), silo)
    yield of("upside down, --up -z", text_stl(whole * [1, 1, -1]), silo, "--up", "-z")
    yield of("slanted by 3°", text_stl(_slanted(whole, 3)), refused("revolution"))
    yield of("mirrored", text_stl(whole * [-1, 1, 1]), silo)
    yield of("mm", text_stl(whole * 1e3), silo, "--unit", "mm")
    yield of("square", text_stl(facets(turns=4)), refused("8 facets"))
    yield of("half a turn", text_stl(facets(part=0.5)), refused("revolution"))
    yield of("three quarters of a turn", text_stl(facets(part=0.75)), refused("revolution"))
    yield of("an ellipse", text_stl(whole * [1.2, 1, 1]), refused(), pinned=True)
    yield of("an ellipse by 1 %", text_stl(whole * [1.01, 1, 1]), refused())
    dent = whole.copy()
    dent[np.isclose(dent, whole[10, 0]).all(axis=2)] += [0.05, 0, 0]
    yield of("a dent", text_stl(dent), refused())
    yield of("a facet missing", text_stl(whole[1:]), not_wrong(check=volume(EMPTY)))
    shorter = math.pi * ((1 + 0.5 + 0.25) / 3 + 0.25)  # the cone and the pipe: whole without its bin
    yield of("the uppermost ring of facets missing", text_stl(whole[48:]), right(volume(shorter, 0.02)))
    yield of("a ring of facets missing", text_stl(np.concatenate([whole[:48], whole[96:]])), refused())
    box = np.array([[[2, 2, 0], [3, 2, 0], [2, 3, 1]]], dtype=float)
    yield of("a box beside it", text_stl(np.concatenate([whole, box])), refused())
    yield of("two vessels", text_stl(np.concatenate([whole, whole + np.array([5, 0, 0])])), refused())
    yield of("closed by lids", text_stl(facets([(1e-12, 4.0), *WALL, (1e-12, 0.0)])), not_wrong(check=volume(EMPTY)))
    for value in (math.nan, math.inf, 1e30):
        wild = whole.copy()
        wild[3, 1, 2] = value
        yield of(f"a corner at {value}", text_stl(wild), refused())
        yield of(f"a corner at {value}, binary", binary_stl(wild), refused())
    yield of("count too large", binary_stl(whole, len(whole) + 10), refused(), pinned=True)
    yield of("count too small", binary_stl(whole, len(whole) - 10), refused())
    yield of("count of 4e9", binary_stl(whole, 2**32 - 1), refused())
    yield of("count of 0", binary_stl(whole, 0), refused())
    yield of("head alone", bytes(84), refused())
    yield of("nothing", "", refused())
    yield of("text cut in a facet", text_stl(whole)[:-200], refused())
    yield of("text without facets", "solid a\nendsolid a\n", refused())
    yield of("an OBJ", _obj(whole), refused())
    yield of("a page of HTML", "<html>404</html>\n" * 20, refused())
    yield of("of no height", text_stl(whole * [1, 1, 0]), refused())


def _slanted(triangles: Triangles, angle: float) -> Triangles:
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return triangles @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def _obj(triangles: Triangles) -> str:
    rows = [f"v {x:.12g} {y:.12g} {z:.12g}" for x, y, z in triangles.reshape(-1, 3)]
    return "\n".join([*rows, *(f"f {3 * k + 1} {3 * k + 2} {3 * k + 3}" for k in range(len(triangles))), ""])


def obj() -> Iterator[Attack]:
    """Wavefront's OBJ."""

    def of(name: str, made: str | bytes, what: Right, *options: str) -> Attack:
        return drawn("OBJ", name, "a.obj", made, what, *options)

    whole = _obj(facets())
    yield of("triangles", whole, right(volume(EMPTY)))
    yield of(
        "with groups and materials", "mtllib a.mtl\no vessel\ng all\ns off\n" + whole, not_wrong(check=volume(EMPTY))
    )
    yield of(
        "corners counted backwards",
        whole.replace("f 1 2 3\n", f"f -{72 * 12} -{72 * 12 - 1} -{72 * 12 - 2}\n"),
        not_wrong(check=volume(EMPTY)),
    )
    yield of("a corner beyond", whole + "f 1 2 999999\n", refused())
    yield of("corner 0", whole + "f 0 1 2\n", refused())
    yield of("points alone", whole[: whole.index("f ")], refused())
    yield of("text for a number", whole.replace("v ", "v x", 1), refused())
    yield of("no number", whole.replace("v 1 ", "v nan ", 1), refused())
    yield of("cut", whole[: len(whole) // 3], refused())


# --- CAD --------------------------------------------------------------------------------------------------------------


def solid(*bodies: Callable[[object], object], unit: str = "M") -> Maker:
    """A STEP or BREP file of what is built with OpenCASCADE."""

    def made(path: Path) -> None:
        import gmsh

        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            for body in bodies:
                body(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.option.setString("Geometry.OCCTargetUnit", unit)
            gmsh.write(str(path))
        finally:
            gmsh.finalize()

    return made


def in_child(made: Maker) -> Maker:
    """The same in a process of its own: gmsh is not to be initialized in the parent of the attacks."""

    def apart(path: Path) -> None:
        child = os.fork()
        if child == 0:
            status = 1
            try:
                made(path)
                status = 0
            finally:
                os._exit(status)
        assert os.waitpid(child, 0)[1] == 0

    return apart


def cad() -> Iterator[Attack]:
    """STEP and BREP."""

    def of(name: str, made: Maker | str | bytes, what: Right, *options: str, file: str = "a.step") -> Attack:
        return drawn("CAD", name, file, in_child(made) if callable(made) else made, what, *options)

    def step(turned: bool) -> Maker:
        return lambda path: write_step(path, WALL, {}, turned)

    silo = right(volume(EMPTY, 1e-4))
    yield of("face", step(False), silo)
    yield of("body", step(True), silo)
    yield of("BREP of a body", step(True), silo, file="a.brep")
    pipe = math.pi * 0.25 * 2
    yield of(
        "body beside the axis", solid(lambda occ: occ.addCylinder(5, 3, 0, 0, 0, 2, 0.5)), right(volume(pipe, 1e-4))
    )
    yield of("lying body", solid(lambda occ: occ.addCylinder(0, 0, 0, 2, 0, 0, 0.5)), right(volume(pipe, 1e-4)))
    yield of(
        "two bodies apart",
        solid(lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 2, 0.5), lambda occ: occ.addCylinder(5, 0, 0, 0, 0, 2, 0.5)),
        refused(),
    )
    yield of(
        "two bodies one above the other",
        solid(lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 2, 0.5), lambda occ: occ.addCylinder(0, 0, 3, 0, 0, 2, 0.5)),
        refused(),
    )
    yield of("a box", solid(lambda occ: occ.addBox(0, 0, 0, 1, 1, 3)), refused("revolution"))
    yield of("a ball", solid(lambda occ: occ.addSphere(0, 0, 0, 1)), refused("inlet|outlet"))
    yield of("a slanted cylinder", solid(lambda occ: occ.addCylinder(0, 0, 0, 0.2, 0, 2, 0.5)), refused("revolution"))
    yield of("half a cylinder", solid(lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 2, 0.5, angle=math.pi)), refused())
    yield of(
        "a cylinder with a side pipe",
        solid(
            lambda occ: occ.fuse(
                [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 0.5))], [(3, occ.addCylinder(0, 0, 1, 1, 0, 0, 0.2))]
            )
        ),
        refused("revolution"),
    )
    yield of("a line alone", solid(lambda occ: occ.addLine(occ.addPoint(1, 0, 0), occ.addPoint(1, 0, 2))), refused())
    yield of("nothing", "", refused("STEP"))
    yield of("head alone", "ISO-10303-21;\nHEADER;\nENDSEC;\n", refused("STEP|body|face"))
    yield of("cut", _cut(step(True), 0.5), refused())
    yield of("an STL", text_stl(facets()), refused("STEP"))
    yield of("zeros", bytes(3000), refused("STEP"))
    yield of("BREP that is a STEP", step(False), not_wrong(check=volume(EMPTY, 1e-4)), file="b.brep")


# --- files, options, cases --------------------------------------------------------------------------------------------


def files() -> Iterator[Attack]:
    """Formats that are not read, and files that are none."""
    for ending in (".mph", ".mphbin", ".dwg", ".iges", ".sldprt", ".pdf", ".png", ".xyz", ""):
        yield drawn(
            "drawing file",
            f"a{ending}",
            f"a{ending}",
            b"AC1032" + bytes(200),
            refused("export|save|format"),
            pinned=ending == ".dwg",
        )
    for ending in ("dxf", "csv", "mphtxt", "stl", "obj", "step"):
        yield drawn("drawing file", f"a folder named .{ending}", f"a.{ending}", Path.mkdir, refused("not a file"))
    for ending in ("dxf", "csv", "stl"):
        yield drawn("drawing file", f"a pipe named .{ending}", f"a.{ending}", os.mkfifo, refused("not a file"))
        yield drawn(
            "drawing file",
            f"/dev/zero as .{ending}",
            f"a.{ending}",
            lambda path: path.symlink_to("/dev/zero"),
            refused("not a file"),
        )
    yield drawn("drawing file", "a link to itself", "a.dxf", lambda path: path.symlink_to(path), refused())
    yield Attack("drawing file", "missing", granpipe("outline", "a.dxf"), refused("a.dxf"))


def options() -> Iterator[Attack]:
    """Options of ``granpipe outline``, and pictures in the place of the user's files."""
    made: Maker = lambda path: write_csv(path, [WALL])  # noqa: E731

    def of(name: str, what: Right, *more: str, pinned: bool = False) -> Attack:
        return drawn("option", name, "a.csv", made, what, *more, pinned=pinned)

    yield of("tolerance 0", refused("tolerance"), "--tolerance", "0")
    yield of("tolerance −1", refused("tolerance"), "--tolerance", "-1")
    yield of("tolerance nan", refused("tolerance"), "--tolerance", "nan")
    yield of("tolerance 1e9", not_wrong(check=volume(EMPTY)), "--tolerance", "1e9")
    yield of("axis nan", refused("axis"), "--axis", "nan")
    yield of("axis 1e300", refused("axis"), "--axis", "1e300")
    yield of("up z of a plane drawing", not_wrong("up", check=volume(EMPTY)), "--up", "z")
    yield of("picture where no folder is", refused("none/x.png"), "--picture", "none/x.png")
    for command, target, arguments in (
        ("outline", "a.csv", ("outline", "a.csv", "--unit", "m", "--picture", "a.csv")),
        ("plan", "case.yaml", ("plan", "case.yaml", "--picture", "case.yaml")),
        ("plan over a drawing", "a.csv", ("plan", "case.yaml", "--picture", "a.csv")),
    ):
        yield Attack("option", f"{command}: the picture over {target}", _kept(arguments, target), refused(target), True)


def _kept(arguments: tuple[str, ...], target: str) -> Callable[[Path], Ran]:
    """An act after which a file must be as it was."""

    def act(folder: Path) -> Ran:
        write_csv(folder / "a.csv", [WALL])
        (folder / "case.yaml").write_text(varied(SILO, {"model": "auto"}))
        before = (folder / target).read_bytes()
        ran = run(arguments, folder)
        return ran if (folder / target).read_bytes() == before else Ran(0, f"{target} is overwritten")

    return act


def cases() -> Iterator[Attack]:
    """Cases that name a drawing."""

    def of(name: str, outline: dict[str, object], what: Right, file: str = "a.csv", pinned: bool = False) -> Attack:
        text = varied(SILO | {"outline": outline}, {"model": "dem"})
        made: Maker = lambda path: write_csv(path, [WALL])  # noqa: E731
        return Attack(
            "case with a drawing",
            name,
            granpipe("check", "case.yaml", files={"case.yaml": text, file: made}),
            what,
            pinned,
        )

    yield of("fits", {"file": "a.csv", "unit": "m"}, right(volume(EMPTY)), pinned=True)
    yield of("in a folder", {"file": "drawings/a.csv", "unit": "m"}, right(volume(EMPTY)), "drawings/a.csv")
    yield of("no unit", {"file": "a.csv"}, refused("unit"))
    yield of("wrong unit", {"file": "a.csv", "unit": "mm"}, not_wrong("outlet", check=volume(EMPTY * 1e-9)))
    yield of("beside a wall", {"file": "a.csv", "unit": "m", "wall": [[1, 4], [1, 0]]}, refused("wall"))
    yield of("missing", {"file": "b.csv", "unit": "m"}, refused("b.csv"))
    yield of("the case itself", {"file": "case.yaml", "unit": "m"}, refused("format"))
    yield of("a folder", {"file": ".", "unit": "m"}, refused("not a file"))
    yield of("no name", {"file": "", "unit": "m"}, refused())
    yield of("a number", {"file": 3, "unit": "m"}, refused("file"))
    yield of("a wrong axis", {"file": "a.csv", "unit": "m", "axis": 0.3}, refused("axis"))
    yield of("sections that do not fit", {"file": "a.csv", "unit": "m", "sections": {"a": [40, 0]}}, refused("leaves"))
