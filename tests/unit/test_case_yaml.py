"""YAML as users mean it, with places; hostile YAML refused in one line."""

import time

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.case.yamlfile import MAX_BYTES, dump_yaml, parse_yaml, read_yaml
from granpipe.errors import CaseError


def refused(text, says):
    with pytest.raises(CaseError) as caught:
        parse_yaml(text, "x.yaml")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-5", 1e-5),
        ("4.7e9", 4.7e9),
        ("1.E3", 1000.0),
        (".5", 0.5),
        ("12", 12),
        ("-3", -3),
        ("010", 10),
        ("true", True),
        ("yes", "yes"),
        ("on", "on"),
        ("1:30", "1:30"),
        ("2024-01-02", "2024-01-02"),
        ("0x1F", "0x1F"),
        ("'1'", "1"),
        ("3[cm]", "3[cm]"),
        (".nan", ".nan"),
        ("", None),
        ("null", None),
    ],
)
def test_scalar_is_read_as_it_is_meant(text, value):
    data, _ = parse_yaml(f"key: {text}\n", "x.yaml")
    assert data["key"] == value
    assert type(data["key"]) is type(value)


def test_every_key_and_item_has_its_line():
    _, places = parse_yaml("a:\n  b: 1\n  c:\n  - 5\n  - [6,\n     7]\n", "x.yaml")
    assert places.locate(("a", "b")) == "x.yaml:2"
    assert places.locate(("a", "c", 0)) == "x.yaml:4"
    assert places.locate(("a", "c", 1, 1)) == "x.yaml:6"


def test_unknown_key_is_placed_at_the_nearest_key_above():
    _, places = parse_yaml("a:\n  b: 1\n", "x.yaml")
    assert places.locate(("a", "missing", 3)) == "x.yaml:1"
    assert places.locate(("other",)) == "x.yaml"


def test_place_is_filled_into_an_error_raised_elsewhere():
    _, places = parse_yaml("outline:\n  wall: [[1, 2],\n    [3, 4]]\n", "x.yaml")
    error = places.explain(CaseError("crosses itself", ("outline", "wall", 1)))
    assert str(error) == "x.yaml:3 outline.wall[1]: crosses itself"


def test_duplicate_key_is_refused_with_both_lines():
    message = refused("a:\n  b: 1\n  c: 2\n  b: 3\n", "given twice (first at x.yaml:2)")
    assert message.startswith("x.yaml:4 a.b")


def test_unit_in_brackets_inside_a_list_is_explained():
    message = refused("outline:\n  wall: [[3[cm], 1], [2, 0]]\n", "outline.unit")
    assert message.startswith("x.yaml:2: ")
    refused("size: {mean: 3[cm]}\n", "write 3 cm")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file is empty"),
        ("# only a comment\n", "the file is empty"),
        ("- 1\n- 2\n", "must be a mapping"),
        ("just text\n", "must be a mapping"),
        ("a: [1, 2\n", "not YAML"),
        ("a: 1\n b: 2\n", "not YAML"),
        ("\ta: 1\n", "not YAML"),
        ("a: \x01\n", "not YAML"),
        ("a: *nothing\n", "not YAML"),
        ("--- 1\n--- 2\n", "not YAML"),
        ("? [1, 2]\n: 3\n", "a key must be text of 1 to 64"),
        ('"a\\nb": 1\n', "a key must be text of 1 to 64"),
        ("a: !!python/object/apply:os.system ['true']\n", "tags such as"),
        ("a: !thing 1\n", "tags such as"),
        ("a: !!float 3\n", "tags such as"),
        ("a: &a [*a]\n", "nested too deeply"),
        ("a: " + "[" * 40 + "]" * 40 + "\n", "nested too deeply"),
        ("a: " + "[" * 2000 + "\n", "nested too deeply"),
    ],
)
def test_bad_text_is_refused_in_one_line(text, says):
    refused(text, says)


def test_alias_bomb_is_refused_quickly():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    began = time.perf_counter()
    refused("\n".join(lines), "look at its aliases")
    assert time.perf_counter() - began < 5


def test_alias_in_reason_is_read():
    data, _ = parse_yaml("a: &r {x: 1}\nb: *r\n", "x.yaml")
    assert data == {"a": {"x": 1}, "b": {"x": 1}}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\x89PNG\r\n\x1a\n\x00", "not UTF-8 text"),
        (b"name: \x00\n", "binary data"),
        (b"name: \xff\xfe\n", "not UTF-8 text"),
        (b"#" * (MAX_BYTES + 1), "larger than 1 MB"),
    ],
)
def test_file_that_is_no_case_is_refused(tmp_path, content, says):
    path = tmp_path / "case.yaml"
    path.write_bytes(content)
    with pytest.raises(CaseError, match=says):
        read_yaml(path)


def test_missing_file_and_folder_are_refused(tmp_path):
    with pytest.raises(CaseError, match="no such file"):
        read_yaml(tmp_path / "none.yaml")
    with pytest.raises(CaseError, match=r"cannot be read \(a folder, not a regular file\)"):
        read_yaml(tmp_path)


def test_byte_order_mark_and_windows_lines_are_read(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_bytes(b"\xef\xbb\xbfname: x\r\nmodel: dem\r\n")
    assert read_yaml(path)[0] == {"name": "x", "model": "dem"}


TEXT = st.text(st.characters(exclude_categories=("Cs", "Cc", "Zl", "Zp")), max_size=8)
MISLEADING = st.sampled_from(["1e5", "null", "true", "2/3", "~", "no", "0.1", "- x", "a: b", "#"])
NUMBERS = st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False)
KEYS = st.sampled_from(["a", "b", "1e5", "no"])
PLAIN = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXT | MISLEADING,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(["x", "y"]), PLAIN, min_size=1))
def test_dumped_data_are_read_back_the_same(data):
    assert parse_yaml(dump_yaml(data), "x.yaml")[0] == data


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet="ab:-[]{}&*!|>'\"#, \n\t?%@`1.e", max_size=60))
def test_any_text_is_read_or_refused_as_a_case_error(text):
    try:
        data, _ = parse_yaml(text, "x.yaml")
    except CaseError as error:
        message = str(error)
    else:
        message = ""
        assert set(yaml.load(text, Loader=yaml.BaseLoader)) == set(data)
    assert "\n" not in message
