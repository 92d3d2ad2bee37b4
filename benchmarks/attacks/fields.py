"""Attacks on ``field.npz``, in a results folder whose manifest vouches for it: scale, compare, plot, the Python API."""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import pickle
import socket
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from attacks.attack import Attack, Right, refused, right, unique
from attacks.results import FOLDER, SCALE, Arrays, Change, arrays, on_result, whole, with_field

COMPARE = ("compare", FOLDER, FOLDER)
PLOT = ("plot", FOLDER, "--what", "w", "--out", "picture.png")
COMMANDS = {"scale": SCALE, "compare": COMPARE, "plot": PLOT}


def attacks() -> list[Attack]:
    """Every attack on fields."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (untouched, arrays_changed, files, special)
    return unique([attack for kind in kinds for attack in kind()])


def everywhere(kind: str, name: str, what: Right, content: Any, pinned: bool = False) -> Iterator[Attack]:
    """An attack through each command that reads a field."""
    for command, arguments in COMMANDS.items():

        def change(results: Path) -> None:
            with_field(content() if isinstance(content, Lazy) else content)(results)

        act = on_result(*arguments, change=change, sealed=kind != "special files")
        yield Attack(kind, f"{name}, {command}", act, what, pinned and command == "scale")


class Lazy:
    """Content that is made when it is needed: it depends on a result that granpipe makes first."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self.make = make

    def __call__(self) -> Any:
        return self.make()


def untouched() -> Iterator[Attack]:
    """Without any change, to show that the attacks show something."""
    yield Attack("untouched", "scale", on_result(*SCALE, change=_nothing), right(whole(2.0, "scaled")), pinned=True)
    yield Attack("untouched", "compare", on_result(*COMPARE, change=_nothing), right(lambda *_: "", r"0\.00%  agree"))


def _nothing(_: Path) -> None:
    pass


def arrays_changed() -> Iterator[Attack]:
    """One array or number is another one."""

    def changed(name: str, words: str, pinned: bool = False, **changes: Any) -> Iterator[Attack]:
        def content() -> Arrays:
            old = arrays()
            new = {key: change(old[key]) if callable(change) else change for key, change in changes.items()}
            return {key: value for key, value in (old | new).items() if value is not None}

        yield from everywhere("arrays", name, refused(words), Lazy(content), pinned)

    def put(index: tuple[int, ...], value: float) -> Callable[[Any], Any]:
        def change(array: Any) -> Any:
            array = array.copy()
            array[index] = value
            return array

        return change

    nan, place = np.nan, (3, 2)
    for name in ("flux_z", "flux_r", "psi", "inside_fraction"):
        for value in (nan, np.inf, 1e300):
            yield from changed(f"{value} in {name}", name, **{name: put(place, value)})
    for name in ("bulk_flow", "bulk_packing", "flow_scale"):
        for value in (nan, np.inf, 0.0, -1.0, 1e300, 1e-300):
            words = "bulk_flow|bulk_packing|flow_scale|stream function"
            yield from changed(f"{name} = {value}", words, **{name: np.float64(value)})
        yield from changed(f"{name} of three", name, **{name: np.ones(3)})
        yield from changed(f"no {name}", name, **{name: None})
    for name, kind in {"single": "f4", "whole": "i8", "complex": "c16", "text": "U9", "big endian": ">f8"}.items():
        yield from changed(f"flux_z in {name}", "not a", flux_z=lambda a, kind=kind: a.astype(kind))
    yield from changed("flux_z as objects", "not a", flux_z=lambda a: a.astype(object))
    yield from changed("flux_z upwards", "bulk_flow", True, flux_z=lambda a: -a)
    yield from changed("flux_z twice", "bulk_flow", flux_z=lambda a: 2 * a)
    yield from changed("flux_z twice, no ψ", "bulk_flow", flux_z=lambda a: 2 * a, psi=None)
    yield from changed("flux_r twice", "stream function", flux_r=lambda a: 2 * a)
    yield from changed("flux_z upside down", "stream function", flux_z=lambda a: a[::-1].copy())
    yield from changed("flux_z as columns", "flux_z", flux_z=lambda a: a.T.copy())
    yield from changed("a row less", "flux_z", flux_z=lambda a: a[:-1])
    yield from changed("ψ with a constant", "psi is not 0", True, psi=lambda a: a + 1e-3)
    yield from changed("bulk nowhere", "bulk is nowhere", True, bulk=lambda a: a & False)
    yield from changed("bulk everywhere", "outside the vessel", bulk=lambda a: a | True)
    yield from changed("bulk in numbers", "bulk", bulk=lambda a: a.astype(float))
    yield from changed(
        "another vessel", "not the field of the case|outside the vessel", inside_fraction=lambda a: np.roll(a, 20, 0)
    )
    for name in ("r_edges", "z_edges"):
        yield from changed(f"{name} fall", "edges", **{name: lambda a: a[::-1].copy()})
        yield from changed(f"{name} jump", "edges|square", **{name: put((2,), 0.9)})
        yield from changed(f"{name} with nan", "edges", **{name: put((2,), nan)})
        yield from changed(f"{name} in mm", "edges|square", **{name: lambda a: 1000 * a})
        yield from changed(f"{name} of one", "edges|shape|array", **{name: lambda a: a[:1]})
        yield from changed(f"{name} empty", "edges", **{name: lambda a: a[:0]})
    yield from changed("z_edges 1 m higher", "not the field of the case", z_edges=lambda a: a + 1)
    yield from changed("another format", "run again", format_version=np.int64(99))
    yield from changed("format in words", "format_version", format_version=np.array("1"))
    yield from changed("no format", "format_version", format_version=None)
    yield from changed("an array more", "no part of a field", True, save=np.ones(3))
    yield from changed("a path for a name", "no part of a field", **{"../field": np.ones(3)})
    alone = Lazy(lambda: arrays() | {"flux_z_se": np.zeros_like(arrays()["flux_z"])})
    yield from everywhere("arrays", "errors along z alone", refused("one is missing"), alone)
    yield from changed("x_edges, too", "field", x_edges=np.arange(5.0))
    yield from changed("a formula for a name", "field", wall_surface=np.array(["=1+1"]), wall_ends=np.ones((1, 2, 2)))
    yield from changed("101 arrays", "more than it can hold", **{f"a{n}": np.ones(1) for n in range(101)})


