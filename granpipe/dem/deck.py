"""LIGGGHTS input decks: the settings of a run written into text that reads like the thing it makes.

Nothing from a case reaches a deck but numbers and mesh names of a strict pattern: LIGGGHTS input has a `shell` command.
The same case gives the same deck, byte for byte.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import granpipe
from granpipe.case.schema import Case
from granpipe.dem.packing import Bed
from granpipe.dem.settings import Settings, slab_height
from granpipe.errors import CaseError
from granpipe.field import Boxes, Frustum
from granpipe.system.templates import templates

DUMP_COLUMNS = ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")

INSERT_FRACTION = 0.3
"""Packing that random insertion is asked for: 0.35–0.4 is the most it reaches, and a shortfall distorts the sizes."""

Ends = tuple[float, float]

_MESH_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


@dataclass(frozen=True)
class Slab:
    """An insertion region: arguments of LIGGGHTS `region`, the name of its fix and the seed of its insertion.

    It is what lies in `outer` and not in `inner`, or in a slab what lies in `both`; or all of several `blocks`.
    """

    name: str
    outer: str
    inner: str
    seed: int
    blocks: tuple[str, ...] = ()
    both: bool = False


@dataclass(frozen=True)
class Plate:
    """A plate that sinks: name of its mesh, what the names of its fixes end with, and its speeds [m/s]."""

    mesh: str
    suffix: str
    speed: float
    start_speed: float


@dataclass(frozen=True)
class ParticleClass:
    """One particle template: radius [m], density [kg/m³], share of the number, seed."""

    name: str
    radius: float
    density: float
    share: float
    seed: int


@dataclass(frozen=True)
class MaterialDeck:
    """What the template's block of the material uses: contacts, gravity, time step, neighbour skin."""

    contact_model: str
    types: int
    youngs_modulus: float
    poisson: float
    restitution: tuple[float, ...]
    friction: tuple[float, ...]
    rolling_model: bool
    rolling_friction: tuple[float, ...]
    characteristic_velocity: float | None
    gravity: float
    time_step: float
    skin: float


@dataclass(frozen=True)
class Deck(MaterialDeck):
    """All values that the templates of a filling and a production deck use; SI units."""

    periodic: bool
    box: tuple[float, ...]
    volume_limit: float
    classes: tuple[ParticleClass, ...]
    sizes_seed: int
    meshes: tuple[str, ...]
    fill_meshes: tuple[str, ...]
    feed: Slab
    feed_seed: int
    feed_speed: float
    bed_seed: int
    slabs: tuple[Slab, ...]
    insert_every: int
    insert_fraction: float
    attempts: int
    thermo_every: int
    chunk_steps: int
    fill_chunks: int
    full_gain: float
    rest_energy: float
    fall_steps: int
    enough: int
    plate_speed: float
    start_speed: float
    start_segments: int
    plates: tuple[Plate, ...]
    catcher_depth: float
    dump_every: int
    segment_steps: int
    wall_contacts: bool
    pair_contacts: bool


