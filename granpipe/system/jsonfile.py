"""JSON files that granpipe leaves for itself and for its users."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from granpipe.errors import DataError


def read_json(path: Path) -> dict[str, Any]:
    """What `write_json` wrote; DataError where it is gone or damaged."""
    try:
        data: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: damaged ({error}); delete {path.parent} and run again") from error
    return data


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Indented, readable."""
    path.write_text(json.dumps(data, indent=2, ensure_ascii=False) + "\n")
