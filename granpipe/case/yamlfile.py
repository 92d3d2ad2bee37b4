"""YAML text into plain data, with the line of every key.

Reads what users mean: ``1e-5`` and ``4.7e9`` are numbers (PyYAML takes them for text), only ``true`` and ``false``
are booleans, and everything else is text. Refuses what they cannot mean: duplicate keys, tags, alias bombs.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from granpipe.errors import CaseError, KeyPath
from granpipe.system.reading import read_bytes, reason

MAX_BYTES = 1_000_000
MAX_NODES = 50_000  # also after aliases are expanded
MAX_DEPTH = 32
MAX_KEY = 64

_TOO_MUCH = "nested too deeply, or too much data for a case"
_PLAIN_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "seq", "map")}

_INTEGER = re.compile(r"[+-]?\d{1,300}")
_FLOAT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UNIT_IN_FLOW = re.compile(r"[\d.]\s*\[\s*[A-Za-z%°]")


@dataclass
class Places:
    """Where every key of a case stands: ``file:line``, or `--set` (which has no `lines`) where that gave it."""

    file: str
    lines: bool = True
    known: dict[KeyPath, str] = field(default_factory=dict)

    def at(self, line: int) -> str:
        """Place of a line, counted from 0."""
        return f"{self.file}:{line + 1}" if self.lines else self.file

    def locate(self, key: KeyPath) -> str:
        """Place of the key, or of the nearest key above it that the file has."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.known:
                return self.known[key[:length]]
        return self.file

    def explain(self, error: CaseError) -> CaseError:
        """The same error with its place filled in."""
        return CaseError(error.message, error.key, error.place or self.locate(error.key))

    def replace(self, key: KeyPath, given: Places) -> None:
        """Forget the key and all below it; take their places from where they were given anew."""
        kept = {old: place for old, place in self.known.items() if old[: len(key)] != key}
        self.known = kept | given.known


CASE_EXAMPLE = "`granpipe init` writes a commented starter case"


def read_yaml(path: Path, example: str = CASE_EXAMPLE) -> tuple[dict[str, Any], Places]:
    """Plain data of a YAML file, which must hold a mapping, and the places of its keys.

    Parameters
    ----------
    example : where to get a file, for the message where there is none

    Raises
    ------
    CaseError : the file cannot be read, is too large, or is not YAML that means one thing
    """
    return parse_yaml(text_of(path, example), path.name, example)


def parse_yaml(text: str, file: str, example: str = CASE_EXAMPLE) -> tuple[dict[str, Any], Places]:
    """Plain data and places of YAML text that must hold a mapping.

    Raises
    ------
    CaseError : the text is empty, no mapping, or not YAML that a case may use
    """
    places = Places(file)
    node = _composed(text, places)
    if node is None:
        raise CaseError(f"the file is empty; {example}", place=file)
    data = _Reader(places).read(node)
    if not isinstance(data, dict):
        raise CaseError("must be a mapping of keys to values, such as `name: my-case`", place=places.at(0))
    return data, places


def parse_value(text: str, source: str, key: KeyPath) -> tuple[Any, Places]:
    """Plain data of the YAML text of one value, given for a key by `source` (such as ``--set``).

    Raises
    ------
    CaseError : the text is not YAML that a case may use
    """
    places = Places(source, lines=False, known={key: source})
    try:
        node = _composed(text, places)
    except CaseError as error:
        raise CaseError(error.message, key, error.place) from error
    return (None if node is None else _Reader(places).read(node, key)), places


def text_of(path: Path, example: str = CASE_EXAMPLE) -> str:
    """The text of a YAML file; CaseError where it is not one."""
    try:
        raw = read_bytes(path, MAX_BYTES)
    except FileNotFoundError:
        raise CaseError(f"no such file; {example}", place=str(path)) from None
    except (OSError, ValueError) as error:
        raise CaseError(f"cannot be read ({reason(error)})", place=str(path)) from error
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise CaseError("UTF-16 text; save the file as UTF-8", place=str(path))
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = "not UTF-8 text, probably Latin-1 or Windows-1252; save the file as UTF-8"
        raise CaseError(message, place=f"{path}:{line}") from error
    if "\0" in text:
        raise CaseError("binary data, not a YAML text", place=str(path))
    return text


