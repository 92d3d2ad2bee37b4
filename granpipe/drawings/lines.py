"""What every drawing is read into: lines in a plane, with the layers that they lie on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

LARGEST = 1e9
"""Of any coordinate, in the drawing's unit."""


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline of a drawing.

    Parameters
    ----------
    points : (n, 2) x and y in the drawing's unit; the first point is repeated at the end of a closed line
    layer : name of its layer; empty in formats without layers
    """

    points: Points
    layer: str = ""


@dataclass(frozen=True, eq=False)
class Lines:
    """All lines of a drawing.

    Parameters
    ----------
    lines : in the drawing's own coordinates, arcs flattened
    unit : of the coordinates, such as "mm"; empty where the file does not tell
    half : x is already the radius and y the height: the lines are those of a half section
    precision : of the coordinates, relative to the size: points nearer than this are one point
    """

    lines: Sequence[Line]
    unit: str = ""
    half: bool = False
    precision: float = 1e-6
