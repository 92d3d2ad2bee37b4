"""STEP and BREP by gmsh's OpenCASCADE: a face in a plane, or a body of revolution cut through its axis."""

from __future__ import annotations

import contextlib
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granpipe.drawings.lines import Line, Lines, Points
from granpipe.errors import CaseError, MeshError
from granpipe.system.gmsh_session import gmsh_session
from granpipe.system.programs import python_environment

_AXES = ("z", "y", "x")
"""In the order in which they are tried as the axis of a body."""

_SAME_VOLUME = 1e-3
"""Relative difference of a body's volume from that of its section turned about the axis, at most."""

_LEVEL, _PIECES, _PER_TURN = 1e-5, 20, 48
"""Of the size: what is level, and edges of triangles of a surface; triangles in a full turn of a curved one."""

STEP = (".step", ".stp")
"""Endings of files that know their unit."""

_MOST_POINTS = 4096  # of a curve

_UNREADABLE = "not a STEP or BREP file that OpenCASCADE reads; export it again, as STEP AP214"

TIMEOUT = 300.0
"""Seconds after which OpenCASCADE is ended."""

LEAST_SECONDS, SECONDS_PER_MB = 20, 60
"""Processor time that OpenCASCADE gets for a file [s]: some damaged ones keep it busy for ever, whole ones of 6 kB
take 0.02 s."""


def read_cad(path: Path, sagitta: float | None = None, up: str = "") -> Lines:
    """The boundary of the half section of a CAD file, as radius and height.

    A file with bodies is cut by a half plane through the axis of its bounding box; one with faces alone is the section.
    OpenCASCADE works in a process of its own: some damaged files end it.

    Parameters
    ----------
    sagitta : how far a curve may lie off the line that stands for it [m]; 1e-4 of the size unless given
    up : coordinate that points up: x, y, z, or -x, -y, -z; found unless given

    Raises
    ------
    CaseError : no such file, not a body of revolution, or no face is left of it
    """
    found = _asked({"path": str(path), "sagitta": sagitta, "up": up})
    unit = "m" if path.suffix.lower() in STEP else ""
    return Lines([Line(np.array(points)) for points in found["lines"]], unit, half=True)


def read_cad_triangles(path: Path, outlets: Sequence[Sequence[float]] = ()) -> tuple[Points, NDArray[np.int64]]:
    """(n, 3) corners and (m, 3) which of them each triangle has, of the faces of a CAD file; in m of a STEP file.

    A body is the inside of a vessel. Left out of it are its flat faces at the very top and those that the given points
    lie in, or, where none are given, at the very bottom. z is up.

    Parameters
    ----------
    outlets : a point in each outlet, in the unit of the result

    Raises
    ------
    CaseError : no such file, or OpenCASCADE or gmsh cannot read it or mesh it; no flat face where a point is
    """
    found = _asked({"path": str(path), "triangles": True, "outlets": [list(one) for one in outlets]})
    return np.array(found["points"], dtype=float).reshape(-1, 3), np.array(found["corners"], dtype=np.int64)


