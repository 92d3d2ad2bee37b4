"""Attacks on sweep.yaml, cluster.yaml, studies, and the folder of a sweep that is done."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from attacks.attack import Attack, Check, Ran, Right, granpipe, refused, right, run, unique
from attacks.folders import flipped
from attacks.results import CASE, Change
from granpipe.field import Field

HEAD = "name: many\ncase: case.yaml\n"
AXES = f"{HEAD}axes:\n"
DONE = f"{HEAD}axes:\n- flow_rate: [1 m^3/h, 2 m^3/h]\n"
FOLDER = "results/many"


def attacks() -> list[Attack]:
    """Every attack on sweeps."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (axes, names, files, profiles, folders, studies)
    return unique([attack for kind in kinds for attack in kind()])


def planned(kind: str, name: str, text: str | bytes, what: Right | None = None, pinned: bool = False) -> Attack:
    """An attack on ``granpipe sweep run --dry-run``."""
    act = granpipe("sweep", "run", "sweep.yaml", "--dry-run", files={"case.yaml": CASE, "sweep.yaml": text})
    return Attack(kind, name, act, what or refused(r"sweep\.yaml|case\.yaml|no\.yaml"), pinned)


def axes() -> Iterator[Attack]:
    """Axes and ranges."""
    points = right(lambda _, out: "" if len(out.split()) == 3 else "not a folder and two points")
    yield planned("axes", "two points", f"{AXES}- flow_rate: [1 m^3/h, 2 m^3/h]\n", points)
    seed = "- dem.seed: "
    for name, text in {
        "1e9 points": "{first: 1, last: 1000000000, number: 1000000000}",
        "one too many": "{first: 1, last: 100001, number: 100001}",
        "none": "{first: 1, last: 2, number: 0}",
        "fewer than none": "{first: 1, last: 2, number: -1}",
        "two and a half": "{first: 1, last: 2, number: 2.5}",
        "nan": "{first: 1, last: 2, number: .nan}",
        "yes": "{first: 1, last: 2, number: true}",
        "from infinity": "{first: .inf, last: 2, number: 3}",
        "in two units": "{first: 1 m, last: 2 s, number: 3}",
        "four times the same": "{first: 3, last: 3, number: 4}",
        "twice": "[1, 1]",
        "twice in other words": "[1, 1.0]",
        "no values": "[]",
        "a number": "5",
        "a Python object": "[!!python/object/apply:os.getcwd []]",
        "shell": '["$(id)"]',
        "a null byte": '["1\\0"]',
        "20 000 brackets": "[" * 10_000 + "]" * 10_000,
    }.items():
        yield planned("axes", name, f"{AXES}{seed}{text}\n", pinned=name in ("1e9 points", "yes"))
    many = "{first: 1, last: 1000, number: 1000}"
    yield planned("axes", "1e60 crossed", AXES + "".join(f"- k{number}.x: {many}\n" for number in range(20)))
    for name, text in {
        "no axis": "[]",
        "a map": "{flow_rate: [1 m^3/h]}",
        "an empty axis": "[{}]",
        "axes of numbers": "[5]",
        "of unequal length": "[{flow_rate: [1 m^3/h], dem.seed: [1, 2]}]",
        "a key twice": "[{dem.seed: [1]}, {dem.seed: [2]}]",
        "a key and its part": "[{dem: [{seed: 1}]}, {dem.seed: [2]}]",
        "a path for a key": "[{../x: [1]}]",
        "a method for a key": "[{__class__.x: [1]}]",
        "no key": '[{"": [1]}]',
        "a number for a key": "[{5: [1]}]",
        "the name": "[{name: [a, b]}]",
        "an unknown key": "[{nonsense.key: [1]}]",
        "100 000 letters": f"[{{{'a' * 100_000}: [1]}}]",
        "above free discharge": "[{flow_rate: [1 m^3/h, 1e9 t/h]}]",
    }.items():
        yield planned("axes", name, f"{HEAD}axes: {text}\n")
    bomb = "a: &a [1,1,1,1,1,1,1,1,1]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\n"
    yield planned("axes", "an alias bomb", f"{bomb}{HEAD}axes: [{{dem.seed: *c}}]\n")