def files() -> Iterator[Attack]:
    """The file is another one."""

    def stored() -> bytes:
        stream = io.BytesIO()
        np.savez(stream, **arrays())
        return stream.getvalue()

    def flipped(share: float) -> bytes:
        data = bytearray(stored())
        data[int(share * len(data))] ^= 255
        return bytes(data)

    def twice() -> bytes:
        stream = io.BytesIO(stored())
        one = io.BytesIO()
        np.save(one, 2 * arrays()["flux_z"])
        with zipfile.ZipFile(stream, "a") as file:
            file.writestr("flux_z.npy", one.getvalue())
        return stream.getvalue()

    def bomb() -> bytes:
        stream = io.BytesIO()
        with (
            zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file,
            file.open("psi.npy", "w", force_zip64=True) as psi,
        ):
            psi.write(b"\x93NUMPY\x01\x00v\x00")
            for _ in range(2100):
                psi.write(bytes(1_000_000))
        return stream.getvalue()

    contents: dict[str, Any] = {
        "nothing": b"",
        "text": b"not a field\n",
        "half of it": Lazy(lambda: stored()[: len(stored()) // 2]),
        "without its last byte": Lazy(lambda: stored()[:-1]),
        "a pickle": pickle.dumps({"flux_z": [1.0]}),
        "gzipped": Lazy(lambda: gzip.compress(stored())),
        "a name twice": Lazy(twice),
        **{f"flipped at {share}": Lazy(lambda share=share: flipped(share)) for share in (0.1, 0.4, 0.7, 0.97, 0.999)},
    }
    huge = on_result(*SCALE, change=lambda results: with_field(bomb())(results), sealed=True)
    yield Attack("files", "2.1 GB of zeros, scale", huge, refused("more than it can hold"))
    for name, content in contents.items():
        yield from everywhere("files", name, refused("field.npz"), content, name in ("text", "half of it"))


def special() -> Iterator[Attack]:
    """What is no file; the manifest is that of the file before."""
    makers: dict[str, Change] = {
        "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
        "/dev/null": lambda path: path.symlink_to("/dev/null"),
        "a pipe": os.mkfifo,
        "a folder": os.mkdir,
        "a link to itself": lambda path: path.symlink_to(path.name),
        "a link to nowhere": lambda path: path.symlink_to("nowhere"),
        "a socket": _socket,
        "missing": _nothing,
    }
    for name, make in makers.items():
        yield from everywhere("special files", name, refused("field.npz"), make, name == "a pipe")


def _socket(path: Path) -> None:
    with contextlib.chdir(path.parent):  # the names of sockets are short
        socket.socket(socket.AF_UNIX).bind(path.name)
