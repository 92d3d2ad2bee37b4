"""The Java class that sets COMSOL up: compiled and run against a stand-in for COMSOL's API that records the calls."""

import re
import runpy
import shutil
import subprocess
from datetime import datetime
from pathlib import Path

import pytest
from fakes.comsol_api import Api
from fakes.comsol_text import read_sections
from fakes.synthetic import field_of, ring_vessel

from granpipe.export.comsol import write_comsol
from granpipe.export.exported import Exported

pytestmark = pytest.mark.skipif(shutil.which("javac") is None, reason="no Java compiler (javac) here")

MODEL = """
package com.comsol.model;
public class Model {
  private final String path;
  public Model(String path) { this.path = path; }
  private Model at(String name) { return new Model(path + name); }
  private Model record(String call, Object... values) {
    System.out.print(path + " " + call);
    for (Object value : values) System.out.print("|" + value);
    System.out.println();
    return this;
  }
  public Model component() { return at(".component"); }
  public Model component(String tag) { return at(".component." + tag); }
  public Model geom() { return at(".geom"); }
  public Model geom(String tag) { return at(".geom." + tag); }
  public Model param() { return at(".param"); }
  public Model func() { return at(".func"); }
  public Model func(String tag) { return at(".func." + tag); }
  public Model variable() { return at(".variable"); }
  public Model variable(String tag) { return at(".variable." + tag); }
  public Model create(String tag) { return record("create", tag); }
  public Model create(String tag, Object kind) { return record("create", tag, kind); }
  public Model axisymmetric(boolean yes) { return record("axisymmetric", yes); }
  public Model label(String text) { return record("label", text); }
  public Model descr(String name, String text) { return record("descr", name, text); }
  public Model set(String name, Object value) { return record("set", name, value); }
  public Model set(String name, String value, String text) { return record("set", name, value, text); }
  public Model setIndex(String name, Object value, int i) { return record("setIndex", name, value, i); }
  public Model setIndex(String name, Object value, int i, int j) { return record("setIndex", name, value, i, j); }
  public Model importData() { return record("importData"); }
}
"""
UTIL = """
package com.comsol.model.util;
import com.comsol.model.Model;
public class ModelUtil { public static Model create(String tag) { return new Model(tag); } }
"""


def recorded(folder: Path, build: Path) -> list[str]:
    """Calls that the class in `folder` makes when COMSOL runs it."""
    for name, source in {"Model": MODEL, "util/ModelUtil": UTIL}.items():
        path = build / "com/comsol/model" / f"{name}.java"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    sources = [folder / "import_comsol.java", *build.rglob("*.java")]
    subprocess.run(["javac", "-Xlint:all", "-Werror", "-d", build, *sources], check=True, timeout=120)
    run = ["java", "-cp", build, "import_comsol"]
    return subprocess.run(run, check=True, timeout=60, capture_output=True, text=True).stdout.splitlines()


@pytest.mark.parametrize("with_psi", [True, False], ids=["psi", "no psi"])
def test_java_class_compiles_and_sets_up_what_the_files_hold(with_psi: bool, tmp_path: Path) -> None:
    folder = tmp_path / "comsol"
    folder.mkdir()
    field = field_of(ring_vessel(), 0.1, with_psi=with_psi)
    write_comsol(Exported(field, "ring-1", 1000.0, datetime(2026, 9, 2)), folder)
    calls = recorded(folder, tmp_path / "build")
    assert "Model.component.comp1.geom.geom1 axisymmetric|true" in calls

    heads = [head[6:-1] for head in read_sections(folder / "flow_sectionwise.txt") if head.startswith("Data")]
    flow = [call.removeprefix("Model.func.flow ") for call in calls if call.startswith("Model.func.flow ")]
    for number, head in enumerate(heads):
        name, unit = re.fullmatch(r"(\w+) \((.+)\)", head).groups()
        assert f"setIndex|funcs|{name}|{number}|0" in flow
        assert f"setIndex|funcs|{number + 1}|{number}|1" in flow
        assert f"setIndex|fununit|{unit}|{number}" in flow
    assert f"setIndex|funcs|{len(heads) + 1}|{len(heads)}|1" not in flow
    assert {"set|struct|sectionwise", "set|extrap|value", "set|extrapvalue|0"} <= set(flow)

    streams = [call for call in calls if call.startswith("Model.func.stream")]
    assert bool(streams) == with_psi
    for tag in ["flow", "stream"] if with_psi else ["flow"]:
        own = [call for call in calls if call.startswith(f"Model.func.{tag} ")]
        units = [k for k, call in enumerate(own) if "unit|" in call]
        assert own.index(f"Model.func.{tag} importData") < min(units)  # importing resets units
        file = next(call.split("|")[2] for call in own if "set|filename|" in call)
        assert (folder / file).is_file()
    names = {call.split("|")[1] for call in calls if "variable.solids_flow set|" in call}
    assert {"u_solids", "w_solids", "in_solids"} <= names
    assert ("u_linear" in names) == with_psi


@pytest.mark.parametrize("with_psi", [True, False], ids=["psi", "no psi"])
def test_the_python_script_makes_the_calls_of_the_java_class(with_psi: bool, tmp_path: Path) -> None:
    folder = tmp_path / "comsol"
    folder.mkdir()
    write_comsol(
        Exported(field_of(ring_vessel(), 0.1, with_psi=with_psi), "ring", 1000.0, datetime(2026, 9, 2)), folder
    )
    java = [call for call in recorded(folder, tmp_path / "build") if ".geom" not in call and "create|comp1" not in call]
    model = Api()
    runpy.run_path(str(folder / "import_comsol.py"))["add_flow"](model)
    python = [call.replace(f"{folder}/", "./") for call in model.calls]
    assert len(java) > 30
    assert python == java