def names() -> Iterator[Attack]:
    """Names of sweeps and points, which become folders."""
    for name in ("..", "a/b", ".store", "", "-rf", "a" * 65, "öl", "a\nb", "$(id)", "a b", "/abs", "a\\0"):
        text = f"name: {json.dumps(name)}\ncase: case.yaml\naxes: [{{dem.seed: [1]}}]\n"
        yield planned("names", f"sweep {name[:9]!r} ({len(name)})", text, pinned=name == "..")
        text = f"{HEAD}points: {{{json.dumps(name)}: {{dem.seed: 1}}}}\n"
        yield planned("names", f"point {name[:9]!r} ({len(name)})", text)
    for name, text in {
        "no name": "{null: {dem.seed: 1}}",
        "twice": "{a: {dem.seed: 1}, a: {dem.seed: 2}}",
        "the same under two": "{a: {dem.seed: 1}, b: {dem.seed: 1}}",
        "changes in a list": "{a: [1]}",
        "an unknown key": "{a: {nonsense: 1}}",
    }.items():
        yield planned("names", name, f"{HEAD}points: {text}\n")
    yield planned("names", "that of an axis", f"{AXES}- dem.seed: [1, 2]\npoints: {{seed-1: {{dem.seed: 7}}}}\n")


def files() -> Iterator[Attack]:
    """The files themselves."""
    one = "axes: [{dem.seed: [1]}]\n"
    for name, text in {
        "nothing": "",
        "null": "null\n",
        "a list": "- 1\n",
        "a case": CASE,
        "UTF-16": f"{HEAD}{one}".encode("utf-16"),
        "Latin-1": f"{HEAD}{one}# \xfc\n".encode("latin-1"),
        "a null byte": f"{HEAD}{one}\0",
        "two documents": f"{HEAD}{one}---\nname: b\n",
        "a line of 2 MB": f"name: {'a' * 2_000_000}",
        "a key twice": f"{HEAD}name: b\n{one}",
        "an unknown key": f"{HEAD}{one}nonsense: 1\n",
        "no points": HEAD,
        "the case /dev/zero": f"name: many\ncase: /dev/zero\n{one}",
        "the case itself": f"name: many\ncase: sweep.yaml\n{one}",
        "no such case": f"name: many\ncase: no.yaml\n{one}",
        "the case a folder": f"name: many\ncase: .\n{one}",
        "a chart of shell": f'{HEAD}{one}chart: ["a;b"]\n',
        "a table in xls": f"{HEAD}{one}table: [xls]\n",
    }.items():
        yield planned("sweep files", name, text, pinned=name == "a case")


def profiles() -> Iterator[Attack]:
    """cluster.yaml, of which scripts are made."""
    for name, text in {
        "empty": "",
        "no time": "time: 0\n",
        "1e99 h": "time: 1e99 h\n",
        "a margin above the time": "time: 60 s\nmargin: 100 s\n",
        "memory without unit": "time: 1 h\nmemory: 4\n",
        "1e9 ranks": "time: 1 h\nranks: 1000000000\n",
        "none at once": "time: 1 h\nat_once: 0\n",
        "an unknown key": "time: 1 h\nfoo: 1\n",
        "partition": 'time: 1 h\npartition: "a;rm -rf /"\n',
        "account": 'time: 1 h\naccount: "a\\n#SBATCH --wrap=x"\n',
        "module": 'time: 1 h\nmodules: ["a;b"]\n',
        **{
            f"setup {words}": f"time: 1 h\nsetup: [{json.dumps(words)}]\n"
            for words in ("true; rm x", "A=$(id)", "export A=`id`", "eval x", "exec x", "exit 0", "trap x EXIT", "wait",
                          "command eval x", "builtin exit", "alias exit=true", "export A=1\nrm x", "a | b", "a > b")
        },
        **{
            f"option {option}": f"time: 1 h\noptions: [{json.dumps(option)}]\n"
            for option in ("--array=1-9", "--arr=1-9", "--wrap=x", "--output=/dev/null", "--parsable", "--time=5",
                           "-a1", "--qos=a --wrap=b", "--qos=a\n#SBATCH --wrap=b", "--ntasks=5",
                           "--export=NONE", "--chdir=/")
        },
    }.items():  # fmt: skip
        act = granpipe("sweep", "run", "sweep.yaml", "--on", "slurm", files={
            "case.yaml": CASE, "sweep.yaml": f"{AXES}- flow_rate: [1 m^3/h]\n", "cluster.yaml": text,
        })  # fmt: skip
        yield Attack("cluster.yaml", name, act, refused(r"cluster\.yaml"), name == "setup command eval x")