def make_deck(
    case: Case,
    settings: Settings,
    pieces: Iterable[Frustum | Boxes],
    obstacles: Iterable[str],
    sides: tuple[Ends, Ends],
    plates: Iterable[str] = ("plate",),
) -> Deck:
    """Put a run together.

    Parameters
    ----------
    pieces : insertion slices from the plate to the top of the feed region
    obstacles : names of the obstacle meshes
    sides : ends of x and y between which the walls lie, corners included [m]; those of y are periodic in a slab
        without a front and a back wall
    plates : names of their meshes, of one outlet after the other

    Raises
    ------
    CaseError : the particles find no room for insertion between the walls
    """
    seeds = _seeds(case.dem.seed)
    classes, wall = settings.classes, case.contact.wall
    slices = [part for piece in pieces for part in _split(piece, slab_height(classes), settings.feed_bottom)]
    feed = [part for part in slices if part.z_low >= settings.feed_bottom - 1e-9]
    bed = [part for part in slices if part.z_low < settings.feed_bottom - 1e-9]
    if not feed or not bed:
        raise CaseError(
            f"particles of up to {2 * classes.largest:.4g} m find no room for insertion between the walls; "
            "use smaller particles or a wider vessel",
            key=("material", "size"),
        )
    fall = math.sqrt(2 * slab_height(classes) / settings.gravity)
    insert_every = max(1, round(0.25 * fall / settings.time_step))
    own_wall = (wall.friction, wall.rolling_friction, wall.restitution) != (
        case.contact.friction,
        case.contact.rolling_friction,
        case.contact.restitution,
    )
    rolling = case.contact.rolling_model != "none" and max(case.contact.rolling_friction, wall.rolling_friction) > 0
    vessel, plate_meshes = ("vessel", *map(_mesh_name, obstacles)), tuple(map(_mesh_name, plates))
    margin, periodic = 2 * classes.largest, case.outline.symmetry == "plane" and not case.outline.walled
    return Deck(
        contact_model=_contact_model(case, rolling),
        types=2 if own_wall else 1,
        youngs_modulus=settings.youngs_modulus,
        poisson=case.contact.poisson,
        restitution=_pairs(case.contact.restitution, wall.restitution, own_wall),
        friction=_pairs(case.contact.friction, wall.friction, own_wall),
        rolling_model=rolling,
        rolling_friction=_pairs(case.contact.rolling_friction, wall.rolling_friction, own_wall),
        characteristic_velocity=case.contact.characteristic_velocity if case.contact.model == "hooke" else None,
        gravity=settings.gravity,
        time_step=settings.time_step,
        skin=settings.skin,
        periodic=periodic,
        box=(
            sides[0][0] - margin,
            sides[0][1] + margin,
            *(sides[1] if periodic else (sides[1][0] - margin, sides[1][1] + margin)),
            settings.bottom - margin,
            settings.wall_top + margin,
        ),
        volume_limit=1e-3 * classes.mean_volume * (classes.smallest / classes.largest) ** 3,
        classes=tuple(
            ParticleClass(f"class{i + 1}", float(radius), float(density), float(share), next(seeds))
            for i, (radius, density, share) in enumerate(
                zip(classes.radius, case.material.density * classes.density_factor, classes.number_share, strict=True)
            )
        ),
        sizes_seed=next(seeds),
        meshes=vessel if settings.open_outlet else (*vessel, *plate_meshes),
        fill_meshes=(*vessel, *plate_meshes),
        feed=_slab("feed", feed[0], 0),
        feed_seed=next(seeds),
        feed_speed=settings.feed_speed,
        slabs=tuple(_slab(f"fill{i + 1}", piece, next(seeds)) for i, piece in enumerate(bed)),
        bed_seed=next(seeds),
        insert_every=insert_every,
        insert_fraction=INSERT_FRACTION,
        attempts=200,
        thermo_every=insert_every,
        chunk_steps=2 * insert_every,
        fill_chunks=500,
        full_gain=2e-3,
        rest_energy=0.5 * settings.rest_speed**2,
        fall_steps=settings.fall_steps,
        enough=settings.placed,
        plate_speed=settings.plate_speed,
        start_speed=settings.start_speed,
        start_segments=settings.start_segments,
        plates=tuple(
            Plate(mesh, mesh.removeprefix("plate"), settings.plate_speed * part, settings.start_speed * part)
            for mesh, part in zip(plate_meshes, settings.plates, strict=True)
        ),
        catcher_depth=4 * classes.largest,
        dump_every=settings.dump_every,
        segment_steps=settings.segment_steps,
        wall_contacts=not {"wall_pressure", "stress"}.isdisjoint(case.homogenize.fields),
        pair_contacts="stress" in case.homogenize.fields,
    )


def bed_lines(deck: Deck, bed: Bed) -> Iterator[str]:
    """The particles that a filling begins with, as LIGGGHTS reads them: number, type, diameter, density, centre."""
    yield f"granpipe {granpipe.__version__}: a packed bed\n\n{len(bed)} atoms\n{deck.types} atom types\n\n"
    for axis, low, high in zip("xyz", deck.box[::2], deck.box[1::2], strict=True):
        yield f"{_number(low)} {_number(high)} {axis}lo {axis}hi\n"
    yield "\nAtoms\n\n"
    # exactly twice the radius that the templates are given
    kinds = [f"1 {2 * float(_number(c.radius))!r} {_number(c.density)}" for c in deck.classes]
    for i, (one, (x, y, z)) in enumerate(zip(bed.number, bed.position, strict=True), 1):
        yield f"{i} {kinds[one]} {x:.9g} {y:.9g} {z:.9g}\n"


