"""Attacks on slabs, the library of materials, further fields, ``repose`` and ``study --inputs``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from attacks.attack import Attack, Right, granpipe, refused, right, told, unique
from attacks.cases import BED, SILO, Case, checked, varied, volume

SLAB: Case = SILO | {
    "outline": {
        "unit": "m",
        "symmetry": "plane",
        "left": [[-0.5, 2], [-0.5, 0]],
        "right": [[0.5, 2], [0.5, 0]],
        "depth": 1.5,
    }
}
"""A shaft of 3 m³."""


ROLLING = {"rolling_friction": 0.02}
"""What the library does not know of glass beads."""


def attacks() -> list[Attack]:
    """Every attack on them."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (slabs, library, fields, angles, inputs)
    return unique([attack for kind in kinds for attack in kind()])


def slabs() -> Iterator[Attack]:
    """Slabs between two walls."""

    def of(name: str, what: Right, pinned: bool = False, **changes: Any) -> Attack:
        return checked("slab", name, what, SLAB, pinned=pinned, **changes)

    yield of("as it should be", right(volume(3.0)), pinned=True)
    far = {"outline__left": [[99.5, 2], [99.5, 0]], "outline__right": [[100.5, 2], [100.5, 0]]}
    yield of("100 m beside x = 0", right(volume(3.0)), **far)
    small = {"outline__left": [[-500, 2000], [-500, 0]], "outline__right": [[500, 2000], [500, 0]]}
    yield of("in millimetres", right(volume(3.0)), outline__unit="mm", outline__depth=1500, **small)
    for depth in (0, -1, "nan", "inf", "1 s", "deep", [1], None):
        yield of(f"a depth of {depth!r}", refused("depth"), outline__depth=depth)
    for key in ("left", "right", "depth"):
        yield of(f"no {key}", refused(f"{key}.*missing"), **{f"outline__{key}": ...})
    for symmetry in ("round", 3, ["plane"], "axis", None):
        yield of(f"symmetry {symmetry!r}", refused("symmetry"), outline__symmetry=symmetry)
    yield of("a wall, too", refused("wall.*leave it out"), outline__wall=[[1, 2], [1, 0]])
    yield checked("slab", "a round vessel with a depth", refused("depth.*leave it out"), SILO, outline__depth=1)
    swapped = {"outline__left": [[0.5, 2], [0.5, 0]], "outline__right": [[-0.5, 2], [-0.5, 0]]}
    yield of("left and right swapped", refused("left|right"), True, **swapped)
    yield of("walls that cross", refused("left|right"), outline__right=[[0.5, 2], [-0.6, 0]])
    yield of("walls that touch", refused("left|right"), outline__right=[[0.5, 2], [-0.5, 0]])
    yield of("walls that begin at two heights", refused("height|begin"), outline__right=[[0.5, 2.5], [0.5, 0]])
    yield of("walls that end at two heights", refused("height|end"), outline__right=[[0.5, 2], [0.5, 0.1]])
    yield of("a wall of one point", refused("left"), outline__left=[[-0.5, 2]])
    yield of("a wall upside down", refused("left|rise"), outline__left=[[-0.5, 0], [-0.5, 2]])
    yield of("an overhang", refused("left|rise"), outline__left=[[-0.5, 2], [-0.6, 1], [-0.5, 1.2], [-0.5, 0]])
    yield of("an obstacle outside", refused("obstacle|outside"), outline__obstacles={"a": [[2, 1], [3, 1], [3, 1.5]]})
    yield of("a hybrid", refused("hybrid"), model="hybrid")
    yield of("frictional", refused("plane|slab|frictional"), fluid__rheology="frictional")
    annular = {"outlet_profile": "annular", "annulus": ["10 cm", "20 cm"]}
    yield of("an annulus", refused("annul"), fluid=annular)
    yield of("a drawing", refused("file|drawing"), outline__file="silo.dxf")


