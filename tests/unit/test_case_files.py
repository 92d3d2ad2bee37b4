"""The cases, the starter, the schema and the reference that come with granpipe agree with the reader."""

import json
from pathlib import Path

import pytest

from granpipe.case.reader import load_case, schema_json, starter_case
from granpipe.case.reference import reference

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "cases").glob("*.yaml"))


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_case_loads_under_the_name_of_its_file(path):
    assert load_case(path).name == path.stem


def test_reactor_is_the_test_reactor():
    case = load_case(ROOT / "cases" / "reactor.yaml")
    assert case.outline.wall == ((1.0, 5.9), (1.0, 4.9), (0.5, 3.9), (0.5, 3.4), (1.156, 3.4), (1.156, 0.0))
    assert list(case.outline.sections) == ["a", "b", "c", "d", "e", "f"]
    assert case.material.size.radii.normal.mean == 0.03
    assert case.dem.coarse_grain_factor == 2


def test_paper_case_has_the_published_numbers():
    case = load_case(ROOT / "cases" / "reactor_paper.yaml")
    assert (case.contact.youngs_modulus, case.contact.poisson, case.contact.restitution) == (4.7e9, 0.35, 0.43)
    assert (case.contact.friction, case.contact.rolling_friction) == (0.73, 0.21)
    assert (case.dem.time_step, case.dem.plate_speed, case.dem.max_time) == (1e-5, 0.01, 200)
    assert (case.material.size.radii.normal.mean, case.material.size.radii.normal.std) == (0.03, 0.01)
    assert case.homogenize.start == 20


def test_starter_case_loads(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text(starter_case())
    assert load_case(path).name == "my-silo"


def test_reference_of_the_case_keys_is_current():
    assert (ROOT / "docs" / "reference" / "case.md").read_text() == reference(), "run `make docs`"


def _objects(schema):
    if isinstance(schema, dict):
        if schema.get("type") == "object":
            yield schema
        for value in schema.values():
            yield from _objects(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from _objects(value)


def test_schema_describes_every_key_and_allows_no_other():
    objects = list(_objects(json.loads(schema_json())))
    assert len(objects) > 10
    for group in objects:
        assert group["additionalProperties"] is False
        for name, key in group.get("properties", {}).items():
            assert "description" in key or "$ref" in key, name
    assert all("description" in group for group in json.loads(schema_json())["$defs"].values())


def test_schema_accepts_numbers_and_text_with_units():
    schema = json.loads(schema_json())
    density = schema["$defs"]["Material"]["properties"]["density"]
    assert [kind["type"] for kind in density["anyOf"]] == ["number", "string"]
    angle = schema["$defs"]["Material"]["properties"]["internal_friction_angle"]
    assert [kind["type"] for kind in angle["anyOf"]] == ["string"]
    assert {"const": "auto"} in schema["$defs"]["Dem"]["properties"]["time_step"]["anyOf"]
