"""sweep.yaml and cluster.yaml: which cases to run, and on which cluster. Read with the same care as a case."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError, model_validator

from granpipe.case.messages import case_error
from granpipe.case.overrides import SOURCE
from granpipe.case.units import TIME
from granpipe.case.values import File, Group, Kind, Name, Quantity, SomeOf, Whole, refuse
from granpipe.case.yamlfile import Places, parse_value, plain_value, read_yaml, text_of
from granpipe.errors import CaseError
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.variants import MAX_NAME, Variant, crossed, spaced

Table = Literal["csv", "netcdf"]

MAX_POINTS = 100_000
"""Points of one sweep: each is a folder and a small file."""

_EXAMPLE = "docs/how-to/cluster.md shows how to write a sweep"

_DOTTED = r"[A-Za-z][A-Za-z0-9_]*(\.[A-Za-z][A-Za-z0-9_]*)*"


def value_text(value: Any) -> str:
    """Plain data of YAML as YAML text on one line, as ``--set`` takes it: the shortest that means the same."""
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    try:
        same = parse_value(text, "", ())[0] == value
    except CaseError:
        same = False
    return text if same and text == " ".join(text.split()) else json.dumps(value, ensure_ascii=False)


class Changes(Kind):
    """Dotted keys of the case and their values."""

    def read(self, value: Any) -> dict[str, str]:
        if not isinstance(value, Mapping):
            refuse(f"must be {self.accepts()}")
        for key in value:
            _check_key(key)
        return {key: value_text(item) for key, item in value.items()}

    def accepts(self) -> str:
        return "a group of dotted keys of the case with their values, such as `contact.friction: 0.4`"

    def schema(self) -> dict[str, Any]:
        return {"type": "object", "propertyNames": {"pattern": f"^{_DOTTED}$"}}


class Axes(Kind):
    """A list of axes; each is a group of dotted keys with equally many values."""

    def read(self, value: Any) -> tuple[dict[str, list[str]], ...]:
        if not isinstance(value, list):
            refuse(f"must be {self.accepts()}")
        axes = tuple(_axis(group, index) for index, group in enumerate(value))
        keys = [(index, key) for index, axis in enumerate(axes) for key in axis]
        for index, key in keys:
            if [other for _, other in keys].count(key) > 1:
                refuse("stands in two axes", (index, key), show_value=False)
            for _, other in keys:
                if key.startswith(f"{other}."):
                    refuse(
                        f"is part of {other}, which is varied, too; vary one of them", (index, key), show_value=False
                    )
        return axes

    def accepts(self) -> str:
        return (
            "a list of axes, such as `- contact.friction: [0.2, 0.4]` or `- dem.seed: {first: 1, last: 8, number: 8}`; "
            "keys of one axis change together, different axes are crossed"
        )

    def schema(self) -> dict[str, Any]:
        spaced_values = {"type": "object", "required": ["first", "last", "number"]}
        values = {"anyOf": [{"type": "array", "minItems": 1}, spaced_values]}
        axis = {"type": "object", "propertyNames": {"pattern": f"^{_DOTTED}$"}, "additionalProperties": values}
        return {"type": "array", "items": axis}


def _axis(group: Any, index: int) -> dict[str, list[str]]:
    if not isinstance(group, Mapping) or not group:
        refuse("must be a group of dotted keys of the case, each with a list of values or a range", (index,))
    axis = {key: _values(item, (index, key)) for key, item in group.items()}
    counts = {key: len(values) for key, values in axis.items()}
    if len(set(counts.values())) > 1:
        numbers = ", ".join(f"{key}: {count}" for key, count in counts.items())
        refuse(f"keys of one axis must have equally many values ({numbers})", (index,), show_value=False)
    first, seen = next(iter(axis)), set()
    for place, texts in enumerate(zip(*axis.values(), strict=True)):
        changes = dict(zip(axis, texts, strict=True))
        if (same := _meaning(changes)) in seen:
            words = ", ".join(f"{key}: {text}" for key, text in changes.items())
            where = (index, first, place) if isinstance(group[first], list) else (index, first)
            refuse(f"{words} stands in this axis twice; give it once", where, show_value=False)
        seen.add(same)
    return axis


def _meaning(changes: Mapping[str, str]) -> frozenset[tuple[str, bool, Any]]:
    """What is the same for equal changes, however their numbers are written."""
    values = {key: plain_value(text) for key, text in changes.items()}
    return frozenset((key, isinstance(value, bool), value) for key, value in values.items())


def _values(item: Any, key: tuple[int, str]) -> list[str]:
    _check_key(key[1], key[:1])
    if isinstance(item, Mapping) and item.keys() == {"first", "last", "number"}:
        return _range(item, key)
    if not isinstance(item, list) or not 0 < len(item) <= MAX_POINTS:
        refuse("must be a list of values, or {first: …, last: …, number: …}", key)
    return [value_text(value) for value in item]


def _range(item: Mapping[str, Any], key: tuple[int, str]) -> list[str]:
    number = item["number"]
    if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= MAX_POINTS:
        refuse(f"must be a whole number from 1 to {MAX_POINTS}", (*key, "number"))
    try:
        return spaced(value_text(item["first"]), value_text(item["last"]), number)
    except ValueError as error:
        refuse(str(error), key)


def _check_key(key: str, path: tuple[int, ...] = ()) -> None:
    if not re.fullmatch(_DOTTED, key):
        refuse("must be a dotted key of the case, such as dem.seed", (*path, key), show_value=False)
    if key == "name":
        refuse("cannot be varied: every point is named by its changes", (*path, key), show_value=False)


@dataclass(frozen=True)
class Matching(Kind):
    """Text that is safe in a shell script, because it matches a strict pattern."""

    pattern: str
    words: str
    refusal: Callable[[str], str] = lambda _: ""
    """Why a text that matches is refused all the same."""

    def read(self, value: Any) -> str:
        return self.read_at((), value)

    def read_at(self, key: tuple[int, ...], value: Any) -> str:
        """The text; `key` is where it stands in a list."""
        if not isinstance(value, str) or len(value) > 300 or not re.fullmatch(self.pattern, value):
            refuse(f"must be {self.words}", key)
        if why := self.refusal(value):
            refuse(why, key)
        return value

    def accepts(self) -> str:
        return self.words

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "pattern": f"^{self.pattern}$", "maxLength": 300}


@dataclass(frozen=True)
class Lines(Kind):
    """A list of such texts."""

    item: Matching

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list):
            refuse(f"must be {self.accepts()}")
        return tuple(self.item.read_at((index,), text) for index, text in enumerate(value))

    def accepts(self) -> str:
        return f"a list: each {self.item.words}"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.item.schema()}


_COLUMN = Matching(_DOTTED, "the name of a column of the table, such as wall_seconds")


class _Sweep(Group):
    """Many variants of a case."""

    name: Annotated[str, Name()] = Field(description="Name of the sweep; everything goes to a folder of this name.")
    case: Annotated[str, File()] = Field(description="Path of the case that is varied, relative to this file.")
    set: Annotated[dict[str, str], Changes()] = Field(
        default_factory=dict, description="Dotted keys of the case with the value that they have in every point."
    )
    axes: Annotated[tuple[dict[str, list[str]], ...], Axes()] = Field(
        default=(), description="Values to go through: axes are crossed, keys of one axis change together."
    )
    points: dict[Annotated[str, Name()], Annotated[dict[str, str], Changes()]] = Field(
        default_factory=dict, description="Further points by name, each with the keys that it changes."
    )
    chart: Annotated[tuple[str, ...], Lines(_COLUMN)] = Field(
        default=("wall_seconds",),
        description="Columns of the table to draw over the axes, such as statistical_error.whole.",
    )
    table: Annotated[tuple[Table, ...], SomeOf(Table)] = Field(
        default=("csv",), description="Formats of the table; netcdf needs the extra of that name."
    )

    @model_validator(mode="after")
    def _has_points(self) -> _Sweep:
        if not self.axes and not self.points:
            refuse("missing; give axes, points, or both", ("axes",), show_value=False)
        number = len(self.points)
        if self.axes:
            number += _product(len(next(iter(axis.values()))) for axis in self.axes)
        if number > MAX_POINTS:
            refuse(f"must not make more than {MAX_POINTS} points together, not {number}", ("axes",), show_value=False)
        known = {_meaning(self.set | variant.changes): variant.name for variant in crossed(self.axes)}
        names = set(known.values())
        for name, changes in self.points.items():
            if name in names:
                refuse("is the name of a point of the axes, too", ("points", name), show_value=False)
            if (other := known.setdefault(_meaning(self.set | changes), name)) != name:
                refuse(f"is the same as point {other}; leave one of them out", ("points", name), show_value=False)
        return self


def _product(numbers: Any) -> int:
    result = 1
    for number in numbers:
        result *= number
    return result


@dataclass(frozen=True)
class Sweep:
    """A sweep, expanded.

    Parameters
    ----------
    name : of the sweep
    inputs : what is to be run
    file : name of the file of the case
    places : where the sweep's own keys stand
    """

    name: str
    inputs: SweepInput
    file: str
    places: Places

    def explain(self, error: CaseError, variant: Variant) -> CaseError:
        """An error in a point's case, told where the sweep sets the key that is wrong."""
        place = error.place
        if place == SOURCE:
            place = self._place(max(variant.changes, key=lambda key: _in_common(key, error)), variant)
        return CaseError(f"{error.message} (point {variant.name})", error.key, place)

    def _place(self, key: str, variant: Variant) -> str:
        """Where a point's change of a key stands: in the point itself, in an axis, or in `set`."""
        known = self.places.known
        axes = [path for path in known if path[0] == "axes" and path[2:] == (key,)]
        paths = [("points", variant.name, key), *([] if ("points", variant.name) in known else axes), ("set", key)]
        return next((known[path] for path in paths if path in known), self.places.file)


