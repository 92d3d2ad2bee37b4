"""sweep.yaml and cluster.yaml: what they expand to, and that everything wrong is refused where it stands."""

import contextlib
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.case.yamlfile import parse_value
from granpipe.errors import CaseError
from granpipe.sweep.file import read_profile, read_sweep, sweep_name, value_text

SWEEP = """\
name: friction
case: cases/hopper.yaml
set: {figures: []}
axes:
  - contact.friction: [0.2, 0.4]
  - dem.seed: {first: 1, last: 3, number: 3}
    dem.max_time: [10 s, 20 s, 30 s]
points:
  paper: {contact.friction: 0.73, contact.restitution: 0.43}
"""


@pytest.fixture
def read(tmp_path):
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "hopper.yaml").write_text("name: hopper\n")

    def read(text, reader=read_sweep):
        path = tmp_path / "file.yaml"
        path.write_text(text)
        return reader(path)

    return read


def message(read, text, reader=read_sweep):
    with pytest.raises(CaseError) as caught:
        read(text, reader)
    return str(caught.value)


def test_axes_and_points_become_variants(read, tmp_path):
    sweep = read(SWEEP)
    variants = list(sweep.inputs.variants.values())
    assert sweep.inputs.text == "name: hopper\n"
    assert len(variants) == 7
    assert variants[5].changes == {
        "figures": "[]", "contact.friction": "0.4", "dem.seed": "3", "dem.max_time": "30 s"
    }  # fmt: skip
    assert variants[-1].name == "paper"
    assert sweep.inputs.axes == ("contact.friction", "dem.seed", "dem.max_time")


@pytest.mark.parametrize(
    "value",
    ["3 cm", 0.2, 1e-5, 3, True, None, [1, "2 cm"], {"a": [1]}, "0.2", "yes: no", "3[cm]", "", " x", "a\nb", "#"],
)
def test_values_become_text_that_means_the_same(value):
    text = value_text(value)
    assert parse_value(text, "", ())[0] == value
    assert "\n" not in text


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("axes:", "axis:", "file.yaml:4 axis: unknown key; did you mean `axes`?"),
        ("[0.2, 0.4]", "0.2", "file.yaml:5 axes[0].contact.friction: 0.2; must be a list of values"),
        ("[0.2, 0.4]", "[]", "must be a list of values"),
        ("[10 s, 20 s, 30 s]", "[10 s, 20 s]", "equally many values (dem.seed: 3, dem.max_time: 2)"),
        ("last: 3", "last: 3 cm", "must both have the same unit"),
        ("number: 3", "number: 0", "must be a whole number from 1"),
        ("number: 3", "steps: 3", "or {first: …, last: …, number: …}"),
        ("dem.max_time", "contact.friction", "stands in two axes"),
        ("dem.max_time", "contact.friction.x", "file.yaml:7 axes[1].contact.friction.x: is part of contact.friction"),
        ("[0.2, 0.4]", "[0.4, 4e-1]", "file.yaml:5 axes[0].contact.friction[1]: contact.friction: 0.4 stands in this "),
        (
            "last: 3, number: 3}\n    dem.max_time: [10 s, 20 s, 30 s]",
            "last: 1, number: 3}",
            "file.yaml:6 axes[1].dem.s",
        ),
        (
            "0.73, contact.restitution: 0.43}",
            "0.73}\n  again: {contact.friction: 0.73}",
            "file.yaml:10 points.again: is",
        ),
        ("cases/hopper.yaml", "cases/none.yaml", "file.yaml:2 case: cases/none.yaml: no such file; give the path of a"),
        ("case: cases/hopper.yaml", "outline: {}", "file.yaml: is a case, not a sweep"),
        ("contact.friction: [", "contact friction: [", "must be a dotted key of the case"),
        ("contact.friction: [", "name: [", "cannot be varied"),
        ("paper:", "../paper:", "letters, digits"),
        ("name: friction", "name: ../friction", "letters, digits"),
        ("case: cases/hopper.yaml\n", "", "case: missing; give it"),
        ("number: 3}\n    dem.max_time: [10 s, 20 s, 30 s]", "number: 90000}", "must not make more than 100000 points"),
        ("paper:", "friction-0_2:", ""),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(read, old, new, expected):
    text = SWEEP.replace(old, new)
    assert text != SWEEP
    if expected:
        assert expected in message(read, text)
    else:
        read(text)


