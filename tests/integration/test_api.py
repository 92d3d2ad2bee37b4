"""The Python API does what the command line does, and is there at once."""

import doctest
import json
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import numpy as np
import pytest
from click.testing import CliRunner
from fakes.plane_flow import PlaneFlow

import granpipe
from granpipe.cli import main
from granpipe.system.manifest import write_manifest

ROOT = Path(__file__).parents[2]
SLOW = {"numpy", "scipy", "pydantic", "matplotlib", "gmsh", "pyvista", "click", "yaml", "rich"}


@pytest.fixture(scope="module")
def hopper(tmp_path_factory: pytest.TempPathFactory) -> granpipe.Result:
    case = granpipe.load_case(ROOT / "cases/hopper.yaml", {"figures": [], "export": []})
    return granpipe.run(case, results=tmp_path_factory.mktemp("results"), progress=None)


def test_import_loads_nothing_slow_and_names_are_there_when_asked_for() -> None:
    script = "import sys, granpipe; print(*sys.modules); granpipe.load_case; print(*dir(granpipe))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    modules, names = done.stdout.splitlines()
    assert not SLOW & set(modules.split())
    assert set(granpipe.__all__) <= set(names.split())
    for name in granpipe.__all__:
        assert getattr(granpipe, name)
    with pytest.raises(AttributeError, match="nothing"):
        granpipe.nothing  # noqa: B018


def test_overrides_are_values_of_python_or_text_of_a_case_file() -> None:
    changes = {"dem.seed": np.int64(2), "dem.max_time": "8 s", "contact.friction": 1e-5, "export": ["vtk"]}
    case = granpipe.load_case(ROOT / "cases/smoke.yaml", changes)
    assert (case.dem.seed, case.dem.max_time, case.contact.friction, case.export) == (2, 8.0, 1e-5, ("vtk",))


def test_a_wrong_case_is_refused_with_its_place_when_read_and_when_run(tmp_path: Path) -> None:
    with pytest.raises(granpipe.CaseError, match=r"contact\.friction"):
        granpipe.load_case(ROOT / "cases/smoke.yaml", {"contact.friction": -1})
    case = granpipe.load_case(ROOT / "cases/smoke.yaml", {"dem.ranks": 4000})
    with pytest.raises(granpipe.CaseError, match=r"--set dem\.ranks: 4000 ranks"):
        granpipe.run(case, results=tmp_path, progress=None)


def test_a_run_leaves_what_the_command_leaves_and_is_not_repeated(hopper: granpipe.Result, tmp_path: Path) -> None:
    text = ["run", str(ROOT / "cases/hopper.yaml"), "--set", "figures=[]", "--set", "export=[]"]
    again = CliRunner().invoke(main, [*text, "--results", str(hopper.folder.parent)])
    assert "up to date" in again.output
    anew = CliRunner().invoke(main, [*text, "--results", str(tmp_path)])
    assert anew.exit_code == 0, anew.output
    r, z = np.meshgrid(np.linspace(0, 1, 30), np.linspace(3.4, 5.9, 50))
    other = granpipe.load_result(tmp_path / "hopper")
    np.testing.assert_array_equal(other.field.velocity(r, z), hopper.field.velocity(r, z))


def test_the_velocity_adds_up_to_the_flow_rate_of_the_process(hopper: granpipe.Result) -> None:
    share, weight = np.polynomial.legendre.leggauss(100)
    for level, wall in ((5.5, 1.0), (4.4, 0.75), (3.6, 0.5)):
        r = 0.5 * wall * (1 + share)
        through = -np.sum(2 * np.pi * r * hopper.field.velocity(r, level)[1] * 0.5 * wall * weight)
        assert through * 3600 == pytest.approx(1.0, rel=1e-3)


def test_a_result_tells_what_it_is(hopper: granpipe.Result) -> None:
    assert repr(hopper) == "<Result hopper: fluid, no quality gate failed>"
    assert hopper.model == "fluid"
    assert not hopper.marked
    assert hopper.case is not None
    assert hopper.case.name == "hopper"
    assert hopper.figures["triangles"] > 0
    assert hopper._repr_png_().startswith(b"\x89PNG")


