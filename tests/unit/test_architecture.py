"""The house rules of the source tree, checked on its syntax: who imports whom, who prints, what the files may hold."""

import ast
import functools
import graphlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "granpipe"
SOURCES = sorted(PACKAGE.rglob("*.py"))

BASE = {"errors", "progress", "field", "rzmesh"}
"""Modules at the top that every room may import."""

ROOMS: dict[str, set[str]] = {
    "system": set(),
    "drawings": {"system"},
    "case": {"drawings", "system"},
    "geometry": {"case", "system"},
    "dem": {"case", "system"},
    "homogenize": {"system"},
    "fluid": set(),
    "export": {"system"},
    "analysis": set(),
    "planning": {"case", "system", "geometry", "dem", "fluid"},
    "pipeline": {"case", "drawings", "system", "geometry", "dem", "homogenize", "fluid", "export", "analysis",
                 "planning"},
    "api": {"case", "system", "geometry", "export", "pipeline", "console"},
    "sweep": {"case", "system", "pipeline"},
    "repose": {"case", "system", "dem", "fluid", "planning", "pipeline"},
    "study": {"case", "system", "geometry", "dem", "homogenize", "fluid", "export", "analysis", "planning", "pipeline",
              "sweep"},
}  # fmt: skip
"""Room → the other rooms that its modules may import."""

MOST_TOP_FILES = 8
MOST_LEVELS = 11

LATE = {
    "gmsh",
    "pyvista",
    "vtk",
    "vtkmodules",
    "matplotlib",
    "meshio",
    "pint",
    "pyamg",
    "skfem",
    "pymetis",
    "numba",
    "ezdxf",
    "shapely",
}
"""Libraries that are imported where they are used: a scene that does without does not load them."""

SLOW = LATE | {"numpy", "scipy", "pydantic", "jinja2", "yaml", "rich"}
"""Libraries that `granpipe --help` has no time for."""

TREE = ["granpipe", "cases", "tests", "docs", "benchmarks", ".ci"]


def name(source: Path) -> str:
    return str(source.relative_to(ROOT))


def imports(nodes: Iterator[ast.AST], source: Path) -> Iterator[str]:
    """Full names of what the import statements among `nodes` import, relative ones resolved."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = source.relative_to(ROOT).with_suffix("").parts[: -node.level] if node.level else ()
            module = ".".join([*parents, *([node.module] if node.module else [])])
            yield from (f"{module}.{alias.name}" for alias in node.names)


def running(tree: ast.AST, skip: tuple[type, ...] = ()) -> Iterator[ast.AST]:
    """The nodes below `tree` that are not for the type checker alone; `skip` leaves out what is inside such nodes."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, skip) and not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield node
            yield from running(node, skip)


def own_modules(nodes: Iterator[ast.AST], source: Path) -> set[str]:
    """Modules of granpipe that are imported among `nodes`, as `field` or `dem.run`."""
    found = set()
    for full in imports(nodes, source):
        inside = full.split(".")[1:] if full.startswith("granpipe.") else []
        parts = [".".join(inside[:length]) for length in range(len(inside), 0, -1)]
        found.update([next((part for part in parts if part in MODULES), parts[-1])] if parts else [])
    return found - {"__version__"}


def module(source: Path) -> str:
    return ".".join(source.relative_to(ROOT / "granpipe").with_suffix("").parts).removesuffix(".__init__")


MODULES = frozenset(module(source) for source in SOURCES)


@functools.cache
def parsed(source: Path) -> ast.Module:
    return ast.parse(source.read_text())


def foreign(source: Path) -> set[str]:
    """What a room's file imports of granpipe from rooms that it may not import."""
    room = module(source).split(".")[0]
    modules = own_modules(ast.walk(parsed(source)), source)
    return {one for one in modules if one.split(".")[0] not in {room, *BASE, *ROOMS[room]}}


def prints_or_exits(source: Path) -> set[str]:
    names = {ast.unparse(node) for node in ast.walk(parsed(source)) if isinstance(node, ast.Name | ast.Attribute)}
    return names & {
        "print",
        "input",
        "exit",
        "quit",
        "SystemExit",
        "sys.exit",
        "sys.stdout",
        "sys.stderr",
        "click.echo",
    }


def text_files() -> Iterator[Path]:
    inside = (file for folder in TREE for file in (ROOT / folder).rglob("*"))
    for file in [*ROOT.glob("*.*"), *ROOT.glob("*file"), *inside]:
        if file.is_file() and file.name != ".git" and "__pycache__" not in file.parts and file.stat().st_size < 1e6:
            yield file


@functools.cache
def import_graph() -> dict[str, set[str]]:
    """Module → the modules of granpipe that it imports, at any place but for the type checker alone."""
    return {module(source): own_modules(running(parsed(source)), source) for source in SOURCES}


def levels(graph: dict[str, set[str]]) -> dict[str, int]:
    """Node → 1 + the highest level of what it imports; CycleError where there is a circle."""
    found: dict[str, int] = {}
    for node in graphlib.TopologicalSorter(graph).static_order():
        found[node] = 1 + max((found[below] for below in graph.get(node, ())), default=0)
    return found


def test_the_rooms_are_those_that_stand_in_the_table() -> None:
    assert {path.parent.name for path in PACKAGE.glob("*/*.py")} == ROOMS.keys()


