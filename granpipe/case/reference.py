"""The reference of every case key, written from the schema so that the two cannot drift apart.

``docs/reference/case.md`` is what `reference` returns: ``make docs`` writes it anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, get_args

from pydantic.fields import FieldInfo

from granpipe.case.outline import DRAWING_KEYS, DrawingSpec, OutlineSpec
from granpipe.case.schema import Case
from granpipe.case.values import Group, Kind, Short

_INTRODUCTION = """\
# The case file

Every key that a case may have. This page is made from the schema: run `make docs` after changing it.
`granpipe init` writes a commented starter case, `granpipe check case.yaml` says whether a case is valid, and
`granpipe schema` gives the JSON Schema with which an editor completes and checks keys while you type.

**Numbers and units.** A number without unit is in SI. Any quantity may carry its unit: `3 cm`, `3[cm]`, `1[m^3/h]`,
`2 t/h`, `5 %`, and ratios may be fractions such as `2/3`. Inside `[ ]` and `{ }` write `3 cm` or `"3[cm]"`: YAML takes
the bracket of `3[cm]` for a list there. Angles and flow rates always need their unit. Coordinates of the outline are
plain numbers, and `outline.unit` says their unit.

**Sections** are levels, `a: [5.9, 4.9]`, or groups of keys, `a: {z: [5.9, 4.9], regime: mass_flow, wall_factor: 2/3}`.

**Sizes** say whether they are radii or diameters: `size: {radius: 3 cm}`,
`size: {diameter: {normal: {mean: 6 cm, std: 1 cm, min: 4 cm, max: 8 cm}}}`,
`size: {diameter: {sieve: {edges: [2 cm, 4 cm, 8 cm], fractions: [30 %, 70 %]}}, by: mass}`.

**Overriding.** `--set dem.seed=2` overrides one key for one run; the value is YAML, and groups may be given whole:
`--set 'material.size={radius: 4 cm}'`.

A key that granpipe does not know, a key given twice and a value that is physically impossible are refused with the line
where they stand.
"""


_IN_PLACE_OF_POINTS = """\
A drawing in place of points: these keys stand for `wall` and `obstacles`, and `unit` is that of the drawing. If there
is a layer `wall`, the layers `wall`, `obstacle…` and `axis` are used; otherwise wall and obstacles are found by their
shape.
"""

_HEAD = ("| key | what may stand there | default | meaning |", "|---|---|---|---|")


def reference() -> str:
    """The reference as Markdown."""
    tables = []
    for group, paths in _groups().items():
        tables.append(_table(paths, group))
        if group is OutlineSpec:
            rows = (_row(key, field) for key, field in DrawingSpec.model_fields.items() if key in DRAWING_KEYS)
            tables.append("\n".join([_IN_PLACE_OF_POINTS, *_HEAD, *rows, ""]))
    return "\n".join([_INTRODUCTION, *tables])


def _groups() -> dict[type[Group], list[str]]:
    """Every group of keys with the paths at which it stands, in the order of the case."""
    found: dict[type[Group], list[str]] = {}

    def visit(group: type[Group], path: str) -> None:
        found.setdefault(group, []).append(path)
        for name, field in group.model_fields.items():
            below = _group_of(field.annotation)
            if below is not None:
                named = ".<name>" if _is_mapping(field) else ""
                visit(below, f"{path}.{name}{named}" if path else f"{name}{named}")

    visit(Case, "")
    return found


def _group_of(annotation: Any) -> type[Group] | None:
    """The group inside an annotation such as `Group`, `Group | None` or `dict[str, Group]`."""
    if isinstance(annotation, type) and issubclass(annotation, Group):
        return annotation
    return next((group for group in map(_group_of, get_args(annotation)) if group is not None), None)


def _is_mapping(field: FieldInfo) -> bool:
    return getattr(field.annotation, "__origin__", None) is dict


def _table(paths: list[str], group: type[Group]) -> str:
    title = " and ".join(f"`{path}`" for path in paths) if paths != [""] else "Top level"
    rows = [_row(name, field) for name, field in group.model_fields.items()]
    return "\n".join([f"## {title}", "", *_HEAD, *rows, ""])


def _row(name: str, field: FieldInfo) -> str:
    cells = (f"`{name}`", _accepts(field), _default(field), field.description or "")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _accepts(field: FieldInfo) -> str:
    if not _is_mapping(field):
        return _accepted(field.metadata)
    names, values = (getattr(argument, "__metadata__", ()) for argument in get_args(field.annotation))
    return f"names ({_accepted(names)}), each with {_accepted(values)}"


def _accepted(metadata: Iterable[Any]) -> str:
    """What the metadata of an annotation accept; a group of keys where they say nothing of a kind."""
    for item in metadata:
        if isinstance(item, Kind):
            return item.accepts()
        if isinstance(item, Short):
            return f"{item.kind.accepts()}; or keys, below"
    return "keys, below"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    if field.default_factory is not None or field.default is None:
        return ""
    value = field.default
    text = f"[{', '.join(value)}]" if isinstance(value, tuple) else f"{value:g}" if isinstance(value, float) else value
    return f"`{text}`"
