"""Attacks on the Python API: points, profiles, cases, overrides, results, and what surrounds a run in a process."""

from __future__ import annotations

import contextlib
import copy
import os
import pickle
import shutil
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import granpipe
from attacks.attack import Attack, Ran, Right, forked, refused, right, unique
from attacks.results import CASE, FOLDER, made
from granpipe.progress import Silent

FLOW = 1 / 3600
"""Of the result that is attacked [m³/s]."""

POINTS = np.array([[0.0, 4.0], [0.3, 4.2], [0.9, 3.5], [0.4, 2.0], [0.2, 1.0]])
"""Inside its solids: r, z [m]."""

Work = Callable[[], str | None]
"""What is tried in a folder with ``case.yaml`` and ``results/silo``; says what is wrong, nothing where nothing is."""


def attacks() -> list[Attack]:
    """Every attack on the API."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (places, lines, cases, runs, surroundings, results)
    return unique([attack for kind in kinds for attack in kind()])


def python(work: Work, bare: bool = False) -> Callable[[Path], Ran]:
    """An act: status 2 where granpipe, or Python itself, refuses a value; 0 where nothing is wrong.

    Parameters
    ----------
    bare : there are no results yet
    """

    def child() -> int:
        try:
            print(f"wrong: {wrong}" if (wrong := work()) else "", end="")
        except (
            granpipe.GranpipeError,
            ValueError,
            TypeError,
            OSError,
        ) as error:  # how Python refuses a value or a path
            text = f"{type(error).__name__}: {error}"
            print(text.encode(errors="backslashreplace").decode())
            return 2
        return 0

    def act(folder: Path) -> Ran:
        if not bare:
            shutil.copytree(made(), folder, dirs_exist_ok=True, symlinks=True)
        (folder / "case.yaml").write_text(CASE)
        return forked(child, folder)

    return act


def unwronged(_: Path, output: str) -> str:
    """The check of every attack: what the child found wrong."""
    return output if "wrong: " in output else ""


RIGHT = right(unwronged)


def field() -> Any:
    """The flow that is attacked."""
    return granpipe.load_result(FOLDER).field


@cache
def known() -> Any:
    """u and w at `POINTS`, one call for each."""
    return np.array([field().velocity(r, z) for r, z in POINTS.tolist()]).T


def same(found: Any, want: Any, what: str = "values") -> str:
    """What is wrong with an array."""
    if np.shape(found) != np.shape(want):
        return f"{what} have the shape {np.shape(found)} instead of {np.shape(want)}"
    return "" if np.allclose(found, want, rtol=1e-12, atol=0, equal_nan=True) else f"{what} are {found}, not {want}"


# --- points and lines -------------------------------------------------------------------------------------------------


def places() -> Iterator[Attack]:
    """Points at which a velocity is asked."""

    def at(name: str, r: Callable[[], Any], what: Right, z: Any = 4.0, pinned: bool = False) -> Attack:
        """A radius that is no number."""

        def work() -> str:
            return f"a velocity of {field().velocity(r(), z)}"

        return Attack("points", name, python(work), what, pinned)

    def adds_up() -> str:
        r = (np.arange(4000) + 0.5) / 4000
        for z in (4.9, 4.0, 3.2):
            flow = -np.sum(field().velocity(r, z)[1] * 2 * np.pi * r) / 4000
            if not abs(flow / FLOW - 1) < 1e-5:
                return f"{flow} m³/s at z = {z} m"
        return same(field().flow_rate, FLOW) and "the flow rate is another one"

    yield Attack("points", "the flow adds up", python(adds_up), RIGHT, pinned=True)

    def nowhere(name: str, r: Any, z: Any, pinned: bool = False) -> Attack:
        """No solids are there: NaN in the shape of the points."""

        def work() -> str:
            shape = np.broadcast_shapes(np.shape(r), np.shape(z))
            found = [*field().velocity(r, z), field().psi(r, z)]
            return "".join(same(one, np.full(shape, np.nan)[()], name) for one in found)

        return Attack("points", name, python(work), RIGHT, pinned)

    yield nowhere("r = nan", np.nan, 4.0)
    yield nowhere("z = nan", 0.3, np.nan)
    yield nowhere("r = inf", np.inf, 4.0)
    yield nowhere("z = -inf", 0.3, -np.inf)
    yield nowhere("r = 1e300", 1e300, 4.0)
    yield nowhere("z = 1.7e308", 0.3, 1.7e308)
    yield nowhere("negative r", [-0.3, -1e-3], 4.0, pinned=True)
    yield nowhere("beyond the wall by 1 μm", 1.000001, 4.0)
    yield nowhere("above and below", 0.2, [5.1, 0.4, -3])
    yield nowhere("beside the cone", 0.8, 1.6)
    yield nowhere("no points", [], [])
    yield nowhere("no points in a table", np.empty((0, 3)), 4.0)

    def inside(name: str, make: Callable[[Any], Any], pinned: bool = False) -> Attack:
        """The same points in another dress."""

        def work() -> str:
            r, z = (make(column) for column in POINTS.T.copy())
            before = copy.deepcopy((r, z))
            wrong = same(field().velocity(r, z), known())
            return wrong or ("" if np.array_equal(before, (r, z)) else "the points were changed")

        return Attack("points", name, python(work), RIGHT, pinned)

    def read_only(column: Any) -> Any:
        column.flags.writeable = False
        return column

    yield inside("lists", lambda column: column.tolist())
    yield inside("tuples", lambda column: tuple(column.tolist()))
    yield inside("read-only", read_only)
    yield inside("not contiguous", lambda column: np.repeat(column, 3)[::3])
    yield inside("big endian", lambda column: column.astype(">f8"))
    yield inside("long doubles", lambda column: column.astype(np.longdouble))
    yield inside("a table of pandas", lambda column: __import__("pandas").Series(column, index=list("edcba")))

    def shapes() -> str:
        r, z = POINTS[:3, 0], POINTS[:2, 1]
        found = field().velocity(r[None, :], z[:, None])
        want = [[[field().velocity(a, b)[i] for a in r] for b in z] for i in (0, 1)]
        return same(found, want) or same(np.shape(field().velocity(0.3, 4.0)), (2,))

    yield Attack("points", "a row and a column", python(shapes), RIGHT)

    def million() -> str:
        r, z = (np.tile(column, 200_000) for column in POINTS.T)
        return same(field().velocity(r, z), np.tile(known(), 200_000))

    yield Attack("points", "a million", python(million), RIGHT)

    def masked() -> str:
        r = np.ma.masked_array(POINTS[:, 0], [False, True, False, False, True])
        want = np.where(r.mask, np.nan, known())
        return same(np.asarray(field().velocity(r, POINTS[:, 1])), want)

    yield Attack("points", "masked", python(masked), RIGHT, pinned=True)

    def axis() -> str:
        u, w = field().velocity([0.0, -0.0, 1e-300, 1e-12], 4.0)
        return same(w, np.full(4, known()[1, 0])) or ("" if np.abs(u).max() < 1e-12 else f"u = {u} on the axis")

    yield Attack("points", "on the axis", python(axis), RIGHT)
    yield at("three radii, two heights", lambda: [0.1, 0.2, 0.3], refused("shape|broadcast"), z=[4.0, 4.1])
    numbers = refused("metres")
    yield at("text", lambda: "0.3", numbers, pinned=True)
    yield at("text with a unit", lambda: "30 cm", numbers)
    yield at("None", lambda: None, numbers)
    yield at("complex", lambda: 0.3 + 1j, numbers)
    yield at("complex in an array", lambda: np.array([0.3 + 1j]), numbers)
    yield at("true", lambda: True, numbers)
    yield at("a time", lambda: np.datetime64("2026-01-01"), numbers)
    yield at("a duration", lambda: np.timedelta64(1, "s"), numbers)
    yield at("a generator", lambda: (r for r in (0.1, 0.2)), numbers)
    yield at("a dictionary", lambda: {"r": 0.3}, numbers)
    yield at("ragged lists", lambda: [[0.1], [0.2, 0.3]], refused("metres|inhomogeneous"))
    yield at("30 cm of pint", lambda: _pint(30, "cm"), numbers, pinned=True)
    yield at("30 cm of pint in an array", lambda: _pint(np.array([30.0]), "cm"), numbers)


def _pint(value: Any, unit: str) -> Any:
    import pint

    return pint.UnitRegistry().Quantity(value, unit)


def lines() -> Iterator[Attack]:
    """Profiles, stream lines, pictures and tables."""

    def asked(name: str, what: Right, ask: Callable[[Any], Any], pinned: bool = False) -> Attack:
        def work() -> str:
            return f"it gave {ask(field())!r:.200}"

        return Attack("lines", name, python(work), what, pinned)

    either = refused("either z or r")
    yield asked("a profile along nothing", either, lambda flow: flow.profile())
    yield asked("a profile along both", either, lambda flow: flow.profile(z=1, r=1))
    one = refused("number")
    yield asked("a profile at two levels", one, lambda flow: flow.profile(z=[4.0, 3.0], count=2), pinned=True)
    yield asked("a profile at text", one, lambda flow: flow.profile(z="4 m"))
    yield asked("a profile at nan", one, lambda flow: flow.profile(z=np.nan))
    for count in (-1, 0, 1, 2.5, "5", np.nan, None):
        yield asked(
            f"a profile of {count!r} points", refused("count"), lambda flow, n=count: flow.profile(z=4, count=n)
        )
    for n in (-1, 0, 1.5, "3", np.nan, None):
        yield asked(f"{n!r} stream lines", refused("stream lines"), lambda flow, n=n: flow.streamlines(n), n == 1.5)

    def ends() -> str:
        lines = field().streamlines(7)
        if len(lines) != 7:
            return f"{len(lines)} lines"
        start = np.array([line[0, 0] for line in lines])  # above, where w hardly depends on r but at the wall
        share = np.array([-2 * np.pi * field().psi(r, 4.9) / FLOW for r in start])
        return "" if np.allclose(share, (np.arange(7) + 0.5) / 7, atol=0.01) else f"they carry {share}"

    yield Attack("lines", "seven stream lines", python(ends), RIGHT)

    def outside() -> str:
        found = field().profile(z=100.0)
        return same(found.w, np.full(201, np.nan)) or same(found.r, np.linspace(0, found.r[-1], 201))

    yield Attack("lines", "a profile far above", python(outside), RIGHT)
    for name in ("nonsense", None, "", 5, ["w"]):
        yield asked(f"a picture of {name!r}", refused("streamlines"), lambda flow, name=name: flow.plot(name))
    fluid = refused("this field|no |does not")
    yield asked("the error of a fluid", fluid, lambda flow: flow.velocity_error(0.1, 4.0))
    yield asked("the packing of a fluid", fluid, lambda flow: flow.packing(0.1, 4.0))
    yield asked("a picture of a fluid's packing", fluid, lambda flow: flow.plot("packing"))


# --- cases and runs ---------------------------------------------------------------------------------------------------


def cases() -> Iterator[Attack]:
    """What `load_case` is given."""

    def read(name: str, path: Any, *words: str) -> Attack:
        def work() -> str:
            return f"it read {granpipe.load_case(path)!r:.100}"

        return Attack("cases", name, python(work, bare=True), refused(*words))

    yield read("None", None, "path|NoneType")
    yield read("a number", 5, "path|int")
    yield read("bytes", b"case.yaml", "str|bytes")
    yield read("no name", "", "folder|directory|not found|regular")
    yield read("a folder", ".", "folder|regular|directory")
    yield read("a null byte", "a\0b", "null")
    yield read("half a character", "\ud800", "cannot be read|not found|surrogate")
    yield read("another one's text", CASE, "name too long|not found|cannot")

    def given(name: str, overrides: Any, what: Right, pinned: bool = False) -> Attack:
        def work() -> str:
            made = granpipe.load_case("case.yaml", overrides() if callable(overrides) else overrides)
            return f"it gave {made.flow_rate!r}, seed {made.dem.seed!r}, size {made.material.size!r}"

        return Attack("overrides", name, python(work, bare=True), what, pinned)

    def read_as(name: str, overrides: Any, want: Callable[[Any], bool], pinned: bool = False) -> Attack:
        def work() -> str:
            made = granpipe.load_case("case.yaml", overrides() if callable(overrides) else overrides)
            return "" if want(made) else f"it gave {made!r}"

        return Attack("overrides", name, python(work, bare=True), RIGHT, pinned)

    yield given("a list", ["dem.seed=2"], refused("overrides"))
    yield given("text", "dem.seed=2", refused("overrides"))
    yield given("a key that is a number", {5: 2}, refused("key"))
    seed = refused("seed")
    for name, value in {
        "nan": np.nan,
        "infinity": np.inf,
        "nothing": None,
        "half": 2.5,
        "a set": {2},
        "bytes": b"2",
        "a function": len,
        "a thing": object(),
        "complex": 2j,
        "10 to the 400th": 10**400,
        "a list of itself": [],
        "a thousand lists": None,
        "two lines": "2\nname: other",
        "half a character": "\ud800",
        "a mapping": {"first": 1},
        "an array": np.array([1, 2]),
    }.items():
        if name == "a list of itself":
            value.append(value)
        if name == "a thousand lists":
            value = []
            for _ in range(100_000):
                value = [value]
        yield given(f"seed {name}", {"dem.seed": value}, seed, name in ("a set", "nan"))
    yield read_as("seed as a number of numpy", {"dem.seed": np.int64(7)}, lambda case: case.dem.seed == 7)
    size = {"diameter": 0.05}
    near = lambda a, b: abs(a / b - 1) < 1e-12  # noqa: E731
    diameter = lambda case: case.material.size.diameter.mono  # noqa: E731
    for name, value in {
        "a Decimal": Decimal("0.05"),
        "a Fraction": Fraction(1, 20),
        "single precision": np.float32(0.0625),
        "an array of one number": np.array(0.05),
    }.items():
        want = float(value)
        yield read_as(
            f"a size as {name}",
            {"material.size": {"diameter": value}},
            lambda case, want=want: near(diameter(case), want),
        )
    yield read_as("a size", {"material.size": size}, lambda case: near(diameter(case), 0.05))
    yield read_as(
        "a size as 50 mm of pint",
        lambda: {"material.size": {"diameter": _pint(50, "mm")}},
        lambda case: near(diameter(case), 0.05),
        pinned=True,
    )
    yield read_as(
        "a wall as an array",
        {"outline.wall": np.array([[1.0, 6.0], [1.0, 0.5]]), "outline.sections": {}},
        lambda case: case.outline.wall == ((1.0, 6.0), (1.0, 0.5)),
    )


def runs() -> Iterator[Attack]:
    """What `run` is given."""

    def given(name: str, what: Right, work: Callable[[], Any], pinned: bool = False) -> Attack:
        return Attack("runs", name, python(lambda: f"it gave {work()!r}", bare=True), what, pinned)

    def case(**changes: Any) -> Any:
        return granpipe.load_case("case.yaml", changes)

    no_case = refused("load_case")
    yield given("the name of a case", no_case, lambda: granpipe.run("case.yaml"), pinned=True)  # type: ignore[arg-type]
    yield given("no case", no_case, lambda: granpipe.run(None))  # type: ignore[arg-type]
    yield given("a dictionary", no_case, lambda: granpipe.run({"name": "silo"}))  # type: ignore[arg-type]
    for results in (None, 5, b"results"):
        yield given(
            f"results {results!r}", refused("path|str"), lambda results=results: granpipe.run(case(), results=results)
        )
    yield given("results in a file", refused("case.yaml"), lambda: granpipe.run(case(), results="case.yaml"))
    for name, progress in {"nonsense": "nonsense", "a number": 5, "a thing": object()}.items():
        yield given(
            f"progress to {name}",
            refused("progress"),
            lambda progress=progress: granpipe.run(case(), progress=progress),
        )

    def changed(**update: Any) -> Any:
        return granpipe.run(case().model_copy(update=update), progress=None)

    yield given("a flow rate put in afterwards", refused("flow"), lambda: changed(flow_rate=-1.0), pinned=True)
    yield given("a name put in afterwards", refused("name"), lambda: changed(name="../other"))
    yield given("a model put in afterwards", refused("model"), lambda: changed(model="magic"))

    def meant() -> str:
        return same(changed(flow_rate="2 m^3/h").field.flow_rate, 2 * FLOW)

    yield Attack("runs", "text for a flow rate put in afterwards", python(meant, bare=True), RIGHT)


class Raising(Silent):
    """Progress whose owner changes his mind."""

    def stage(self, name: str, detail: str = "") -> None:
        raise KeyboardInterrupt if name == "fluid" else AssertionError(name)


def surroundings() -> Iterator[Attack]:
    """What else goes on in the process."""

    def right_run(result: Any = None) -> str:
        result = result or granpipe.run(granpipe.load_case("case.yaml"), progress=None)
        return same(result.field.velocity(*POINTS.T), known_before)

    known_before: Any = None

    def around(name: str, work: Callable[[Callable[..., str]], str | None], pinned: bool = False) -> Attack:
        def all_of_it() -> str | None:
            nonlocal known_before
            with contextlib.chdir(made()):
                known_before = known()
            return work(right_run)

        return Attack("process", name, python(all_of_it, bare=True), RIGHT, pinned)

    yield around("a run", lambda again: again(), pinned=True)

    def strict(again: Callable[..., str]) -> str:
        with np.errstate(all="raise"):
            return again()

    yield around("numpy raises at underflow", strict)

    def errors(again: Callable[..., str]) -> str:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return again()

    yield around("warnings are errors", errors)

    def printed(again: Callable[..., str]) -> str:
        with np.printoptions(precision=2, threshold=3, suppress=True):
            return again()

    yield around("numpy prints two digits", printed)

    def thread(again: Callable[..., str]) -> str:
        found: list[str] = []

        def work() -> None:
            try:
                found.append(again())
            except BaseException as error:
                found.append(repr(error))

        threads = [threading.Thread(target=work)]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
        return "".join(found)

    yield around("in a thread", thread)

    def threads(_: Callable[..., str]) -> str:
        found: dict[int, float] = {}

        def work(n: int) -> None:
            case = granpipe.load_case("case.yaml", {"name": f"silo{n}", "flow_rate": f"{n} m^3/h"})
            found[n] = granpipe.run(case, progress=None).field.flow_rate

        some = [threading.Thread(target=work, args=(n,)) for n in (1, 2, 3)]
        for one in some:
            one.start()
        for one in some:
            one.join()
        return same([found.get(n, np.nan) for n in (1, 2, 3)], [FLOW, 2 * FLOW, 3 * FLOW])

    yield around("in three threads", threads, pinned=True)

    def own_gmsh(again: Callable[..., str]) -> str:
        """Refused, and the model is still there; without it, the run works."""
        import gmsh

        gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        gmsh.model.occ.addSphere(0, 0, 0, 1)
        gmsh.model.occ.synchronize()
        try:
            return again() or "it ran"
        except granpipe.MeshError as error:
            if "gmsh.finalize()" not in str(error):
                return str(error)
        if not gmsh.isInitialized() or gmsh.model.getCurrent() != "mine" or len(gmsh.model.getEntities(3)) != 1:
            return "the user's own model in gmsh is gone"
        gmsh.finalize()
        return again()

    yield around("beside a model in gmsh", own_gmsh, pinned=True)

    def traceless(again: Callable[..., str]) -> str:
        import matplotlib

        handlers = lambda: [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGTSTP)]  # noqa: E731
        state = lambda: (handlers(), dict(os.environ), Path.cwd(), dict(matplotlib.rcParams), np.geterr())  # noqa: E731
        before, streams = state(), len([*Path("/proc/self/fd").iterdir()])
        wrong = again()
        if len([*Path("/proc/self/fd").iterdir()]) > streams:
            return wrong or "files stay open"
        return wrong or ("" if before == state() else "handlers, environment, folder or styles are others")

    yield around("nothing is left changed", traceless)

    def moved(again: Callable[..., str]) -> str:
        case = granpipe.load_case("case.yaml")
        Path("below").mkdir()
        os.chdir("below")
        return again(granpipe.run(case, progress=None))

    yield around("the folder changes between reading and running", moved)

    def interrupted(again: Callable[..., str]) -> str:
        case = granpipe.load_case("case.yaml")
        try:
            granpipe.run(case, progress=Raising())
        except KeyboardInterrupt:
            return again()
        return "the interrupt is lost"

    yield around("the user's progress raises", interrupted)

    class Nested(Silent):
        said = ""

        def stage(self, name: str, detail: str = "") -> None:
            try:
                granpipe.run(granpipe.load_case("case.yaml"), progress=None)
            except granpipe.RunError as error:
                Nested.said = str(error)

    def nested(again: Callable[..., str]) -> str:
        wrong = again(granpipe.run(granpipe.load_case("case.yaml"), progress=Nested()))
        return wrong or ("" if "another granpipe" in Nested.said else f"the second run: {Nested.said!r}")

    yield around("a run in the progress of the same run", nested)

    def pickled(again: Callable[..., str]) -> str:
        case = pickle.loads(pickle.dumps(granpipe.load_case("case.yaml")))
        result = granpipe.run(case, progress=None)
        return again(pickle.loads(pickle.dumps(result))) or again(copy.deepcopy(result))

    yield around("case and result pickled and copied", pickled)

    def edited(again: Callable[..., str]) -> str:
        case = granpipe.load_case("case.yaml")
        wrong = again(granpipe.run(case, progress=None))
        result = granpipe.run(case.model_copy(update={"flow_rate": case.flow_rate}), progress=None)
        return wrong or again(result)

    yield around("a copy of a case", edited)


def results() -> Iterator[Attack]:
    """What `load_result` is given."""

    def opened(
        name: str, what: Right, folder: Any = FOLDER, change: Callable[[Path], object] = lambda _: None
    ) -> Attack:
        def work() -> str:
            change(Path(FOLDER))
            return f"it opened {granpipe.load_result(folder)!r}"

        return Attack("results", name, python(work), what)

    yield opened("None", refused("path|NoneType"), None)
    yield opened("a number", refused("path|int"), 5)
    yield opened("bytes", refused("bytes"), FOLDER.encode())
    yield opened("no name", refused("manifest.json"), "")
    yield opened("nowhere", refused("field.npz|not found"), "nowhere")
    yield opened("a file", refused("field.npz|case.yaml"), "case.yaml")
    yield opened("the folder of all results", refused("field.npz"), "results")
    yield opened("a null byte", refused("null"), "a\0b")
    yield opened("half a character", refused("field.npz|not found|surrogate"), "\ud800")
    yield opened("a loop of links", refused("loop"), "loop", lambda _: Path("loop").symlink_to("loop"))
    yield opened("10 000 characters", refused("name too long|not found"), "a" * 10_000)

    def others(path: Path) -> None:
        with np.load(path / "field.npz") as data:
            arrays = dict(data)
        np.savez(path / "field.npz", **(arrays | {"flow_scale": 2 * arrays["flow_scale"]}))

    yield opened("a field that was changed", refused("field.npz"), change=others)
    yield opened(
        "a record that was changed", refused("provenance"), change=lambda path: _append(path / "provenance.json")
    )
    yield opened("no manifest", refused("manifest"), change=lambda path: (path / "manifest.json").unlink())

    def alone() -> str:
        shutil.copytree(FOLDER, "alone", ignore=lambda _, names: [name for name in names if name != "field.npz"])
        result = granpipe.load_result("alone")
        return same(result.field.velocity(*POINTS.T), known()) or ("" if result.gates == () else "gates from nowhere")

    yield Attack("results", "a field alone", python(alone), RIGHT)

    def assigned() -> str:
        result = granpipe.load_result(FOLDER)
        with contextlib.suppress(AttributeError):
            result.model = "dem"  # type: ignore[misc]
            return "a result can be changed"
        return same(replace(result.field).velocity(*POINTS.T), known())

    yield Attack("results", "assigned to", python(assigned), RIGHT)


def _append(path: Path) -> None:
    with path.open("a") as file:
        file.write(" ")
