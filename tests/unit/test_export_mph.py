"""The Python script that sets COMSOL up: run with MPh's own client and model over a stand-in for COMSOL's Java API."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from unittest import mock

import pytest
from fakes.comsol_api import Api, ModelUtil
from fakes.comsol_text import read_sections
from fakes.synthetic import field_of, ring_vessel

from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported

mph = pytest.importorskip("mph")

Run = Callable[..., list[str]]


@pytest.fixture(params=[True, False], ids=["psi", "no psi"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    out = tmp_path / "comsol"
    out.mkdir()
    field = field_of(ring_vessel(), 0.1, with_psi=request.param)
    write_comsol(Exported(field, "ring-1", 1000.0, datetime(2026, 9, 2)), out)
    return out


@pytest.fixture
def run(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Start the script with arguments, as `python import_comsol.py …`; the calls of the Java API that it makes.

    Only the start of a COMSOL server is replaced, with MPh's signature: client and model are MPh's own.
    """

    def started(*arguments: str, components: tuple[str, ...] = ("comp1",)) -> list[str]:
        java = Api(components=components)
        client = object.__new__(mph.Client)
        client.java = ModelUtil(java)
        monkeypatch.setattr(mph, "start", mock.create_autospec(mph.start, return_value=client))
        monkeypatch.setattr(sys, "argv", ["import_comsol.py", *arguments])
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(folder / "import_comsol.py"), run_name="__main__")
        return java.calls

    return started


def test_a_new_model_is_axisymmetric_has_the_flow_and_is_saved_once(run: Run, folder: Path, tmp_path: Path) -> None:
    calls = run("flow.mph")
    assert calls[0] == "Model label|flow"
    assert calls[1:4] == [
        "Model.component create|comp1|true",
        "Model.component.comp1.geom create|geom1|2",
        "Model.component.comp1.geom.geom1 axisymmetric|true",
    ]
    assert [call for call in calls if " save|" in call] == [f"Model save|{tmp_path / 'flow.mph'}"]
    assert calls[-1].startswith("Model save|")
    files = [call.split("|")[2] for call in calls if "set|filename|" in call]
    assert all(Path(file).is_absolute() and Path(file).parent == folder and Path(file).is_file() for file in files)
    assert len(files) == 1 + (folder / "psi_grid.txt").exists()


def test_the_functions_are_the_columns_of_the_file(run: Run, folder: Path) -> None:
    calls = run("flow.mph")
    heads = [head[6:-1] for head in read_sections(folder / "flow_sectionwise.txt") if head.startswith("Data")]
    flow = [call.removeprefix("Model.func.flow ") for call in calls if call.startswith("Model.func.flow ")]
    names = [call.split("|")[2] for call in flow if call.startswith("setIndex|funcs") and call.endswith("|0")]
    units = [call.split("|")[2] for call in flow if call.startswith("setIndex|fununit")]
    assert [f"{name} ({unit})" for name, unit in zip(names, units, strict=True)] == heads
    assert min(k for k, call in enumerate(flow) if "unit|" in call) > flow.index("importData")  # it resets units


def test_a_model_of_the_user_gets_the_flow_in_the_component_that_is_named(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.mph").touch()
    calls = run("new.mph", "mine.mph", "comp2", components=("comp1", "comp2"))
    assert calls[0] == f"model1 load|{tmp_path / 'mine.mph'}"
    assert "Model.component.comp2.variable create|solids_flow" in calls
    assert not [call for call in calls if "comp1" in call or "geom" in call]
    assert calls[-1] == f"Model save|{tmp_path / 'new.mph'}"


@pytest.mark.parametrize("name", ["there.mph", "there", "there.txt"])
def test_no_file_is_overwritten_whatever_suffix_is_given(name: str, run: Run, tmp_path: Path) -> None:
    (tmp_path / "there.mph").write_text("mine")
    with pytest.raises(SystemExit, match=r"there\.mph exists; choose another name"):
        run(name)
    assert (tmp_path / "there.mph").read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere/flow.mph"], "there is no folder"),
        (["flow.mph", "absent.mph"], r"there is no file absent\.mph"),
        ([], r"python import_comsol\.py flow\.mph"),
        (["a", "b", "c", "d"], r"python import_comsol\.py flow\.mph"),
    ],
)
def test_a_mistake_is_told_before_comsol_starts(arguments: list[str], complaint: str, run: Run) -> None:
    with pytest.raises(SystemExit, match=complaint):
        run(*arguments)
    mph.start.assert_not_called()


def test_a_component_that_is_not_there_is_named_with_those_that_are(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.mph").touch()
    with pytest.raises(SystemExit, match=r"mine\.mph has no component comp1; its components: solid, gas"):
        run("new.mph", "mine.mph", components=("solid", "gas"))
