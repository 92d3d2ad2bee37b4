"""Attacks on results folders, manifests, stores and locks: run, scale, compare, plot and clean."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from attacks.attack import Attack, Check, granpipe, refused, right, unique
from attacks.cases import SILO, varied
from attacks.results import CASE, FASTER, FOLDER, SCALE, Change, kept, on_result, whole

RUN, AGAIN = ("run", "case.yaml"), ("run", "case.yaml", *FASTER)
COMPARE = ("compare", FOLDER, FOLDER)
PLOT = ("plot", FOLDER, "--what", "w", "--out", "picture.png")


def attacks() -> list[Attack]:
    """Every attack on folders."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (damage, hostile, manifests, users, stores, targets)
    return unique([attack for kind in kinds for attack in kind()])


def flipped(path: Path) -> None:
    """Change a bit in the middle."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def emptied(path: Path) -> None:
    """Take all bytes away."""
    path.write_bytes(b"")


def replaced(path: Path) -> None:
    """Put a folder of the user's in its place."""
    path.unlink()
    path.mkdir()
    (path / "letter").write_text("mine")


def piped(path: Path) -> None:
    """Put a pipe in its place."""
    path.unlink()
    os.mkfifo(path)


DAMAGE: dict[str, Change] = {
    "flipped": flipped,
    "emptied": emptied,
    "gone": Path.unlink,
    "a folder": replaced,
    "a pipe": piped,
}


def damage() -> Iterator[Attack]:
    """Every kind of file that a run leaves, damaged in every way: noticed and made anew."""
    names = (
        "field.npz",
        "case.yaml",
        "provenance.json",
        "plan.json",
        "manifest.json",
        "report.html",
        "comsol/psi_grid.txt",
    )
    for name in names:
        for how, change in DAMAGE.items():
            pinned = (name, how) in (("field.npz", "flipped"), ("manifest.json", "emptied"))

            def changed(results: Path, name: str = name, change: Change = change) -> None:
                change(results / name)

            def made_anew(folder: Path, output: str, how: str = how) -> str:
                if "nothing to do" in output:
                    return "not noticed"
                letters = [path.read_text() for path in (folder / "results").rglob("letter")]
                return (
                    "the user's letter is lost"
                    if how == "a folder" and letters != ["mine"]
                    else whole()(folder, output)
                )

            yield Attack(
                "damaged files", f"{name} {how}: run", on_result(*RUN, change=changed), right(made_anew), pinned
            )
            for command, arguments, read in (
                ("scale", SCALE, names[:3]),
                ("compare", COMPARE, names[:3]),
                ("plot", PLOT, names[:2]),
            ):
                if name in (*read, "manifest.json"):
                    what = refused(name.replace(".", r"\.") + "|no case.yaml|has no manifest")
                    if command == "plot" and name == "manifest.json" and how == "gone":
                        continue  # a field that stands alone is drawn
                    yield Attack(
                        "damaged files", f"{name} {how}: {command}", on_result(*arguments, change=changed), what
                    )


def hostile() -> Iterator[Attack]:
    """Records that are sealed by a new manifest, but are not what granpipe writes."""
    texts = {
        "null": "null",
        "a list": "[]",
        "empty": "{}",
        "100 000 brackets": "[" * 100_000,
        "5 000 groups": '{"quality": {"a":' * 5_000,
        "half a character": '"\\ud800"',
        "a BOM": "\ufeff{}",
        "a number of 10 000 digits": "1" * 10_000,
        "binary": "\0\1\2",
    }
    for name, text in texts.items():

        def changed(results: Path, text: str = text) -> None:
            (results / "provenance.json").write_text(text)

        def manifest(results: Path, text: str = text) -> None:
            (results / "manifest.json").write_text(text)

        for command, arguments in (("scale", SCALE), ("compare", COMPARE)):
            act = on_result(*arguments, change=changed, sealed=True)
            yield Attack("hostile records", f"provenance {name}: {command}", act, refused(r"provenance\.json: "))
            act = on_result(*arguments, change=manifest)
            yield Attack("hostile records", f"manifest {name}: {command}", act, refused(r"manifest\.json: damaged"))
        act = on_result(*PLOT, change=manifest)
        yield Attack(
            "hostile records", f"manifest {name}: plot", act, refused(r"manifest\.json: damaged"), name == "null"
        )
        yield Attack(
            "hostile records", f"provenance {name}: run", on_result(*RUN, change=changed, sealed=True), right(whole())
        )
        yield Attack("hostile records", f"manifest {name}: run", on_result(*RUN, change=manifest), right(whole()))

    def failed(results: Path) -> None:
        record = json.loads((results / "provenance.json").read_text())
        record["quality"][0]["passed"] = False
        (results / "provenance.json").write_text(json.dumps(record))

    yield Attack(
        "hostile records",
        "a gate that failed is told: compare",
        on_result(*COMPARE, change=failed, sealed=True),
        right(lambda *_: "", "quality gate failed"),
    )