@cache
def made() -> Path:
    """A folder with a sweep of two flow rates that is done; its case is there, too."""
    folder = Path(tempfile.mkdtemp(prefix="attacks-sweep-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "case.yaml").write_text(CASE)
    (folder / "sweep.yaml").write_text(DONE)
    ran = run(("sweep", "run", "sweep.yaml"), folder, seconds=200)
    assert ran.status == 0, ran.output
    return folder


def points(sweep: Path) -> list[Path]:
    """Its two points: of 1 and of 2 m³/h."""
    return sorted(path for path in (sweep / "points").iterdir() if path.is_dir())


def folders() -> Iterator[Attack]:
    """The folder of a sweep that is done."""

    def on_sweep(*arguments: str, change: Change) -> Callable[[Path], Ran]:
        def act(folder: Path) -> Ran:
            shutil.copytree(made(), folder, dirs_exist_ok=True)
            change(folder / FOLDER)
            return run(arguments, folder)

        return act

    def whole(folder: Path, output: str) -> str:
        for flow, point in enumerate(points(folder / FOLDER), start=1):
            field = Field.load(point / "field.npz")
            if abs(3600 * field.bulk_flow * field.flow_scale / flow - 1) > 1e-9:
                return f"{point.name} has another flow"
        return "" if "2 done" in output else "not done"

    def swapped(sweep: Path) -> None:
        one, other = points(sweep)
        one.rename(sweep / "aside")
        other.rename(one)
        (sweep / "aside").rename(other)

    def edited(sweep: Path) -> None:
        path = points(sweep)[0] / "provenance.json"
        path.write_text(path.read_text().replace('"wall_seconds": ', '"wall_seconds": 9'))

    def state(text: str) -> Change:
        return lambda sweep: (sweep / "state" / f"{points(sweep)[0].name}.json").write_text(text)

    def record(text: str) -> Change:
        return lambda sweep: (sweep / "points.json").write_text(text)

    again = ("sweep", "run", "sweep.yaml")
    table, status = ("sweep", "table", FOLDER), ("sweep", "status", FOLDER)
    said: Check = lambda _, output: "" if "1 done" in output else "it says that all are done"  # noqa: E731
    for name, change, what in (
        ("results swapped", swapped, refused("results of another point")),
        ("a record edited", edited, refused(r"provenance\.json")),
        ("a record flipped", lambda sweep: flipped(points(sweep)[0] / "provenance.json"), refused("provenance")),
        ("points.json deep", record("[" * 100_000), refused(r"points\.json")),
        ("points.json a list", record("[]"), refused(r"points\.json")),
        ("points.json empty", record(""), refused(r"points\.json")),
    ):
        yield Attack("done sweeps", f"{name}: table", on_sweep(*table, change=change), what)
        # a copied sweep whose first place is still there may refuse results of another case
        done = right(whole) if change is not swapped else Right(("right", "refused"), check=whole)
        yield Attack("done sweeps", f"{name}: run", on_sweep(*again, change=change), done)
    for name, text in {"empty": "", "null": "null", "deep": "[" * 100_000, "of another case": '{"key": "x"}'}.items():
        yield Attack("done sweeps", f"a state {name}: status", on_sweep(*status, change=state(text)), right(said))
        yield Attack("done sweeps", f"a state {name}: run", on_sweep(*again, change=state(text)), right(whole))
    for name in ("field.npz", "case.yaml"):

        def damaged(sweep: Path, name: str = name) -> None:
            flipped(points(sweep)[0] / name)

        yield Attack("done sweeps", f"{name} flipped: run", on_sweep(*again, change=damaged), right(whole))

    def jobs(sweep: Path) -> None:
        (sweep / "slurm").mkdir()
        (sweep / "slurm" / "jobs.json").write_text("[" * 100_000)

    yield Attack("done sweeps", "jobs.json deep: status", on_sweep(*status, change=jobs), refused(r"jobs\.json"))
    for place in ("nowhere", "case.yaml", f"{FOLDER}/points", "results"):
        act = on_sweep("sweep", "status", place, change=lambda _: None)
        yield Attack("done sweeps", f"status of {place}", act, refused())


def studies() -> Iterator[Attack]:
    """Studies that make no sense."""
    for name, arguments in {
        "an unknown axis": ("--axis", "nonsense"),
        "shell on an axis": ("--axis", "cell=$(id)"),
        "nan on an axis": ("--axis", "cell=nan"),
        "cells of 0": ("--axis", "cell=0"),
        "nothing on an axis": ("--axis", "cell="),
        "0 h": ("--hours", "0"),
        "nan h": ("--hours", "nan"),
        "-1 h": ("--hours", "-1"),
        "no cores": ("--cores", "0"),
        "against nothing": ("--against", "no.yaml"),
        "no cluster.yaml": ("--on", "slurm"),
    }.items():
        act = granpipe("study", "case.yaml", *arguments, files={"case.yaml": CASE})
        yield Attack("studies", name, act, refused())
