"""Cases run and results opened from Python."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from decimal import Decimal
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from granpipe.api.flow import Flow, SpaceFlow
from granpipe.case.reader import case_of, file_of, read_case
from granpipe.case.schema import Case
from granpipe.errors import CaseError, DataError
from granpipe.field import Field
from granpipe.geometry.outline import Outline
from granpipe.pipeline.field_vessel import check_vessel
from granpipe.pipeline.gates import Gate
from granpipe.progress import Progress, Silent
from granpipe.system.jsonfile import read_json
from granpipe.system.manifest import MANIFEST, read_manifest, verify

_READ = ("case.yaml", "provenance.json", "plan.json")
"""Files beside ``field.npz`` that a result is made of; dumps may have been averaged without a case."""

_REPORTS = ("stage", "update", "note")
"""Methods of `Progress`."""


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a run left in a results folder.

    Parameters
    ----------
    folder : the results folder
    case : the case with every default filled in; None where dumps were averaged without one
    field : the flow at the flow rate of the process; a `SpaceFlow` in space
    model : ``"dem"``, ``"fluid"`` or ``"hybrid"``; None where nothing was run
    gates : quality gates: measured figures with their limits
    figures : what else was measured, by name, as in ``provenance.json``
    """

    folder: Path
    case: Case | None
    field: Flow | SpaceFlow
    model: str | None
    gates: tuple[Gate, ...]
    figures: Mapping[str, Any]

    @property
    def failed(self) -> tuple[Gate, ...]:
        """The gates that failed."""
        return tuple(gate for gate in self.gates if not gate.passed)

    @property
    def marked(self) -> bool:
        """Whether a quality gate failed: the field is there, and not to be trusted without a look at `failed`."""
        return bool(self.failed)

    def __repr__(self) -> str:
        name = self.folder.name if self.case is None else self.case.name
        quality = f"MARKED: {'; '.join(map(str, self.failed))}" if self.marked else "no quality gate failed"
        return f"<Result {name}: {self.model or 'no run'}, {quality}>"

    def _repr_png_(self) -> bytes | None:
        """The picture that a notebook shows."""
        return self.field._repr_png_() if isinstance(self.field, Flow) else None


def load_case(path: str | PathLike[str], overrides: Mapping[str, Any] | None = None) -> Case:
    """Read a case file.

    Parameters
    ----------
    overrides : dotted keys and their values, as with ``--set``: ``{"dem.seed": 2, "dem.max_time": "8 s"}``. Text is
        read as in the case file; numbers are SI; quantities of pint have their unit

    Raises
    ------
    CaseError : what is wrong with the file or with an override, where, and what to do
    TypeError : `overrides` is no mapping of text to values
    """
    if not isinstance(overrides or {}, Mapping):
        raise TypeError(f"overrides: give a mapping such as {{'dem.seed': 2}}, not {overrides!r:.60}")
    return case_of(read_case(Path(path), {key: _as_text(key, value) for key, value in (overrides or {}).items()}))


def run(
    case: Case, results: str | PathLike[str] = "results", progress: Progress | Literal["console"] | None = "console"
) -> Result:
    """Run a case, as ``granpipe run`` does: the same stages, store and errors; what is done is not repeated.

    The result comes back also where a quality gate failed: look at `Result.marked`.

    Parameters
    ----------
    results : folder of all results; that of the case is made in it
    progress : who is told; unless given, standard error. None: nobody

    Raises
    ------
    CaseError : the case is wrong, or asks for what this machine cannot do
    MeshError, RunError, SolveError, DataError : a program failed, and how
    TypeError : `case` is not what `load_case` gives, or `progress` does not take reports
    """
    from granpipe.console import Console
    from granpipe.pipeline.run import run_case

    if not isinstance(case, Case):
        raise TypeError(f"case: give what load_case returns, not {case!r:.60}")
    if progress not in ("console", None) and not all(callable(getattr(progress, name, None)) for name in _REPORTS):
        raise TypeError(f"progress: {progress!r:.60} has no methods {', '.join(_REPORTS)}; give 'console' or None")
    with Console() if progress == "console" else nullcontext(progress or Silent()) as told:
        outcome = run_case(file_of(case), Path(results), told)
    return load_result(outcome.folder)


def load_result(folder: str | PathLike[str]) -> Result:
    """Open a results folder: of ``granpipe run``, of a point of a sweep, of ``scale`` or of ``homogenize``.

    What is read must be as granpipe wrote it (``manifest.json``). A ``field.npz`` alone in a folder is opened,
    too: nothing but its own checks vouches for it.

    Raises
    ------
    DataError : it is not one, or a file is damaged or was changed since granpipe wrote it, or the field is not one of
        the vessel of the case beside it
    """
    folder = Path(folder)
    alone = not any((folder / name).exists() for name in (*_READ, MANIFEST))
    listed = {} if alone else read_manifest(folder)
    if not alone:
        verify(folder, "field.npz", *(name for name in _READ if name in listed))
    stored = Field.load(folder / "field.npz")
    case = _case_in(folder) if "case.yaml" in listed else None
    outline = None if case is None or case.vessel is not None else Outline.from_case(case)
    if outline is not None:
        check_vessel(stored, outline, folder / "field.npz")
    field = SpaceFlow(stored) if len(stored.grid.shape) == 3 else Flow(stored, outline)
    if "provenance.json" not in listed:
        return Result(folder, case, field, None, (), {})
    provenance = read_json(folder / "provenance.json", _Provenance)
    model = read_json(folder / "plan.json", _Plan).model if "plan.json" in listed else None
    return Result(folder, case, field, model, provenance.quality, provenance.figures)


@dataclass(frozen=True)
class _Provenance:
    quality: tuple[Gate, ...]
    figures: dict[str, Any]


@dataclass(frozen=True)
class _Plan:
    model: Literal["dem", "fluid", "hybrid"]


def _case_in(folder: Path) -> Case:
    try:
        return read_case(folder / "case.yaml").case
    except CaseError as error:
        raise DataError(f"{folder}: its case is not one that this granpipe reads: {error}; run again") from error


def _as_text(key: str, value: Any) -> str:
    """The value of a key as YAML text."""
    if not isinstance(key, str):
        raise TypeError(f"overrides: a key is text such as 'dem.seed', not {key!r:.60}")
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value, default=_plain)
    except (TypeError, ValueError, RecursionError) as error:
        raise CaseError(f"a {type(value).__name__} that no case holds ({error})", (key,), "overrides") from None


def _plain(value: Any) -> Any:
    """What quantities of pint, numpy's scalars and arrays, other numbers and paths mean; TypeError for the rest."""
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        return f"{float(value.magnitude)!r} {value.units:~}"
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Real | Decimal):
        return float(value)
    if isinstance(value, PathLike):
        return str(value)
    raise TypeError(f"it is a {type(value).__name__}")