def manifests() -> Iterator[Attack]:
    """Manifests that are forged to have a file of the user's replaced or removed."""

    def forged(
        name: str, place: str, entry: str | None = None, sha256: Any = None, what: Check | None = None
    ) -> Attack:
        """`entry` of the manifest names a file of the user's, which is at `place` below the attack's folder."""

        def change(results: Path) -> None:
            folder = results.parents[1]
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            (folder / place).write_text("mine")
            data = json.loads((results / "manifest.json").read_text())
            files = data["files"]
            files[entry or str(folder / place)] = sha256 or hashlib.sha256(b"mine").hexdigest()
            data["sha256"] = hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()
            (results / "manifest.json").write_text(json.dumps(data))

        return Attack("forged manifests", name, on_result(*AGAIN, change=change), right(what or kept(place, flow=2.0)))

    yield forged("a file outside", "results/letter", "../letter")
    yield forged("a file outside, the long way", "letter", "comsol/../../../letter")
    yield forged("an absolute path", "letter")
    yield forged("with a null byte", "letter", "a\0b")
    yield forged("half a character", "letter", "\ud800")
    yield forged("a hash that is a number", "letter", "letter", 5)
    yield forged("the folder itself", "letter", ".")
    yield forged("no name", "letter", "")


def users() -> Iterator[Attack]:
    """The user's own files in a results folder of which granpipe renews its files."""

    def mine(name: str, *places: str, link: bool = False, pinned: bool = False) -> Attack:
        def change(results: Path) -> None:
            for place in places:
                (results / place).parent.mkdir(parents=True, exist_ok=True)
                (results / place).unlink(missing_ok=True)
                (results / place).write_text("mine")

        below = [f"{FOLDER}/{place}" for place in places]
        return Attack("the user's files", name, on_result(*AGAIN, change=change), right(kept(*below, flow=2.0)), pinned)

    yield mine("notes and a model", "notes.txt", "comsol/flow.mph", pinned=True)
    yield mine("hidden", ".notes", "comsol/.lock")
    yield mine("odd names", "a\nb", "ü $(x)", "-rf")
    yield mine("a leftover of a killed run", ".granpipe.0000.part/letter.txt", "notes")

    def edited(results: Path) -> None:
        (results / "case.yaml").write_text("mine")

    def aside(folder: Path, output: str) -> str:
        copy = folder / FOLDER / "case.changed-1.yaml"
        return whole(2.0)(folder, output) if copy.is_file() and copy.read_text() == "mine" else "the edit is lost"

    yield Attack("the user's files", "an edited file", on_result(*AGAIN, change=edited), right(aside))

    def linked(results: Path) -> None:
        results.rename(results.with_name("elsewhere"))
        results.symlink_to("elsewhere")

    def still(folder: Path, output: str) -> str:
        return whole(2.0)(folder, output) if (folder / FOLDER).is_symlink() else "the link is gone"

    yield Attack("the user's files", "the folder is a link", on_result(*AGAIN, change=linked), right(still))
    other = varied(
        SILO, {"outline.wall": [[1.0, 5.0], [1.0, 3.0], [0.5, 1.5], [0.5, 0.4]], "outline.sections.c": [1.5, 0.4]}
    )

    def second(results: Path) -> None:
        (results.parents[1] / "two").mkdir()
        (results.parents[1] / "two" / "other.yaml").write_text(other)

    act = on_result("run", "two/other.yaml", change=second)
    yield Attack("the user's files", "another case of the name", act, refused("results of another case"))
    for name, content in {"a letter": "mine", "a thesis": {"chapter": "mine"}}.items():

        def foreign(results: Path, content: Any = content) -> None:
            shutil.rmtree(results)
            if isinstance(content, str):
                results.write_text(content)
            else:
                results.mkdir()
                (results / "chapter").write_text("mine")

        yield Attack(
            "the user's files", f"{name} in its place", on_result(*RUN, change=foreign), refused("move it away")
        )


