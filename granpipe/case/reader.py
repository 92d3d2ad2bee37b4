"""case.yaml → Case: the only reader of user input."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from granpipe.case.drawing import with_drawing
from granpipe.case.library import with_material
from granpipe.case.messages import case_error
from granpipe.case.outline import DRAWING_KEYS, SLAB, DrawingSpec, OutlineSpec
from granpipe.case.overrides import override
from granpipe.case.renamed import refuse_renamed
from granpipe.case.schema import Case
from granpipe.case.vessel import with_vessel
from granpipe.case.yamlfile import Places, read_yaml
from granpipe.errors import CaseError


@dataclass(frozen=True)
class CaseFile:
    """A case, where each of its keys stands, what was found in its drawing, and its file where it has one.

    Parameters
    ----------
    library : each value that the library of materials gave, with its source
    """

    case: Case
    places: Places
    notes: tuple[str, ...] = ()
    library: tuple[str, ...] = ()
    path: Path | None = None


def read_case(path: Path, overrides: Mapping[str, str] | None = None) -> CaseFile:
    """The case of a file; `overrides` maps dotted keys to YAML text.

    Raises
    ------
    CaseError : the file cannot be read or does not describe a case; says what is wrong and where
    """
    data, places = read_yaml(path)
    return replace(resolve(data, places, overrides, path.parent), path=path)


def case_of(file: CaseFile) -> Case:
    """The case alone, which remembers where its keys stand."""
    file.case._origin = file.places, file.notes, file.library
    return file.case


def file_of(case: Case) -> CaseFile:
    """The file of a case that `case_of` gave; of one made in another way, a file without places.

    Raises
    ------
    CaseError : the case was changed meanwhile into one that no file describes, as by pydantic's `model_copy`
    """
    places, *found = case._origin or (Places("case"),)
    try:
        data = case.model_dump(mode="json", exclude_unset=True, warnings=False)
    except ValueError as error:  # what writes one of its values stumbled over it
        raise CaseError(f"a value was changed into one of another kind ({error})", place=places.file) from None
    try:
        return CaseFile(Case.model_validate(data), places, *found)
    except ValidationError as error:
        raise case_error(error, data, places) from None


def resolve(
    data: dict[str, Any], places: Places, overrides: Mapping[str, str] | None = None, folder: Path = Path()
) -> CaseFile:
    """The case that plain data describe, after overriding; `data` and `places` are changed.

    Parameters
    ----------
    folder : to which the path of a drawing is relative

    Raises
    ------
    CaseError : the data do not describe a case
    """
    for key, text in (overrides or {}).items():
        override(data, places, key, text)
    refuse_renamed(data, places)
    with_vessel(data, places, folder)
    notes = with_drawing(data, places, folder)
    taken = with_material(data, places)
    try:
        return CaseFile(Case.model_validate(data), places, notes, taken)
    except ValidationError as error:
        raise case_error(error, data, places) from None


def load_case(path: Path, overrides: Mapping[str, str] | None = None) -> Case:
    """The case of a file without the places of its keys; see `read_case`.

    Raises
    ------
    CaseError : the file cannot be read, or a key or value is wrong
    """
    return read_case(path, overrides).case


def varied(case: Case, changes: Mapping[str, str]) -> Case:
    """The case with dotted keys changed to YAML text, as by ``--set``; defaults that depend on them change too.

    The outline is in metres by now, whatever the unit of its file.

    Raises
    ------
    CaseError : with the key of a wrong change
    """
    return resolve(case.model_dump(mode="json", exclude_unset=True, exclude_none=True), Places(case.name), changes).case


def schema_json() -> str:
    """JSON Schema of a case file, for editors."""
    groups = Case.model_json_schema()
    outline, drawing = groups["$defs"][OutlineSpec.__name__], DrawingSpec.model_json_schema()["properties"]
    outline["properties"] |= {key: drawing[key] for key in DrawingSpec.model_fields if key in DRAWING_KEYS}
    outline["anyOf"] = [{"required": keys} for keys in (["wall"], ["file"], list(SLAB))]
    groups["required"].remove("outline")
    groups["anyOf"] = [{"required": ["outline"]}, {"required": ["vessel"]}]
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | _for_editors(groups)
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _for_editors(schema: Any) -> Any:
    """Without generated titles and without null, which no key accepts; names of obstacles and sections checked."""
    if isinstance(schema, list):
        return [_for_editors(item) for item in schema if item != {"type": "null"}]
    if not isinstance(schema, dict):
        return schema
    kept = {
        key: _for_editors(value)
        for key, value in schema.items()
        if not (key == "title" and isinstance(value, str)) and not (key == "default" and value is None)
    }
    return kept | ({"additionalProperties": False} if "patternProperties" in kept else {})


def starter_case() -> str:
    """Text of a small commented case to start from."""
    return (Path(__file__).parents[1] / "templates" / "case.yaml").read_text(encoding="utf-8")