def _asked(question: dict[str, Any]) -> dict[str, Any]:
    """What a process of its own answers; CaseError where it says why it has no answer, or ends without one."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        command = [sys.executable, "-m", "granpipe.drawings.cad", json.dumps(question | {"answer": str(answer)})]
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(command, env=python_environment(), capture_output=True, timeout=TIMEOUT, check=False)
        found: dict[str, Any] = json.loads(answer.read_text()) if answer.exists() else {"error": _UNREADABLE}
    if "error" in found:
        raise CaseError(found["error"])
    return found


def _limit_time(asked: str) -> None:
    """The kernel ends this process once it has taken the processor for too long."""
    with contextlib.suppress(OSError):
        megabytes = Path(json.loads(asked)["path"]).stat().st_size / 1e6
        seconds = int(LEAST_SECONDS + SECONDS_PER_MB * megabytes)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def _answer(asked: str) -> None:
    """What the process does that `read_cad` starts: write lines, or why there are none, into a file."""
    question = json.loads(asked)
    path = Path(question["path"])
    answer: dict[str, Any]
    try:
        with gmsh_session(f"read {path.name}") as gmsh:
            gmsh.option.setString("Geometry.OCCTargetUnit", "M")
            gmsh.model.occ.importShapes(str(path))
            gmsh.model.occ.synchronize()
            bodies = gmsh.model.getEntities(3)
            if question.get("triangles"):
                answer = _meshed(gmsh, bodies, question["outlets"])
            else:
                sagitta, up = question["sagitta"], question["up"]
                lines = _cut(gmsh, bodies, sagitta, up) if bodies else _face(gmsh, sagitta, up)
                answer = {"lines": [line.points.tolist() for line in lines]}
    except CaseError as error:
        answer = {"error": error.message}
    except MeshError:
        answer = {"error": _UNREADABLE}
    Path(question["answer"]).write_text(json.dumps(answer))


def _meshed(gmsh: Any, bodies: Sequence[tuple[int, int]], outlets: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Corners and triangles of all faces, but for the openings of bodies."""
    if len(bodies) > 1:
        raise CaseError(f"holds {len(bodies)} bodies: join them to one, the space inside of the vessel")
    low, high = _box(gmsh)
    size = float((high - low).max())
    open_faces = set()
    for _, tag in gmsh.model.getEntities(2) if bodies else ():
        box = np.array(gmsh.model.getBoundingBox(2, tag)).reshape(2, 3)
        ends = high[2:] if outlets else (low[2], high[2])
        if any(np.abs(box[:, 2] - end).max() < _LEVEL * size for end in ends):
            open_faces.add(tag)
    for point in outlets if bodies else ():
        faces = [tag for _, tag in gmsh.model.getEntities(2) if _holds(gmsh, tag, point, _LEVEL * size)]
        if not faces:
            named = ", ".join(f"{one:.6g}" for one in point)
            raise CaseError(f"no flat face of its body holds the point ({named}) of an outlet")
        open_faces.update(faces)
    for tag in open_faces:
        if len(gmsh.model.occ.getCurveLoops(tag)[0]) > 1:
            where = ", ".join(f"{round(one, 9) + 0.0:.6g}" for one in gmsh.model.occ.getCenterOfMass(2, tag))
            raise CaseError(
                f"the face about ({where}) m, where its body is opened, has a hole in it: give the space inside the "
                "vessel as the body, not its walls; what stands in it ends below the inlet and above the outlets"
            )
    gmsh.option.setNumber("Mesh.MeshSizeMax", size / _PIECES)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", _PER_TURN)
    gmsh.model.mesh.generate(2)
    tags, points, _ = gmsh.model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, dtype=int)
    place[tags] = np.arange(len(tags))
    corners: list[list[int]] = []
    for dimension, tag in gmsh.model.getEntities(2):
        if tag not in open_faces:
            _, _, nodes = gmsh.model.mesh.getElements(dimension, tag)
            corners += [row for one in nodes for row in place[one.reshape(-1, 3)].tolist()]
    return {"points": points.tolist(), "corners": corners}


def _holds(gmsh: Any, face: int, point: Sequence[float], slack: float) -> bool:
    """Whether a face is flat and a point lies in it."""
    if gmsh.model.getType(2, face) != "Plane":
        return False
    nearest, _ = gmsh.model.getClosestPoint(2, face, list(point))
    return bool(np.linalg.norm(np.array(nearest) - point) <= slack and gmsh.model.isInside(2, face, list(nearest)))


def _box(gmsh: Any) -> tuple[Points, Points]:
    box = np.array(gmsh.model.getBoundingBox(-1, -1))
    return box[:3], box[3:]


