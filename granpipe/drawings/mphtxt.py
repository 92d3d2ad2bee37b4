"""COMSOL's native text meshes in 2-D (.mphtxt): the boundary of the triangles and quadrilaterals."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granpipe.drawings.lines import Line, Lines
from granpipe.errors import CaseError

Index = NDArray[np.int64]

MOST_VERTICES = 5_000_000

_CORNERS = {"tri": [0, 1, 2], "tri2": [0, 1, 2], "quad": [0, 1, 3, 2], "quad2": [0, 1, 3, 2]}
"""Type of element → its corners in order round it; COMSOL counts those of a quadrilateral row by row."""


def read_mphtxt(path: Path, sagitta: float | None = None) -> Lines:
    """The boundary of a 2-D mesh, x as radius and y as height.

    Source of the format: COMSOL Multiphysics Programming Reference Manual, "The COMSOL File Formats".

    Raises
    ------
    CaseError : no text mesh, not in two dimensions, or damaged
    """
    try:
        words = _words(path)
        points, elements = _mesh(words)
    except (StopIteration, RuntimeError, ValueError, IndexError, OverflowError):
        raise CaseError("no mesh in COMSOL's text format, or cut short; export it as .mphtxt (text)") from None
    if not elements:
        raise CaseError("the mesh has no triangles or quadrilaterals; export the mesh of the r–z domain")
    edges = np.sort(np.concatenate([np.stack([e, np.roll(e, -1, axis=1)], axis=2).reshape(-1, 2) for e in elements]))
    single, count = np.unique(edges, axis=0, return_counts=True)
    if (count > 2).any() or any(len(np.unique(np.sort(e, axis=1), axis=0)) < len(e) for e in elements):
        raise CaseError("damaged: elements lie on each other; make the mesh anew")
    boundary = single[count == 1]
    if (boundary < 0).any() or (boundary >= len(points)).any() or not np.isfinite(points).all():
        raise CaseError("damaged: elements with vertices that are not there")
    return Lines([Line(points[edge]) for edge in boundary], half=True)


def _words(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8") as file:
        for row in file:
            yield from row.partition("#")[0].split()


def _mesh(words: Iterator[str]) -> tuple[NDArray[np.float64], list[Index]]:
    """Vertices and corners of the elements of the first mesh of a file."""
    _skip(words, 2)  # version
    for _ in range(2):  # tags and types, each a number of strings with their lengths
        _skip(words, 2 * _count(words))
    _skip(words, 3)
    _skip(words, 1)
    if next(words) != "Mesh":
        raise CaseError("its first object is not a mesh; export the mesh alone")
    version = int(next(words))
    dimensions = int(next(words))
    if dimensions != 2:
        raise CaseError(f"a mesh in {dimensions} dimensions; export that of the r–z section (2-D axisymmetric)")
    vertices, lowest = _count(words), int(next(words))
    points = np.array([float(word) for word in islice(words, 2 * vertices)]).reshape(vertices, 2)
    elements = []
    for _ in range(_count(words)):
        _skip(words, 1)
        kind = next(words)
        nodes, number = _count(words), _count(words)
        corners = [int(word) - lowest for word in islice(words, nodes * number)]
        rows = np.array(corners, dtype=np.int64).reshape(number, nodes)
        if kind in _CORNERS and number:
            elements.append(rows[:, _CORNERS[kind]])
        if version < 4:  # parameter values stood here
            _skip(words, 1)
            _skip(words, _count(words))
        _skip(words, _count(words))
        if version < 4:
            _skip(words, 2 * _count(words))
    return points, elements


def _count(words: Iterator[str]) -> int:
    number = int(next(words))
    if not 0 <= number <= MOST_VERTICES:
        raise ValueError(number)
    return number


def _skip(words: Iterator[str], number: int) -> None:
    for _ in range(number):
        next(words)
