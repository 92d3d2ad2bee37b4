"""A results folder to be attacked: that of a fluid, made once by granpipe, copied for each attack."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attacks.attack import Check, Ran, run
from attacks.cases import SILO, varied
from granpipe.field import Field
from granpipe.system.manifest import MANIFEST, changed_files, write_manifest

Arrays = dict[str, NDArray[Any]]
Change = Callable[[Path], object]

CASE = varied(SILO, {})
FASTER = ("--set", "flow_rate=2 m^3/h")
FOLDER = "results/silo"
SCALE = ("scale", FOLDER, "--flow", "2 m^3/h", "--out", "scaled")


@cache
def made() -> Path:
    """A folder with ``results/silo``, left by a run of `CASE`; that file is gone, so that a copy is its own."""
    folder = Path(tempfile.mkdtemp(prefix="attacks-result-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "case.yaml").write_text(CASE)
    ran = run(("run", "case.yaml"), folder)
    assert ran.status == 0, ran.output
    (folder / "case.yaml").unlink()
    return folder


@cache
def arrays() -> Arrays:
    """The arrays of its field."""
    with np.load(made() / FOLDER / "field.npz") as data:
        return dict(data)


def on_result(*arguments: str, change: Change, sealed: bool = False) -> Callable[[Path], Ran]:
    """An act: copy the folder, change it (its path is passed on), and start granpipe beside it.

    Parameters
    ----------
    sealed : the manifest is made anew after the change, as somebody would who forges results
    """

    def act(folder: Path) -> Ran:
        shutil.copytree(made(), folder, dirs_exist_ok=True, symlinks=True)
        (folder / "case.yaml").write_text(CASE)
        change(folder / FOLDER)
        if sealed:
            write_manifest(folder / FOLDER)
        return run(arguments, folder)

    return act


def with_field(content: Mapping[str, Any] | bytes | Change) -> Change:
    """A change: the folder's field is made of these arrays or bytes, or by what makes a file at a path."""

    def change(results: Path) -> None:
        path = results / "field.npz"
        path.unlink()
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif callable(content):
            content(path)
        else:
            np.savez(path, **content)

    return change


def whole(flow: float = 1.0, place: str = FOLDER) -> Check:
    """The field is that of the vessel at a flow rate [m³/h], and every file is as granpipe wrote it."""

    def check(folder: Path, output: str) -> str:
        if (folder / place / MANIFEST).is_dir() or changed_files(folder / place):
            return "the results are not whole"
        field, truth = Field.load(folder / place / "field.npz"), arrays()
        found = 3600 * field.bulk_flow * field.flow_scale
        if not abs(found / flow - 1) < 1e-9:
            return f"a flow of {found:g} m³/h instead of {flow:g}"
        shape = field.flux_z * field.velocity_scale / flow
        known = truth["flux_z"] * truth["flow_scale"] / truth["bulk_packing"]
        return "" if np.allclose(shape, known, rtol=1e-9, atol=0) else "another field"

    return check


def kept(*names: str, flow: float = 1.0) -> Check:
    """The same, and files of the user's (below the attack's folder) hold ``mine``."""

    def check(folder: Path, output: str) -> str:
        lost = [name for name in names if not (folder / name).is_file() or (folder / name).read_text() != "mine"]
        return f"lost: {', '.join(lost)}" if lost else whole(flow)(folder, output)

    return check