def _face(gmsh: Any, sagitta: float | None, up: str) -> list[Line]:
    """The boundary of faces that lie in a coordinate plane."""
    faces = gmsh.model.getEntities(2)
    low, high = _box(gmsh)
    size = float((high - low).max())
    flat = [axis for axis in range(3) if high[axis] - low[axis] < 1e-6 * size]
    if not faces or len(flat) != 1:
        raise CaseError("holds neither a body nor a face in a coordinate plane: export the inside of the vessel as one")
    plane = [axis for axis in range(3) if axis != flat[0]]
    vertical = "xyz".index(up.lstrip("-")) if up else plane[1]
    if vertical not in plane:
        raise CaseError(f"its face lies across {up}, which cannot point up", ("outline", "up"))
    across = next(axis for axis in plane if axis != vertical)
    sign = -1.0 if up.startswith("-") else 1.0
    return _curves(gmsh, faces, np.eye(3)[across], sign * np.eye(3)[vertical], np.zeros(3), sagitta or 1e-4 * size)


def _cut(gmsh: Any, bodies: Sequence[tuple[int, int]], sagitta: float | None, up: str) -> list[Line]:
    """The boundary of the cut through bodies, by the first axis of which they are bodies of revolution."""
    low, high = _box(gmsh)
    size, centre = float((high - low).max()), 0.5 * (low + high)
    volume = sum(gmsh.model.occ.getMass(*body) for body in bodies)
    found = []
    for name in [up.lstrip("-")] if up else _AXES:
        vertical = np.eye(3)["xyz".index(name)]
        across = np.roll(vertical, 1)
        origin = centre * (1 - vertical)
        corners = [(a, h) for a, h in ((0.0, -1), (1.0, -1), (1.0, 1), (0.0, 1))]
        points = [
            gmsh.model.occ.addPoint(*(origin + 2 * size * a * across + (centre @ vertical + 2 * size * h) * vertical))
            for a, h in corners
        ]
        edges = [gmsh.model.occ.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        plane = gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(edges)])
        faces, _ = gmsh.model.occ.intersect(list(bodies), [(2, plane)], removeObject=False, removeTool=True)
        gmsh.model.occ.synchronize()
        faces = [face for face in faces if face[0] == 2]
        turned = sum(
            2
            * np.pi
            * gmsh.model.occ.getMass(*face)
            * float((np.array(gmsh.model.occ.getCenterOfMass(*face)) - origin) @ across)
            for face in faces
        )  # Pappus
        if faces and abs(turned / volume - 1) <= _SAME_VOLUME:
            sign = -1.0 if up.startswith("-") else 1.0
            return _curves(gmsh, faces, across, sign * vertical, origin, sagitta or 1e-4 * size)
        found.append(f"about {name} its section turns to {turned:.4g} m³")
    raise CaseError(f"its body of {volume:.4g} m³ is not one of revolution: {', '.join(found)}")


def _curves(
    gmsh: Any, faces: Sequence[tuple[int, int]], across: Points, vertical: Points, origin: Points, sagitta: float
) -> list[Line]:
    """The boundary of faces in one plane, each curve flattened."""
    frame = np.stack([across, vertical], axis=1)
    return [
        Line((_flattened(gmsh, tag, sagitta) - origin) @ frame)
        for _, tag in gmsh.model.getBoundary(list(faces), combined=True, oriented=False)
    ]


def _flattened(gmsh: Any, curve: int, sagitta: float) -> Points:
    """(n, 3) points on a curve, so many that no chord lies farther off it than the sagitta."""
    low, high = (float(ends[0]) for ends in gmsh.model.getParametrizationBounds(1, curve))
    pieces = 1
    while True:
        at = np.linspace(low, high, 2 * pieces + 1)
        points = np.array(gmsh.model.getValue(1, curve, at)).reshape(-1, 3)
        off = np.linalg.norm(points[1::2] - 0.5 * (points[:-1:2] + points[2::2]), axis=1).max()
        if (off <= sagitta and (pieces > 1 or _straight(gmsh, curve))) or pieces >= _MOST_POINTS:
            return points[::2]
        pieces *= 2


def _straight(gmsh: Any, curve: int) -> bool:
    return bool(gmsh.model.getType(1, curve) == "Line")


if __name__ == "__main__":
    _limit_time(sys.argv[1])
    _answer(sys.argv[1])