class _Loader(yaml.BaseLoader):
    """Composes nodes, all scalars as text; stops at once where there are too many or too deep ones."""

    nodes = depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self.nodes, self.depth = self.nodes + 1, self.depth + 1
        if self.nodes > MAX_NODES or self.depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(problem=_TOO_MUCH, problem_mark=self.get_mark())
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def _composed(text: str, places: Places) -> yaml.Node | None:
    try:
        return yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        raise _syntax_error(error, text, places) from error
    except yaml.YAMLError as error:  # control characters
        raise CaseError(f"not YAML: {' '.join(str(error).split())}", place=places.file) from error


def _syntax_error(error: yaml.MarkedYAMLError, text: str, places: Places) -> CaseError:
    mark = error.problem_mark or error.context_mark
    line = mark.line if mark else 0
    lines = text.splitlines()
    message = f"not YAML: {error.problem or error.context}"
    if _UNIT_IN_FLOW.search(lines[line] if line < len(lines) else ""):
        message = (
            'inside [ ] or { } YAML cannot read a unit in brackets: write 3 cm or "3[cm]"; '
            "outline points are plain numbers, and outline.unit says their unit"
        )
    elif "'\\t'" in message:
        message = "not YAML: a tab; it indents with spaces only"
    return CaseError(message, place=places.at(line))


class _Reader:
    """Walks composed nodes (an aliased one each time that it stands somewhere), noting the line of every key."""

    def __init__(self, places: Places) -> None:
        self.places, self.nodes = places, 0

    def read(self, node: yaml.Node, key: KeyPath = ()) -> Any:
        self._check(node, key)
        if key:
            self.places.known.setdefault(key, self._place(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, key)
        if isinstance(node, yaml.SequenceNode):
            return [self.read(item, (*key, index)) for index, item in enumerate(node.value)]
        return _scalar(node)

    def _place(self, node: yaml.Node) -> str:
        return self.places.at(node.start_mark.line)

    def _check(self, node: yaml.Node, key: KeyPath) -> None:
        self.nodes += 1
        if self.nodes > MAX_NODES or len(key) > MAX_DEPTH:
            raise CaseError(f"{_TOO_MUCH}: look at its aliases", place=self._place(node))
        if node.tag not in _PLAIN_TAGS:
            raise CaseError(f"tags such as `{shorten(node.tag)}` are not accepted", key, self._place(node))

    def _mapping(self, node: yaml.MappingNode, key: KeyPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for name_node, value_node in node.value:
            name = name_node.value
            if not isinstance(name, str) or not name.isprintable() or not 0 < len(name) <= MAX_KEY:
                raise CaseError("a key must be text of 1 to 64 printable characters", key, self._place(name_node))
            path = (*key, name)
            if name in data:
                raise CaseError(f"given twice (first at {self.places.locate(path)})", path, self._place(name_node))
            self.places.known[path] = self._place(name_node)
            data[name] = self.read(value_node, path)
        return data


def _scalar(node: Any) -> Any:
    return node.value if node.style is not None else plain_value(node.value)  # quoted or block text is text


def plain_value(text: str) -> Any:
    """What an unquoted scalar means: null, boolean, number or text."""
    if text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if _INTEGER.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def shorten(value: Any, longest: int = 60) -> str:
    """A raw value on one line, cut where long."""
    text = " ".join(str(value).split()) if value is not None else "no value"
    return text if len(text) <= longest else text[: longest - 1] + "…"


class _Dumper(yaml.SafeDumper):
    """Writes text that `plain_value` would take for something else in quotes."""


def _quoted_if_needed(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = None if isinstance(plain_value(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _quoted_if_needed)


def dump_yaml(data: Any) -> str:
    """Plain data as YAML text that `parse_yaml` reads as the same data."""
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True))