def render(deck: object, template: str, bed: str = "bed.data") -> str:
    """Text of a deck such as ``fill.in``, from the values that its template uses; `bed` is the file of `bed_lines`.

    Without particles LIGGGHTS reads no such file: then `bed` must be empty.
    """
    environment = templates(trim_blocks=False)
    environment.filters |= {"num": _number, "nums": lambda values: " ".join(map(_number, values))}
    text = environment.get_template(f"{template}.j2").render(deck=deck, version=granpipe.__version__, bed=bed)
    return re.sub(r"\n{3,}", "\n\n", text) + "\n"


def _number(value: float) -> str:
    return f"{value:.10g}"


def _contact_model(case: Case, rolling: bool) -> str:
    parts = ["model", case.contact.model, "tangential"]
    parts.append("history" if max(case.contact.friction, case.contact.wall.friction) > 0 else "off")
    if rolling:
        parts += ["rolling_friction", case.contact.rolling_model]
    return " ".join(parts)


def _pairs(particle: float, wall: float, own_wall: bool) -> tuple[float, ...]:
    """Matrix of a pair property; walls never touch walls, so that entry only has to be legal."""
    return (particle, wall, wall, wall) if own_wall else (particle,)


def _mesh_name(name: str) -> str:
    if not _MESH_NAME.fullmatch(name):
        raise CaseError(f"{name!r} cannot name a mesh; use letters, digits and _", key=("outline", "obstacles"))
    return name


def _split(frustum: Frustum | Boxes, height: float, level: float) -> Iterator[Frustum | Boxes]:
    """Cut a piece into slabs no higher than `height`, and where the feed region begins."""
    cuts = {frustum.z_low, frustum.z_high}
    if frustum.z_low < level < frustum.z_high:
        cuts.add(level)
    edges = sorted(cuts)
    for lo, hi in pairwise(edges):
        n = max(1, math.ceil((hi - lo) / height - 1e-9))
        for i in range(n):
            a, b = lo + (hi - lo) * i / n, lo + (hi - lo) * (i + 1) / n
            yield frustum.cut(a, b)


def _slab(name: str, piece: Frustum | Boxes, seed: int) -> Slab:
    if isinstance(piece, Boxes):
        blocks = tuple(f"block {' '.join(map(_number, block))}" for block in piece.blocks)
        return Slab(name, blocks[0], "", seed) if len(blocks) == 1 else Slab(name, "", "", seed, blocks)
    if not piece.measure.axial:
        return Slab(name, *_prisms(piece), seed, both=True)
    outer = _region(piece.outer_low, piece.outer_high, piece)
    inner = _region(piece.inner_low, piece.inner_high, piece) if max(piece.inner_low, piece.inner_high) > 0 else ""
    return Slab(name, outer, inner, seed)


def _region(lo: float, hi: float, piece: Frustum) -> str:
    heights = f"{_number(piece.z_low)} {_number(piece.z_high)}"
    if math.isclose(lo, hi):
        return f"cylinder z 0.0 0.0 {_number(lo)} {heights}"
    return f"cone z 0.0 0.0 {_number(lo)} {_number(hi)} {heights}"


def _prisms(piece: Frustum) -> tuple[str, str]:
    """Two prisms, the one with the right end and the other with the left one, that have the piece in common.

    A block where both ends are upright.
    """
    low, high = min(piece.inner_low, piece.inner_high), max(piece.outer_low, piece.outer_high)
    far = 2 * (high - low)
    ends = f"{_number(piece.front)} {_number(piece.front + piece.measure.turn)}"
    rest = f"{ends} {_number(piece.z_low)} {_number(piece.z_high)} 0.0"
    right, left = piece.outer_low, piece.inner_low
    lean_right, lean_left = piece.outer_high - right, piece.inner_high - left
    if lean_right == lean_left == 0:
        return f"block {_number(left)} {_number(right)} {rest.removesuffix(' 0.0')}", ""
    return (
        f"prism {_number(right - far)} {_number(right)} {rest} {_number(lean_right)} 0.0",
        f"prism {_number(left)} {_number(left + far)} {rest} {_number(lean_left)} 0.0",
    )


def _seeds(seed: int) -> Iterator[int]:
    """Different primes above 10000, as LIGGGHTS demands, all derived from one seed."""
    used: set[int] = set()
    for counter in range(10_000):
        digest = hashlib.sha256(f"granpipe {seed} {counter}".encode()).digest()
        candidate = _next_prime(10_007 + int.from_bytes(digest[:4], "little") % 20_000_000)
        if candidate not in used:
            used.add(candidate)
            yield candidate


def _next_prime(n: int) -> int:
    n |= 1
    while any(n % d == 0 for d in range(3, math.isqrt(n) + 1, 2)):
        n += 2
    return n