def _in_common(key: str, error: CaseError) -> int:
    """How many parts a dotted key has in common with that of an error."""
    pairs = zip(key.split("."), error.key, strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def read_sweep(path: Path) -> Sweep:
    """Read sweep.yaml and the case that it varies; CaseError says what is wrong and where."""
    given, places = _given(path)
    case = path.parent / given.case
    try:
        text = text_of(case, "give the path of a case, relative to this file")
    except CaseError as error:
        raise CaseError(f"{given.case}: {error.message}", ("case",), places.locate(("case",))) from None
    named = [Variant(name, changes) for name, changes in given.points.items()]
    variants = {v.name: Variant(v.name, given.set | v.changes) for v in (*crossed(given.axes), *named)}
    axes = tuple(key for axis in given.axes for key in axis)
    return Sweep(given.name, SweepInput(text, variants, axes, given.chart, given.table), case.name, places)


def sweep_name(path: Path) -> str:
    """The name that sweep.yaml gives; the case need not be there.

    Raises
    ------
    CaseError : the file is no sweep
    """
    return _given(path)[0].name


def is_case(path: Path) -> bool:
    """Whether a file is a case rather than a sweep.

    Raises
    ------
    CaseError : the file cannot be read as YAML
    """
    return _is_case(read_yaml(path, _EXAMPLE)[0])


def _given(path: Path) -> tuple[_Sweep, Places]:
    data, places = read_yaml(path, _EXAMPLE)
    if _is_case(data):
        raise CaseError(f"is a case, not a sweep; `granpipe run` runs it, and {_EXAMPLE}", place=str(path))
    return _validated(_Sweep, data, places), places


def _is_case(data: Mapping[str, Any]) -> bool:
    return "outline" in data and "case" not in data


class Memory(Kind):
    """An amount of memory, in MB."""

    _UNITS = {"MB": 1, "GB": 1000, "MiB": 1.048576, "GiB": 1073.741824}  # noqa: RUF012
    _PATTERN = re.compile(r"(\d{1,7}(?:\.\d{1,3})?) ?(MB|GB|MiB|GiB)")

    def read(self, value: Any) -> int:
        match = self._PATTERN.fullmatch(value) if isinstance(value, str) else None
        number = round(float(match[1]) * self._UNITS[match[2]]) if match else 0
        if number < 1:
            refuse(f"must be {self.accepts()}")
        return number

    def accepts(self) -> str:
        return "an amount with its unit, such as 4 GB or 500 MB"

    def schema(self) -> dict[str, Any]:
        return {"type": "string"}


_OWN_OPTIONS = {
    "memory": ("mem",),
    "ranks": ("ntasks",),
    "at_once": ("array",),
    **{name: (name,) for name in ("time", "partition", "account")},
    "": (
        *("chdir", "clusters", "dependency", "error", "export", "export-file", "get-user-env", "gid", "help", "input"),
        *(
            "job-name",
            "no-requeue",
            "open-mode",
            "output",
            "parsable",
            "quiet",
            "requeue",
            "signal",
            "test-only",
            "uid",
        ),
        *("usage", "verbose", "version", "wait", "wrap"),
    ),
}
"""Key of cluster.yaml → options of sbatch that it gives; those without a key granpipe chooses, or reads sbatch by."""

_OWN_WORDS = {
    *("alias", "builtin", "command", "enable", "eval", "exec", "exit", "kill", "logout", "return", "sbatch", "scancel"),
    *("scontrol", "set", "srun", "suspend", "trap", "wait"),
}


def _own_option(option: str) -> str:
    name = option[2:].partition("=")[0]
    for key, names in _OWN_OPTIONS.items():
        if any(own.startswith(name) for own in names):  # sbatch takes the beginning of a name for the name
            return (
                f"must not override what granpipe itself gives to sbatch; {f'give `{key}`' if key else 'leave it out'}"
            )
    return ""


def _own_word(line: str) -> str:
    word = line.split(maxsplit=1)[0]
    return f"`{word}` would take the script out of granpipe's hands; leave it out" if word in _OWN_WORDS else ""


_ACCOUNT = Matching(r"[A-Za-z0-9][A-Za-z0-9_.,-]*", "letters, digits, `_`, `.`, `,` and `-`")
_MODULE = Matching(r"[A-Za-z0-9][A-Za-z0-9_.+/-]*", "the name of a module: letters, digits, `_`, `.`, `+`, `/` and `-`")
_SETUP = Matching(
    r"[A-Za-z.][A-Za-z0-9_./~:=@+,$ {}\"-]*",
    "one plain shell command, such as `source ~/granpipe/.venv/bin/activate` or `export NAME=value`: no `;`, `|`, `&`, "
    "`<`, `>`, parentheses or backquotes",
    _own_word,
)
_OPTION = Matching(
    r"--[a-z][a-z-]*(=[A-Za-z0-9_.,:*/+\[\]-]+)?",
    "one long option of sbatch, such as `--qos=long` or `--exclusive`",
    _own_option,
)


class Profile(Group):
    """What a job asks the cluster for: cluster.yaml."""

    ranks: Annotated[int, Whole(1, 4096)] = Field(
        default=1, description="MPI ranks of a point that has particles, where its case leaves `dem.ranks: auto`."
    )
    time: Annotated[float, Quantity(TIME, at_least=60, at_most=3e7)] = Field(
        description="Time limit of a job. One that nears it publishes what it has and goes on in a job of its own."
    )
    margin: Annotated[float, Quantity(TIME, at_least=5, at_most=3600)] = Field(
        default=60.0, description="How long before the time limit a job is told to stop."
    )
    memory: Annotated[int | None, Memory()] = Field(
        default=None, description="Memory of a job; the cluster's default unless given."
    )
    partition: Annotated[str | None, _ACCOUNT] = Field(default=None, description="Partition, or several with commas.")
    account: Annotated[str | None, _ACCOUNT] = Field(default=None, description="Account that is charged.")
    at_once: Annotated[int | None, Whole(1)] = Field(
        default=None, description="How many jobs of a sweep may run at once; as many as the cluster lets, unless given."
    )
    requeues: Annotated[int, Whole(0, 1000)] = Field(
        default=20, description="How often a job may go on after its time limit."
    )
    modules: Annotated[tuple[str, ...], Lines(_MODULE)] = Field(
        default=(), description="Environment modules to load, in this order."
    )
    setup: Annotated[tuple[str, ...], Lines(_SETUP)] = Field(
        default=(), description="Shell commands before granpipe starts, after the modules."
    )
    options: Annotated[tuple[str, ...], Lines(_OPTION)] = Field(default=(), description="Further options of sbatch.")

    @model_validator(mode="after")
    def _margin_inside(self) -> Profile:
        if self.margin >= self.time:
            refuse("must be below time", ("margin",))
        return self


def read_profile(path: Path) -> Profile:
    """Read cluster.yaml; CaseError says what is wrong and where."""
    return _validated(Profile, *read_yaml(path, "docs/how-to/cluster.md shows how to write a profile"))


_Model = TypeVar("_Model", bound=Group)


def _validated(model: type[_Model], data: dict[str, Any], places: Places) -> _Model:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise case_error(error, data, places) from None


assert MAX_NAME == 64  # the length that `Name` accepts