def stores() -> Iterator[Attack]:
    """The store of stages, locks and what `granpipe clean` deletes."""

    def stored(name: str, markers: dict[str, str | None], link: bool = False) -> Attack:
        """Folders in the store with these markers, each with a letter of the user's."""

        def change(path: Path) -> None:
            store = path.with_name("scratch") if link else path
            store.mkdir(parents=True)
            for folder, marker in markers.items():
                (store / folder).mkdir()
                (store / folder / "letter").write_text("mine")
                if marker is not None:
                    (store / folder / "stage.json").write_text(marker)
            if link:
                path.symlink_to("scratch")

        def check(folder: Path, output: str) -> str:
            lost = [name for name in markers if not (folder / "results/.store" / name / "letter").is_file()]
            return f"deleted {lost}" if lost else ""

        act = granpipe("clean", files={"results/.store": change})
        return Attack("the store", name, act, right(check, "granpipe has not written all that is in it"), link)

    yield stored("a thesis", {"thesis": None})
    yield stored("a thesis behind a link", {"thesis": None}, link=True)
    yield stored(
        "markers of other kinds", {"a": "null", "b": "[" * 100_000, "c": '{"stage": 1, "key": "c"}', "d-": "{}"}
    )
    yield stored("markers without a key", {"a-b": '{"stage": "a", "key": ""}', "-": '{"stage": "", "key": ""}'})
    yield stored("the marker of another folder", {"walls-b": '{"stage": "walls", "key": "a"}'})
    yield Attack(
        "the store", "a file", granpipe("clean", files={"results/.store": "mine"}), right(lambda *_: "", "nothing")
    )
    yield Attack("the store", "none", granpipe("clean"), right(lambda *_: "", "nothing to do"))

    def linked(path: Path) -> None:
        path.with_name("letter").write_text("mine")
        path.symlink_to("letter")

    makers: dict[str, Any] = {
        "a link to a letter": linked,
        "a pipe": os.mkfifo,
        "a folder": Path.mkdir,
        "a letter": "mine",
    }
    for name, maker in makers.items():
        act = granpipe("run", "case.yaml", files={"case.yaml": CASE, "results/.silo.lock": maker})
        yield Attack("the store", f"the lock is {name}", act, refused("not a lock that granpipe wrote"))
    for name, maker in {
        "a pipe": os.mkfifo,
        "a file": "mine",
        "a link to itself": lambda path: path.symlink_to(path.name),
    }.items():
        act = granpipe("run", "case.yaml", files={"case.yaml": CASE, "results": maker})
        yield Attack("the store", f"results is {name}", act, refused("results"))
    for place in ("/dev/null", "/dev/full/x", "/proc/granpipe", "a" * 300, "/".join(["a" * 200] * 25)):
        act = granpipe("run", "case.yaml", "--results", place, files={"case.yaml": CASE})
        yield Attack("the store", f"--results {place[:20]} ({len(place)})", act, refused())


def targets() -> Iterator[Attack]:
    """Flow rates, targets and pictures that make no sense."""
    none: Change = lambda _: None  # noqa: E731
    for flow in (
        "0",
        "3",
        "-1 m^3/h",
        "nan",
        "inf",
        "1e9 t/h",
        "1 m",
        "1e-300 m^3/h",
        "",
        "{volume: 2}",
        "[1, 2]",
        "$(id)",
    ):
        arguments = ("scale", FOLDER, "--flow", flow, "--out", "scaled")
        yield Attack(
            "targets", f"scale to {flow!r}", on_result(*arguments, change=none), refused("flow"), flow == "nan"
        )
    for out in ("", ".", "/", "results", FOLDER, "case.yaml/below", "a" * 300, "/dev/null", "/proc/x"):
        arguments = ("scale", FOLDER, "--flow", "2 m^3/h", "--out", out)
        yield Attack("targets", f"scale into {out[:20]!r}", on_result(*arguments, change=none), refused(), out == "")
    for out in (
        "",
        ".",
        "case.yaml",
        "results",
        "picture.txt",
        "picture.pdf",
        "picture",
        "no/such/picture.png",
        "/dev/null",
    ):
        arguments = ("plot", FOLDER, "--what", "w", "--out", out)
        yield Attack("targets", f"plot into {out!r}", on_result(*arguments, change=none), refused())
    for level in ("z=100", "z=nan", "z=inf", "z=-1 m", "r=1", "z=", "z=1 s", "nonsense"):
        arguments = ("plot", FOLDER, "--profile", level, "--out", "picture.png")
        yield Attack("targets", f"profile at {level!r}", on_result(*arguments, change=none), refused())
    for what in ("nonsense", "error", "packing"):
        arguments = ("plot", FOLDER, "--what", what, "--out", "picture.png")
        yield Attack("targets", f"picture of {what!r}", on_result(*arguments, change=none), refused())
    for one, other in (("nowhere", FOLDER), (FOLDER, "nowhere"), ("case.yaml", FOLDER), (FOLDER, "results")):
        yield Attack("targets", f"compare {one} with {other}", on_result("compare", one, other, change=none), refused())

    def wider(results: Path) -> None:
        """Another vessel, sealed, with the case of the first: what it tells of the first is wrong."""
        text = (results / "case.yaml").read_text()
        (results / "case.yaml").write_text(text.replace("0.5", "0.6"))

    for command, arguments in (("scale", SCALE), ("plot", PLOT), ("compare", COMPARE)):
        act = on_result(*arguments, change=wider, sealed=True)
        yield Attack("targets", f"the case of another vessel: {command}", act, refused("not the field of the case"))