def test_values_of_a_zipped_axis_may_repeat_where_another_key_changes(read):
    text = SWEEP.replace("[10 s, 20 s, 30 s]", "[10 s, 10 s, 10 s]")
    assert len(read(text).inputs.variants) == 7


def test_the_name_is_told_without_the_case(read, tmp_path):
    (tmp_path / "cases" / "hopper.yaml").unlink()
    assert read(SWEEP, sweep_name) == "friction"


def test_a_sweep_without_points_is_refused(read):
    assert "give axes, points, or both" in message(read, "name: a\ncase: b.yaml\n")


def test_a_named_point_may_not_be_one_of_the_axes(read):
    text = "name: a\ncase: b.yaml\naxes: [{dem.seed: [1, 2]}]\npoints: {seed-1: {dem.seed: 3}}\n"
    assert "is the name of a point of the axes, too" in message(read, text)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_damaged_text_is_refused_or_read_but_never_breaks(data):
    text = list(SWEEP)
    for _ in range(data.draw(st.integers(1, 5))):
        place = data.draw(st.integers(0, len(text) - 1))
        text[place] = data.draw(
            st.sampled_from(["", "\n", " ", ":", "[", "}", "-", "null", "1e999", "{", "~", ",", "é"])
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.yaml"
        path.write_text("".join(text))
        (Path(folder) / "cases").mkdir()
        (Path(folder) / "cases" / "hopper.yaml").write_text("name: hopper\n")
        with contextlib.suppress(CaseError):
            read_sweep(path)


PROFILE = """\
time: 4 h
memory: 2 GB
ranks: 2
partition: main
modules: [LIGGGHTS/3.8]
setup: [source ~/granpipe/.venv/bin/activate]
options: [--qos=long]
"""


def test_a_profile_is_read(read):
    profile = read(PROFILE, read_profile)
    assert (profile.time, profile.memory, profile.ranks, profile.margin) == (14400, 2000, 2, 60)
    assert profile.setup == ("source ~/granpipe/.venv/bin/activate",)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("time: 4 h", "time: 30 s", "must be in [60, 3e+07] s"),
        ("time: 4 h\n", "", "time: missing"),
        ("time: 4 h", "time: 2 min\nmargin: 3 min", "margin: 3 min; must be below time"),
        ("2 GB", "2", "must be an amount with its unit"),
        ("partition: main", "partition: main; rm -rf /", "must be letters, digits"),
        ("partition: main", 'partition: "main\\n#SBATCH --uid=0"', "must be letters, digits"),
        ("LIGGGHTS/3.8", "a;b", "the name of a module"),
        ("activate]", "activate; true]", "one plain shell command"),
        ("activate]", "a$(true)]", "one plain shell command"),
        ("activate]", "a`true`]", "one plain shell command"),
        ("activate]", '"a\\ntrue"]', "one plain shell command"),
        ("--qos=long", "-q long", "one long option of sbatch"),
        ("--qos=long", "--qos=$X", "one long option of sbatch"),
        ("--qos=long", "--array=1-9", "give `at_once`"),
        ("--qos=long", "--arr=1-9", "give `at_once`"),
        ("--qos=long", "--time=9", "give `time`"),
        ("--qos=long", "--wrap=true", "leave it out"),
        ("--qos=long", "--output=/dev/null", "leave it out"),
        ("--qos=long", "--no-requeue", "leave it out"),
        ("activate]", "activate, eval $X]", "`eval` would take the script"),
        ("activate]", "activate, exec sleep 9]", "`exec` would take the script"),
        ("activate]", "activate, command eval true]", "`command` would take the script"),
        ("activate]", "activate, builtin exit 0]", "`builtin` would take the script"),
        ("activate]", 'activate, "trap true TERM"]', "`trap` would take the script"),
        ("partition", "partitoin", "did you mean `partition`?"),
    ],
)
def test_nothing_unsafe_reaches_a_script(read, old, new, expected):
    text = PROFILE.replace(old, new)
    assert text != PROFILE
    assert expected in message(read, text, read_profile)


@pytest.mark.parametrize("option", ["--exclusive", "--time-min=9", "--mem-per-cpu=100", "--gres=gpu:1", "--nodes=2"])
def test_options_that_granpipe_does_not_give_are_passed_on(read, option):
    assert read(PROFILE.replace("--qos=long", option), read_profile).options == (option,)


def test_the_example_of_the_docs_is_valid():
    cases = Path(__file__).parents[2] / "cases"
    for path in cases.glob("sweeps/*.yaml"):
        assert (read_profile if path.stem == "cluster" else read_sweep)(path)
