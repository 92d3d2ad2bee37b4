"""The library of materials: what it gives, what the case keeps, what must be given."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from click.testing import CliRunner

from granpipe.case.library import NEEDED, MaterialName, library, sources
from granpipe.case.reader import read_case, resolve, varied
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.cli import main
from granpipe.errors import CaseError

GLASS = """\
name: beads
outline: {wall: [[0.1, 0.5], [0.1, 0]]}
material: {name: glass beads, size: {diameter: 5 mm}}
contact: {rolling_friction: 0.02}
flow_rate: 1 kg/h
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def test_a_named_material_fills_in_what_the_case_leaves_out_and_tells_each_source(tmp_path: Path) -> None:
    file = read_case(written(tmp_path, GLASS))
    assert (file.case.material.density, file.case.contact.friction, file.case.contact.restitution) == (2500, 0.16, 0.97)
    assert file.case.contact.rolling_friction == 0.02
    assert file.case.contact.wall.friction == 0.16  # as between particles
    assert file.case.contact.youngs_modulus == "auto"  # the true stiffness is not for a simulation
    assert "contact.friction: 0.16, of glass beads in the library (Sunday 2020)" in file.library


@pytest.mark.parametrize(
    ("line", "key", "value"),
    [
        ("{name: glass beads, density: 2460 kg/m^3, size: {diameter: 5 mm}}", ("material", "density"), 2460),
        ("{name: glass beads, density: 2460, size: {radius: 1 mm}}", ("material", "density"), 2460),
    ],
)
def test_the_case_overrides_the_library_key_by_key(
    line: str, key: tuple[str, str], value: float, tmp_path: Path
) -> None:
    file = read_case(written(tmp_path, re.sub("material: .*", f"material: {line}", GLASS)))
    assert getattr(getattr(file.case, key[0]), key[1]) == value
    assert not [note for note in file.library if note.startswith(".".join(key))]
    assert file.case.contact.friction == 0.16


def test_an_override_of_the_command_line_wins_over_the_library(tmp_path: Path) -> None:
    file = read_case(written(tmp_path, GLASS), {"contact.friction": "0.3"})
    assert file.case.contact.friction == 0.3
    assert read_case(file.path or tmp_path, {"material.name": "steel balls"}).case.material.density == 7850


def test_what_has_no_source_must_be_given_and_is_told_with_what_is_typical(tmp_path: Path) -> None:
    path = written(tmp_path, GLASS.replace("glass beads", "coke"))
    with pytest.raises(CaseError, match=r"case.yaml:3 material.name: coke: .*material.density \(typical 900 to 1100"):
        read_case(path)
    given = {"material.density": "1000", "contact.friction": "0.6", "contact.restitution": "0.4"}
    assert read_case(path, given).case.material.name == "coke"
    assert read_case(path, given).library == ()


def test_rolling_friction_need_not_be_given_without_rolling(tmp_path: Path) -> None:
    path = written(tmp_path, GLASS.replace("{rolling_friction: 0.02}", "{rolling_model: none}"))
    assert read_case(path).case.contact.rolling_friction == 0


def test_a_misspelt_material_is_refused_with_the_one_that_is_meant(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="did you mean"):
        read_case(written(tmp_path, GLASS.replace("glass beads", "glass bead")))


@pytest.mark.parametrize("broken", [["a"], 3, "text", None])
def test_a_group_that_is_no_mapping_is_left_to_the_schema(broken: Any) -> None:
    data = {
        "name": "x",
        "outline": {"wall": [[0.1, 0.5], [0.1, 0]]},
        "material": {"name": "glass beads", "size": {"radius": 0.01}},
        "contact": broken,
        "flow_rate": "1 kg/h",
    }
    with pytest.raises(CaseError, match=r"contact|rolling_friction"):
        resolve(data, Places("x"))


def test_a_resolved_case_with_a_name_loads_again_as_the_same_case(tmp_path: Path) -> None:
    case = read_case(written(tmp_path, GLASS)).case
    again = read_case(written(tmp_path, case.to_yaml()))
    assert again.case == case
    assert again.library == ()
    assert varied(case, {"dem.seed": "3"}).material == case.material


@pytest.mark.parametrize("name", get_args(MaterialName))
def test_every_material_names_keys_and_sources_that_exist_and_values_that_the_schema_takes(name: str) -> None:
    one = library()[name]
    groups = {"material": Case.model_fields["material"].annotation, "contact": Case.model_fields["contact"].annotation}
    for dotted in [*one.values, *(key for key in one.typical if "." in key)]:
        group, key = dotted.split(".")
        assert key in groups[group].model_fields  # type: ignore[union-attr]
    assert {source for _, source in [*one.values.values(), *one.shown.values()]} <= sources().keys()
    assert set(NEEDED) <= {*one.values, *one.typical}  # either there, or a hint of what to give
    assert not one.values.keys() & one.typical.keys()
    data: dict[str, Any] = {
        "name": "x",
        "outline": {"wall": [[0.1, 0.5], [0.1, 0]]},
        "material": {"name": name, "density": 1000, "size": {"radius": 0.01}},
        "contact": {"friction": 0.5, "rolling_friction": 0.1, "restitution": 0.5},
        "flow_rate": "1 kg/h",
    }
    for dotted in one.values:
        group, key = dotted.split(".")
        data[group].pop(key, None)
    assert len(resolve(data, Places("x")).library) == len(one.values)


def test_the_library_and_the_schema_know_the_same_names() -> None:
    assert tuple(library()) == get_args(MaterialName)


def test_the_command_lists_all_materials_with_sources() -> None:
    text = CliRunner().invoke(main, ["materials"]).output
    assert all(f"{name}:" in text for name in get_args(MaterialName))
    assert "contact.friction: 0.16  (Sunday 2020)" in text
    assert all(whole in text for whole in sources().values())
