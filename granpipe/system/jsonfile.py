"""JSON files that granpipe leaves for itself and for its users: written readably, and read into what is expected."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload

from pydantic import TypeAdapter, ValidationError

from granpipe.errors import DataError
from granpipe.system.files import write_whole
from granpipe.system.reading import read_bytes, reason

T = TypeVar("T")

MOST_BYTES = 100_000_000
"""A sweep of 100 000 points takes a fifth of that."""


@overload
def read_json(path: Path) -> dict[str, Any]: ...
@overload
def read_json(path: Path, kind: type[T], remedy: str = "") -> T: ...
def read_json(path: Path, kind: Any = dict[str, Any], remedy: str = "") -> Any:
    """The content of a file as what is expected: a dataclass, ``dict[str, float]`` …; further keys are passed over.

    Parameters
    ----------
    kind : what the content must be; its types are taken strictly
    remedy : what to do where it is not; unless given, to delete the file's folder and run again

    Raises
    ------
    DataError : no regular file, too large, not JSON, nested too deeply, or not what is expected
    """
    try:
        return _adapter(kind).validate_json(read_bytes(path, MOST_BYTES), strict=True)
    except (OSError, ValueError) as error:
        text = _first(error) if isinstance(error, ValidationError) else reason(error)
        raise DataError(f"{path}: {text}; {remedy or f'delete {path.parent} and run again'}") from error


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Indented, readable; by one rename."""
    write_whole(path, json.dumps(data, indent=2, ensure_ascii=False) + "\n")


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _first(error: ValidationError) -> str:
    """The first thing that is wrong, and where."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    where = ".".join(map(str, first["loc"]))
    return f"damaged ({where}: {first['msg']})" if where else f"damaged ({first['msg']})"
