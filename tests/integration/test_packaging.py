"""Every way of installing granpipe brings its templates along: editable, wheel, sdist, and wheel out of the sdist."""

import shutil
import subprocess
import sys
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
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    shutil.copytree(ROOT / "granpipe", copy / "granpipe", ignore=shutil.ignore_patterns("__pycache__"))
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