@pytest.mark.parametrize("source", [one for one in SOURCES if module(one).split(".")[0] in ROOMS], ids=name)
def test_a_room_imports_only_the_rooms_that_it_may(source: Path) -> None:
    assert not foreign(source)


def test_few_files_lie_at_the_top() -> None:
    assert len(list(PACKAGE.glob("*.py"))) <= MOST_TOP_FILES


def test_no_module_imports_itself_in_a_circle() -> None:
    levels(import_graph())


def test_rooms_stack_few_levels_high_without_a_circle() -> None:
    rooms: dict[str, set[str]] = {}
    for one, imported in import_graph().items():
        room = one.split(".")[0]
        rooms.setdefault(room, set()).update({other.split(".")[0] for other in imported} - {room})
    found = levels(rooms)
    assert max(found.values()) <= MOST_LEVELS
    assert found["errors"] < found["planning"] < found["pipeline"] < found["sweep"] < found["study"] < found["cli"]


@pytest.mark.parametrize("source", SOURCES, ids=name)
def test_special_libraries_are_imported_where_they_are_used(source: Path) -> None:
    at_import = running(parsed(source), skip=(ast.FunctionDef, ast.AsyncFunctionDef))
    parts = {part for full in imports(at_import, source) for part in full.split(".")}
    if source.stem.endswith("_numba"):  # compiled functions: a module like this is itself imported late
        parts -= {"numba", "compiled_numba"}
    assert not {part for part in parts if part in LATE or part.endswith("_numba")}


@pytest.mark.parametrize("source", [one for one in SOURCES if one != PACKAGE / "cli.py"], ids=name)
def test_only_the_command_line_prints_and_exits(source: Path) -> None:
    assert not prints_or_exits(source)


def test_nothing_holds_a_path_of_one_machine() -> None:
    # put together here, so that this file does not hold them itself
    places = "|".join(["work/", "tmp/w/", "root/", r"home/\w", "opt/", "usr/local/"])
    pattern = re.compile(rf"(?<![\w.~*}}/)])/({places})")
    found = {}
    for file in text_files():
        hits = [line.strip() for line in file.read_text(errors="ignore").splitlines() if pattern.search(line)]
        if hits:
            found[name(file)] = hits
    assert not found


def test_the_lock_file_names_no_registry() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    assert not re.search(r"://|^\s*--(index|extra|find|trusted)", lock, re.MULTILINE)
    assert "--hash=sha256:" in lock


def test_the_lock_file_pins_all_that_the_project_names() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = [name for names in project["project"]["optional-dependencies"].values() for name in names]
    wanted = [*project["build-system"]["requires"], *project["project"]["dependencies"], *extras]
    locked = set(re.findall(r"^([a-z0-9-]+)==", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    assert {re.split(r"[<>=~!\[; ]", name)[0].lower() for name in wanted} <= locked


def test_help_loads_none_of_the_slow_libraries() -> None:
    script = (
        "import sys; from granpipe.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('loaded:', *{module.split('.')[0] for module in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "Usage" in done.stdout
    assert not set(done.stdout.splitlines()[-1].split()) & SLOW


@pytest.mark.parametrize(
    "code",
    [
        "from granpipe.fluid import stokes",
        "from granpipe.fluid.stokes import solve",
        "def f():\n    import granpipe.geometry.walls",
        "from ..export.vtk import write",
        "from granpipe.planning import plan",
    ],
)
def test_an_import_across_rooms_is_seen(code: str, dem_source: Path) -> None:
    dem_source.write_text(code)
    assert foreign(dem_source)


@pytest.mark.parametrize("code", ["def f():\n    print(1)", "import sys\nsys.exit(1)", "raise SystemExit"])
def test_printing_and_exiting_are_seen(code: str, dem_source: Path) -> None:
    dem_source.write_text(code)
    assert prints_or_exits(dem_source)


@pytest.fixture
def dem_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file in the dem room of another tree, to be written."""
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    (tmp_path / "granpipe/dem").mkdir(parents=True)
    return tmp_path / "granpipe/dem/broken.py"


def raised_here(function: ast.FunctionDef) -> set[str]:
    """The package's errors that a function raises itself, outside any `try` and any function within it."""
    found: set[str] = set()
    pending: list[ast.AST] = list(function.body)
    while pending:
        node = pending.pop()
        if isinstance(node, (ast.Try, ast.FunctionDef, ast.Lambda, ast.ClassDef)):
            continue
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            found.add(node.exc.func.id)
        pending += ast.iter_child_nodes(node)
    return found & {"CaseError", "DataError", "RunError", "MeshError", "SolveError"}


def public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Functions and methods whose own name and class are public."""
    for node in tree.body:
        members = node.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_") else [node]
        yield from (f for f in members if isinstance(f, ast.FunctionDef) and not f.name.startswith("_"))


@pytest.mark.parametrize("source", SOURCES, ids=name)
def test_a_public_function_that_raises_an_error_of_the_package_says_so(source: Path) -> None:
    silent = [
        (function.name, error)
        for function in public_functions(parsed(source))
        for error in raised_here(function)
        if error not in (ast.get_docstring(function) or "")
    ]
    assert not silent