def test_a_failed_gate_marks_the_result(hopper: granpipe.Result, tmp_path: Path) -> None:
    folder = shutil.copytree(hopper.folder, tmp_path / "hopper")
    record = json.loads((folder / "provenance.json").read_text())
    record["quality"] = [{"name": "packing in the plug", "value": 0.4, "limit": "0.5 to 0.68", "passed": False}]
    (folder / "provenance.json").write_text(json.dumps(record))
    write_manifest(folder)
    marked = granpipe.load_result(folder)
    assert marked.marked
    assert repr(marked) == "<Result hopper: fluid, MARKED: packing in the plug: 0.4, must be 0.5 to 0.68>"


@pytest.mark.parametrize("name", ["field.npz", "case.yaml", "plan.json", "provenance.json"])
def test_a_damaged_folder_is_refused(name: str, hopper: granpipe.Result, tmp_path: Path) -> None:
    folder = shutil.copytree(hopper.folder, tmp_path / "hopper")
    (folder / name).write_text("[1")
    with pytest.raises(granpipe.GranpipeError, match=name.replace(".", r"\.")):
        granpipe.load_result(folder)


@pytest.mark.parametrize("name", ["field.npz", "case.yaml", "provenance.json"])
def test_a_file_that_is_not_as_it_was_written_is_refused_though_it_reads_well(
    name: str, hopper: granpipe.Result, tmp_path: Path
) -> None:
    folder = shutil.copytree(hopper.folder, tmp_path / "hopper")
    if name == "field.npz":  # a whole field of twice the flow
        with np.load(folder / name) as stored:
            np.savez(folder / name, **{key: stored[key] for key in stored if key != "flow_scale"}, flow_scale=2.0)
    else:
        (folder / name).write_text((folder / name).read_text() + "\n")
    with pytest.raises(granpipe.DataError, match="changed since granpipe wrote it"):
        granpipe.load_result(folder)


def test_a_run_without_its_manifest_is_refused(hopper: granpipe.Result, tmp_path: Path) -> None:
    folder = shutil.copytree(hopper.folder, tmp_path / "hopper")
    (folder / "manifest.json").unlink()
    with pytest.raises(granpipe.DataError, match=r"manifest\.json"):
        granpipe.load_result(folder)


def test_a_field_alone_is_a_result_too(hopper: granpipe.Result, tmp_path: Path) -> None:
    shutil.copy(hopper.folder / "field.npz", tmp_path)
    alone = granpipe.load_result(tmp_path)
    assert (alone.case, alone.model, alone.gates) == (None, None, ())
    np.testing.assert_array_equal(alone.field.velocity(0.1, 4.4), hopper.field.velocity(0.1, 4.4))
    with pytest.raises(granpipe.DataError, match="completed run"):
        granpipe.load_result(tmp_path / "nowhere")


def test_the_examples_in_the_docstrings_are_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = doctest.testmod(granpipe, extraglobs={"tmp": tmp_path})
    assert found.attempted > 4
    assert not found.failed


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the command line sets it
    book = nbformat.read(ROOT / "docs/notebooks/first_field.ipynb", as_version=4)
    shutil.copytree(ROOT / "cases", tmp_path / "cases")
    NotebookClient(book, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2


@pytest.mark.parametrize(("plane", "coordinates"), [("xz", 2), ("xyz", 3)])
def test_averaged_dumps_are_a_result_too(plane: str, coordinates: int, tmp_path: Path) -> None:
    flow = PlaneFlow()
    (tmp_path / "dumps").mkdir()
    dumps = flow.dumps(tmp_path / "dumps", 0.05, 4)
    ends = ["--x", "0", "0.4", "--z", "0", "1"]
    command = ["homogenize", *map(str, dumps), "--plane", plane, "--cell", "0.05", "--time-step", "5e-5"]
    CliRunner().invoke(main, [*command, *ends, "--out", str(tmp_path / "out")])
    result = granpipe.load_result(tmp_path / "out")
    assert (result.case, result.model) == (None, None)
    w = result.field.velocity(0.1, *[0.15] * (coordinates - 2), 0.9)[-1]
    true = flow.velocity(np.array([[0.1, 0.15, 0.9]]))[0, 2] * flow.packing / result.field.stored.bulk_packing
    assert w == pytest.approx(true, rel=0.1)
    assert set(result.field.to_xarray().dims) == set(plane)
