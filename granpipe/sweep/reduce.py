"""What a sweep found: the results of all its points in one table, and a chart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from granpipe.errors import DataError
from granpipe.jsonfile import read_json
from granpipe.sweep.folder import Folder
from granpipe.sweep.status import Standing, standings
from granpipe.sweep.table import Row, draw, write_csv, write_netcdf


def reduce(folder: Folder) -> tuple[list[Standing], list[Path]]:
    """Write table and chart from what is there; failed points have a row, too. Returns how all stand, and the files."""
    found = standings(folder)
    keys = _varied_keys(folder)
    rows = [_row(folder, one, keys) for one in found]
    written = []
    for kind, write in (("csv", write_csv), ("netcdf", write_netcdf)):
        if kind in folder.plan["table"]:
            path = folder.root / f"table.{'nc' if kind == 'netcdf' else kind}"
            write(rows, path)
            written.append(path)
    axes, figures = folder.plan["axes"], folder.plan["chart"]
    if axes and figures and any(one.word == "done" for one in found):
        draw(rows, axes, figures, folder.root / "chart.png")
        written.append(folder.root / "chart.png")
    return found, written


def _varied_keys(folder: Folder) -> list[str]:
    """Keys of the case that are not the same in every point, in the order in which the sweep names them."""
    changes = [variant.changes for variant in folder.variants.values()]
    keys = dict.fromkeys(key for one in changes for key in one)
    return [key for key in keys if len({one.get(key) for one in changes}) > 1]


def _row(folder: Folder, standing: Standing, keys: Sequence[str]) -> Row:
    """Changes, standing, quality figures and everything measured that is a single number."""
    changes = folder.variants[standing.name].changes
    row: dict[str, str | float] = {"point": standing.name, **{key: changes.get(key, "") for key in keys}}
    row |= {"status": standing.word, "remark": standing.text}
    if standing.word == "done":
        row |= _measured(folder.points / standing.name / "provenance.json")
    return row


def _measured(path: Path) -> dict[str, str | float]:
    try:
        provenance = read_json(path)
        gates = [gate["passed"] for gate in provenance["quality"]]
        found: dict[str, str | float] = {"wall_seconds": provenance["wall_seconds"], "failed_gates": gates.count(False)}
        found |= {f"quality: {gate['name']}": gate["value"] for gate in provenance["quality"]}
        return found | dict(_numbers(provenance["figures"]))
    except (KeyError, TypeError) as error:
        raise DataError(f"{path}: damaged ({error!r}); delete {path.parent} and run the sweep again") from None


def _numbers(figures: dict[str, Any], above: str = "") -> Iterator[tuple[str, float]]:
    for name, value in figures.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{above}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{above}{name}", value
