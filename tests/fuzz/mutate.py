"""Damaged inputs made from good ones: the same seed gives the same inputs, byte for byte."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable, Iterator, Sequence

Mutator = Callable[[random.Random, bytes], bytes]

_NUMBERS = [struct.pack("<i", n) for n in (-1, 0, 1, 2**31 - 1, -(2**31), 10**6)] + [
    *(struct.pack("<q", n) for n in (-1, 2**62, 2**40)),
    *(struct.pack("<d", x) for x in (float("nan"), float("inf"), 1e308, -1e-308)),
]

_WORDS = (
    b"0 -1 1 1e308 -1e308 1e-308 1e999 nan .nan .inf -0.0 1e-9 1e9 99999999999999999999 9**9**9 0x10 0o7 1_000 1,5 "
    b"true null ~ auto yes off 2/3 1/0 3cm 3[cm] 1e9km 1mm 50% 30deg 1t/h 1[m^3/h] m/s Pa kg \xc2\xb5m \xc2\xb0 "
    b"!!python/object/apply:os.system !!binary &a *a <<: [] {} [[]] {a: - ? : , ' \" | > # % @ ` \\ \t \xff \x00 "
    b"\xef\xbb\xbf \xe2\x80\xa8 \x85 ../../x /dev/zero shell $(id) ${x} {{x}} dem fluid hybrid plate open psi gaussian "
    b"mono normal sieve radius diameter mean std min max"
).split(b" ")


def inputs(seed: int, sources: Sequence[bytes], mutators: Sequence[Mutator], count: int) -> Iterator[bytes]:
    """Yield `count` inputs, each a source with one to four mutations."""
    rng = random.Random(seed)
    for _ in range(count):
        data = rng.choice(sources)
        for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
            data = rng.choice(mutators)(rng, data)
        yield data


def _span(rng: random.Random, data: bytes, longest: int) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.randint(1, longest))


def flip(rng: random.Random, data: bytes) -> bytes:
    """One byte is another."""
    start, stop = _span(rng, data, 1)
    return data[:start] + bytes([rng.randrange(256)]) + data[stop:]


def cut(rng: random.Random, data: bytes) -> bytes:
    """A piece is missing."""
    start, stop = _span(rng, data, rng.choice((1, 8, 200)))
    return data[:start] + data[stop:]


def truncate(rng: random.Random, data: bytes) -> bytes:
    """The end is missing."""
    return data[: rng.randrange(len(data) + 1)]


def repeat(rng: random.Random, data: bytes) -> bytes:
    """A piece stands there several times."""
    start, stop = _span(rng, data, rng.choice((4, 40, 400)))
    return data[:stop] + data[start:stop] * rng.choice((1, 2, 50)) + data[stop:]


def move(rng: random.Random, data: bytes) -> bytes:
    """A piece stands somewhere else."""
    start, stop = _span(rng, data, 40)
    rest = data[:start] + data[stop:]
    at = rng.randrange(len(rest) + 1)
    return rest[:at] + data[start:stop] + rest[at:]


def number(rng: random.Random, data: bytes) -> bytes:
    """A binary number is one at its limits."""
    start, value = rng.randrange(len(data) + 1), rng.choice(_NUMBERS)
    return data[:start] + value + data[start + len(value) :]


def word(rng: random.Random, data: bytes) -> bytes:
    """A word is another one, from this text or from a list of what breaks readers."""
    words = list(re.finditer(rb"[^\s,\[\]{}:]+", data))
    if not words:
        return rng.choice(_WORDS)
    old, new = rng.choice(words), rng.choice((rng.choice(_WORDS), rng.choice(words)[0]))
    return data[: old.start()] + new + data[old.end() :]


def line(rng: random.Random, data: bytes) -> bytes:
    """A line is missing, twice there, indented, or nested deeply."""
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    lines[at : at + 1] = rng.choice(
        ([], [lines[at]] * 2, [b"  " + lines[at]], [lines[at].strip()], [lines[at] + b" [" * 40], [rng.choice(lines)])
    )
    return b"\n".join(lines)


ANY = (flip, cut, truncate, repeat, move)
BINARY = (*ANY, number, number, number)
TEXT = (*ANY, word, word, word, word, word, line)
