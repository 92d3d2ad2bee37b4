"""Every way of installing granpipe brings along what it needs: editable, wheel, sdist, and wheel out of the sdist."""

import ast
import email
import email.message
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEMPLATES = {
    str(file.relative_to(ROOT / "granpipe")) for file in ROOT.glob("granpipe/templates/**/*") if file.is_file()
}

LIST = """
import importlib.resources, site, sys
site.addsitedir(sys.argv[1])
import granpipe
def walk(folder, prefix):
    for entry in folder.iterdir():
        name = f"{prefix}/{entry.name}"
        if entry.is_dir():
            walk(entry, name)
        else:
            print(name, len(entry.read_bytes()))
print(granpipe.__file__)
walk(importlib.resources.files("granpipe") / "templates", "templates")
"""


def build(kind: str, tree: Path, out: Path) -> Path:
    """Build as pip does, with the setuptools of this environment, so that nothing is fetched."""
    out.mkdir(exist_ok=True)
    script = f"from setuptools import build_meta; print('made', build_meta.build_{kind}({str(out)!r}))"
    done = subprocess.run([sys.executable, "-c", script], cwd=tree, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.rsplit("made ", 1)[1].strip()


def installed(wheel: Path, site: Path) -> tuple[str, set[str]]:
    """Where granpipe is imported from with this wheel unpacked in `site`, and the templates that it finds there."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    command = [sys.executable, "-I", "-S", "-c", LIST, str(site)]
    lines = subprocess.run(command, cwd=site, capture_output=True, text=True, check=True).stdout.splitlines()
    sizes = dict(line.rsplit(" ", 1) for line in lines[1:])
    assert all(int(size) == (ROOT / "granpipe" / name).stat().st_size for name, size in sizes.items())
    return lines[0], set(sizes)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout of its own: a build leaves traces."""
    copy = tmp_path_factory.mktemp("checkout")
    files = (
        "pyproject.toml",
        "MANIFEST.in",
        "README.md",
        "LICENSE",
        "CHANGELOG.md",
        "CITATION.cff",
        "requirements.lock",
    )
    for name in files:
        shutil.copy(ROOT / name, copy)
    for name in ("granpipe", "cases", "docs"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
    (copy / "templates").symlink_to((ROOT / "templates").readlink())
    return copy


def test_the_top_level_name_leads_to_the_templates() -> None:
    assert (ROOT / "templates").resolve() == ROOT / "granpipe/templates"
    assert not (ROOT / "templates").readlink().is_absolute()
    assert TEMPLATES


@pytest.mark.parametrize("kind", ["wheel", "editable"])
def test_templates_are_found_when_installed_as(kind: str, tree: Path, tmp_path: Path) -> None:
    place, found = installed(build(kind, tree, tmp_path / "dist"), tmp_path / "site")
    assert Path(place).is_relative_to(tmp_path / "site" if kind == "wheel" else tree)
    assert found == TEMPLATES


def test_templates_are_found_when_installed_from_an_sdist(tree: Path, tmp_path: Path) -> None:
    sdist = build("sdist", tree, tmp_path / "dist")
    shutil.unpack_archive(sdist, tmp_path / "unpacked")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    place, found = installed(build("wheel", unpacked, tmp_path / "dist2"), tmp_path / "site")
    assert Path(place).is_relative_to(tmp_path / "site")
    assert found == TEMPLATES


def test_a_wheel_holds_the_package_and_nothing_else(tree: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(build("wheel", tree, tmp_path)) as archive:
        top = {name.split("/")[0] for name in archive.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == {"granpipe"}


def fresh(wheel: Path, folder: Path) -> Path:
    """An environment with this wheel, put there by pip; what granpipe depends on is looked up beside this test's own.

    The site folder of this environment is a line of a .pth file: its own .pth files, an editable granpipe among them,
    are not read from there.
    """
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True, timeout=120)
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel]
    subprocess.run(pip, check=True, timeout=120)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin"


def test_a_fluid_case_runs_where_nothing_but_the_wheel_of_the_sdist_is(tree: Path, tmp_path: Path) -> None:
    shutil.unpack_archive(build("sdist", tree, tmp_path / "sdist"), tmp_path / "unpacked")
    (source,) = (tmp_path / "unpacked").iterdir()
    programs = fresh(build("wheel", source, tmp_path / "dist"), tmp_path / "environment")
    folder = tmp_path / "empty"
    folder.mkdir()
    env = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    env["PATH"] = f"{programs}:{env['PATH']}"

    def typed(*words: str) -> str:
        done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    where = typed("python", "-c", "import granpipe; print(granpipe.__file__)")
    assert Path(where.strip()).is_relative_to(tmp_path / "environment")
    findings = subprocess.run(["granpipe", "doctor"], cwd=folder, env=env, capture_output=True, text=True, timeout=300)
    missing = re.findall(r"^(\S+).*  missing;", findings.stdout, re.MULTILINE)
    assert set(missing) <= {"LIGGGHTS", "mpirun", "EGL"}, findings.stdout  # not from a wheel
    typed("granpipe", "init", "silo.yaml")
    quick = ["name=quick", "outline.sections.hopper={z: [0.4, 0.1], regime: mass_flow}", "model=fluid", "figures=[rz]"]
    quick.append("material.bulk_density=580 kg/m^3")
    typed("granpipe", "run", "silo.yaml", *(word for key in quick for word in ("--set", key)))
    results = folder / "results" / "quick"
    assert {"report.html", "field.npz", "comsol"} <= {path.name for path in results.iterdir()}
    assert (results / "comsol" / "import_comsol.java").stat().st_size > 3000


def metadata_of(wheel: Path) -> email.message.Message:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return email.message_from_bytes(archive.read(name))


def test_the_metadata_say_what_an_index_and_pip_ask_for(tree: Path, tmp_path: Path) -> None:
    wheel = build("wheel", tree, tmp_path)
    metadata = metadata_of(wheel)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert metadata["Name"] == "granpipe"
    assert metadata["License-Expression"] == "MIT"
    assert metadata["License-File"] == "LICENSE"
    assert metadata["Requires-Python"] == ">=3.11"
    assert metadata["Summary"] == project["description"]
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert metadata.get_payload(decode=True) == (ROOT / "README.md").read_bytes()
    assert set(metadata.get_all("Classifier") or []) == set(project["classifiers"])
    required = [line for line in metadata.get_all("Requires-Dist") or [] if "extra ==" not in line]
    assert {re.split(r"[><=;\[ ]", line)[0] for line in required} == {
        re.split(r"[><=]", line)[0] for line in project["dependencies"]
    }
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (points,) = (archive.read(name).decode() for name in names if name.endswith("entry_points.txt"))
    assert points.split() == ["[console_scripts]", "granpipe", "=", "granpipe.__main__:start"]
    assert {"granpipe/py.typed", "granpipe/fluid/wall_factor.json", "granpipe/fluid/bulk_friction.json"} <= set(names)


def test_every_file_of_the_package_is_in_the_wheel(tree: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(build("wheel", tree, tmp_path)) as archive:
        packed = {name for name in archive.namelist() if name.startswith("granpipe/")}
    here = {str(path.relative_to(tree)) for path in (tree / "granpipe").rglob("*") if path.is_file()}
    assert packed == {name for name in here if "__pycache__" not in name}


def test_the_sdist_holds_cases_and_documents_and_no_results(tree: Path, tmp_path: Path) -> None:
    with tarfile.open(build("sdist", tree, tmp_path)) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"cases/reactor.yaml", "cases/gallery/draw.py", "docs/tutorial.md", "docs/images/report_phone.png"} <= names
    assert {"LICENSE", "CITATION.cff", "CHANGELOG.md", "requirements.lock", "granpipe/templates/case.yaml"} <= names
    assert not [name for name in names if "__pycache__" in name or "/results/" in name or name.endswith(".plan.png")]


IMPORT_NAMES = {"pyyaml": "yaml", "scikit-fem": "skfem"}
PARTS = {"contourpy": "matplotlib", "pydantic_core": "pydantic", "vtkmodules": "pyvista"}
"""What always comes with a package, under a name of its own."""


def test_every_package_that_is_imported_is_a_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["netcdf"]]
    declared = {IMPORT_NAMES.get(name, name) for name in (re.split(r"[><=\[]", line)[0] for line in lines)}
    imported = set()
    for path in (ROOT / "granpipe").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.split(".")[0])
    assert {PARTS.get(name, name) for name in imported - set(sys.stdlib_module_names) - {"granpipe"}} <= declared