def library() -> Iterator[Attack]:
    """``material.name``."""

    def of(name: str, what: Right, material: dict[str, Any], pinned: bool = False, **changes: Any) -> Attack:
        size = {"size": {"diameter": "2 cm"}}
        return checked("library", name, what, BED | {"contact": {}}, material=size | material, pinned=pinned, **changes)

    for given in ("gold", "Glass Beads", "glass  beads", "../materials", "__class__", "a" * 10_000, "glass\nbeads", ""):
        yield of(f"{given[:20]!r}", refused("material.name|not in the library"), {"name": given}, given == "gold")
    for given in (5, None, True, ["glass beads"], {"a": 1}):
        yield of(f"{given!r}", refused("name|density"), {"name": given})
    yield of("glass beads", told("glass beads in the library"), {"name": "glass beads"}, True, contact=ROLLING)
    yield of("glass beads of a density of words", refused("density"), {"name": "glass beads", "density": "heavy"},
             contact=ROLLING)  # fmt: skip
    yield of("contacts that are no group", refused("contact"), {"name": "glass beads"}, contact=5)
    yield of("coke, of which nothing is known", refused("no value with a source"), {"name": "coke"})
    yield of("coke with nothing", refused("no value with a source"), {"name": "coke"}, contact={"friction": None})


def fields() -> Iterator[Attack]:
    """``homogenize.fields``."""

    def of(name: str, what: Right, given: Any, base: Case = BED, **changes: Any) -> Attack:
        return checked("further fields", name, what, base, homogenize__fields=given, **changes)

    yield of("misspelt", refused("stress"), ["stres"])
    yield of("twice", refused("twice"), ["stress", "stress"])
    for given in ("stress", {"stress": True}, 5, [None], [["stress"]], ["stress", 5]):
        yield of(f"{given!r}", refused("fields"), given)
    psi = refused("stream function")
    yield of("residence time of a Gaussian", psi, ["residence_time"])
    yield of("stress in a fluid", told("without stress: there are no particles"), ["stress"], SILO)
    many = ["coordination", "mixing", "granular_temperature"]
    yield of("more in a fluid", told("without coordination, mixing, granular_temperature"), many, SILO)


def angles() -> Iterator[Attack]:
    """``granpipe repose``: refused before any heap is run."""

    def of(name: str, what: Right, *arguments: str, text: str | None = None) -> Attack:
        files = {"case.yaml": varied(BED, {}) if text is None else text}
        return Attack("repose", name, granpipe("repose", "case.yaml", *arguments, files=files), what)

    for angle in ("nan", "-5 deg", "0 deg", "90 deg", "120 deg", "34", "34 m", "", "1e9 deg", "inf deg", "$(id)"):
        yield of(f"an angle of {angle!r}", refused("angle"), f"--angle={angle}")
    for error in ("-1 deg", "nan", "1", "90 deg"):
        yield of(f"an error of {error!r}", refused("error"), "--angle=30 deg", f"--error={error}")
    yield of("no angle", refused("--angle"))
    yield of("0 cores", refused("cores"), "--angle=30 deg", "--cores=0")
    yield of("a damaged case", refused("case.yaml"), "--angle=30 deg", text="name: [")
    yield of("no rolling", refused("roll"), "--angle=30 deg", "--set", "contact.rolling_model=none")
    yield of("results in a file", refused("case.yaml"), "--angle=30 deg", "--results=case.yaml")


def inputs() -> Iterator[Attack]:
    """``granpipe study --inputs``: refused before any point is run."""
    for word in (
        "",
        "contact.friction",
        "contact.friction=0.6",
        "=0.1..0.2",
        "contact.friction=0.8..0.6",
        "contact.friction=0.6..0.6",
        "contact.friction=nan..1",
        "contact.friction=0.1..inf",
        "contact.friction=0.1..0.2..0.3",
        "contact.friction=-1..0.5",
        "contact.friction=$(id)..1",
        "contact.friction=[0.1]..[0.2]",
        "contact.frictoin=0.1..0.2",
        "contact..friction=0.1..0.2",
        "contact=0.1..0.2",
        "material.density=1 m..2 m",
        "material.density=0..2000",
        "material.size.diameter=..2 cm",
        "material.name=glass beads..steel balls",
        "contact.rolling_model=none..epsd2",
        "contact.youngs_modulus=1e6..1e7",
        "name=a..b",
        "dem.seed=1..2",
        "flow_rate=1 kg/s..2 kg/s",
    ):
        act = granpipe("study", "case.yaml", f"--inputs={word}", files={"case.yaml": varied(BED, {})})
        yield Attack("inputs", repr(word), act, refused("--inputs"))
    twice = ("--inputs=contact.friction=0.4..0.6", "--inputs=contact.friction=0.5..0.6")
    act = granpipe("study", "case.yaml", *twice, files={"case.yaml": varied(BED, {})})
    yield Attack("inputs", "one of them twice", act, refused("twice"), pinned=True)
