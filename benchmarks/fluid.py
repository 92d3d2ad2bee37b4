"""The fictitious fluid beside NGSolve: error against time, for orders 2–4 on graded and even meshes, in one run.

Writes docs/validation/benchmarks_fluid.md. NGSolve lives in an environment of its own, made on first use under
~/.cache/granpipe/benchmarks and kept.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from run import HERE, PEERS, machine, peer

from granpipe.fluid.constraints import constrain
from granpipe.fluid.elements import Space
from granpipe.fluid.stokes import StokesSolution, solve_stokes
from granpipe.fluid.stream import nearest_stream_function
from granpipe.fluid.wall_speed import WallLaw, boundary_data
from granpipe.geometry.section import mesh_section
from granpipe.rzmesh import RZMesh

PEERS["ngsolve"] = ["ngsolve", "numpy"]
HOPPER = np.array([[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4]])
SECTIONS = {"a": (5.9, 4.9), "b": (4.9, 3.9), "c": (3.9, 3.4)}
MESHES = {"graded": (10, [6, 10, 20]), "graded finer": (100, [10]), "even": (1, [20, 40, 80])}
ORDERS = [2, 3, 4]


class Row(NamedTuple):
    mesh: str
    cells: int
    order: int
    unknowns: int
    error: float
    seconds: float
    clean_up: float
    peer_unknowns: int
    peer_error: float
    peer_own_error: float
    peer_leak: float
    peer_seconds: dict[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "benchmarks_fluid.md")
    options = parser.parse_args()
    points = samples()
    meshes = {
        (name, cells): mesh_section(HOPPER, {}, SECTIONS, cells_across=cells, corner_refinement=refinement)
        for name, (refinement, counts) in MESHES.items()
        for cells in counts
    }
    fine = mesh_section(HOPPER, {}, SECTIONS, cells_across=30, corner_refinement=1000)
    with tempfile.TemporaryDirectory() as folder:
        theirs = ngsolve(Path(folder), list(meshes.values()), fine, points, options.repetitions)
    reference = velocity(solve_stokes(fine, data(fine, 4)), points)
    last = theirs["rows"].pop()
    apart = difference(np.array(last["same"]), reference), difference(np.array(last["own"]), reference)
    rows, results = [], iter(theirs["rows"])
    for (name, cells), mesh in meshes.items():
        for order in ORDERS:
            their = next(results)
            solution, seconds, clean_up = timed(mesh, order, options.repetitions)
            error = difference(velocity(solution, points), reference)
            errors = [difference(np.array(their[kind]), reference) for kind in ("same", "own")]
            ours = (name, cells, order, solution.unknowns, error, seconds, clean_up)
            rows.append(Row(*ours, their["unknowns"], *errors, their["own_leak"], their["seconds"]))
    text = page(rows, apart, theirs["version"], options.repetitions)
    options.out.write_text(text)
    print(text)


def samples() -> np.ndarray:
    """(n, 2) points farther than 0.1 m from the wall's corners and 0.03 m from the wall."""
    r, z = (part.ravel() for part in np.meshgrid(np.arange(0.0125, 1, 0.025), np.arange(3.4125, 5.9, 0.025)))
    far = r < np.interp(z, HOPPER[::-1, 1], HOPPER[::-1, 0]) - 0.03
    for corner in HOPPER[1:3]:
        far &= np.hypot(r - corner[0], z - corner[1]) > 0.1
    return np.column_stack([r, z])[far]


def data(mesh: RZMesh, order: int):
    return boundary_data(mesh, WallLaw(), 1.0, np.arange(order + 1) / order)


def given(mesh: RZMesh, order: int) -> np.ndarray:
    """(k, order+1, 2) granpipe's boundary values along every edge."""
    space = Space.on(mesh, order, 2 * order + 1)
    return np.stack(np.split(constrain(space, data(mesh, order)).given, 2), axis=1)[space.edge_nodes]


def timed(mesh: RZMesh, order: int, repetitions: int) -> tuple[StokesSolution, float, float]:
    """The solution, the best time of set-up, assembly and solution, and that of the stream-function clean-up [s]."""
    solving, cleaning = [], []
    for _ in range(repetitions):
        begun = time.process_time()
        held = data(mesh, order)
        solution = solve_stokes(mesh, held)
        between = time.process_time()
        nearest_stream_function(solution, held)
        solving.append(between - begun)
        cleaning.append(time.process_time() - between)
    return solution, min(solving), min(cleaning)


def velocity(solution: StokesSolution, points: np.ndarray) -> np.ndarray:
    """(2, n) u and w at points."""
    probes = solution.space.basis.probes(np.ascontiguousarray(points.T))
    return np.stack([probes @ solution.u, probes @ solution.w])


def difference(found: np.ndarray, reference: np.ndarray) -> float:
    """RMS difference over the RMS velocity."""
    return float(np.linalg.norm(found - reference) / np.linalg.norm(reference))


def ngsolve(folder: Path, meshes: list[RZMesh], fine: RZMesh, points: np.ndarray, repetitions: int) -> dict:
    """What NGSolve finds on the same meshes, and in the last row order 4 on the fine one."""
    for number, mesh in enumerate([*meshes, fine]):
        own = {name: getattr(mesh, name) for name in mesh.__dataclass_fields__}
        np.savez(folder / f"{number}", **own, **{f"given_{order}": given(mesh, order) for order in ORDERS})
    names = [str(folder / f"{number}.npz") for number in range(len(meshes) + 1)]
    task = {"points": points.tolist(), "repetitions": repetitions}
    found = []
    for part, orders in ((names[:-1], ORDERS), (names[-1:], [4])):
        (folder / "task.json").write_text(json.dumps(task | {"meshes": part, "orders": orders}))
        found.append(peer("ngsolve", "peer_ngsolve.py", folder / "task.json"))
    return found[0] | {"rows": found[0]["rows"] + found[1]["rows"]}


def equal_error(rows: list[Row], target: float, taken: float) -> str:
    """What granpipe needs for an error that NGSolve reached in `taken` seconds."""
    best = min((row for row in rows if row.error <= target), key=lambda row: row.seconds + row.clean_up)
    total = best.seconds + best.clean_up
    return (
        f"{target:.1e} in {taken:.2f} s; granpipe is not above that with order {best.order}, {best.mesh}, {best.cells} "
        f"cells in {total:.2f} s, clean-up included: {taken / total:.1f} times faster"
    )


def page(rows: list[Row], apart: tuple[float, float], version: str, repetitions: int) -> str:
    """The table as Markdown."""
    even = [row for row in rows if row.mesh == "even" and row.order == 2]
    same, own = min(even, key=lambda row: row.peer_error), min(even, key=lambda row: row.peer_own_error)
    ratios = [min(row.peer_seconds.values()) / row.seconds for row in rows]
    lines = [
        "# The fictitious fluid beside NGSolve",
        "",
        f"Made by `benchmarks/fluid.py` on {datetime.now(UTC):%Y-%m-%d}: {machine()}, NGSolve {version}.",
        "The hopper of `cases/hopper.yaml` on the same meshes, with Taylor–Hood elements of the same order; CPU",
        f"seconds of one thread for spaces, assembly, factorisation and refinement, best of {repetitions}. The",
        "error is the RMS difference from granpipe's order 4 on a mesh graded to a thousandth, at points 0.1 m from",
        "the corners and more, over the RMS velocity. granpipe's velocity is that before the stream-function",
        "clean-up, whose time stands beside.",
        "",
        "NGSolve was run with two kinds of boundary values. *Same*: granpipe's, so that solvers are compared; its",
        "times are from these runs. *Own*: its `Set` of the wall's law, which lets through the walls what `leak` says,",
        "as a part of the whole flow. On the reference's mesh NGSolve's order 4 differs from granpipe's by",
        f"{apart[0]:.1e} with the same and {apart[1]:.1e} with its own values.",
        "",
        "| mesh | cells across | order | unknowns | granpipe: error | time [s] | clean-up [s] | NGSolve, same: error |"
        " sparsecholesky [s] | umfpack [s] | time, NGSolve / granpipe | own: error | leak |",
        "|" + "---|" * 13,
    ]
    for row, ratio in zip(rows, ratios, strict=True):
        lines.append(
            f"| {row.mesh} | {row.cells} | {row.order} | {row.unknowns} | {row.error:.1e} | {row.seconds:.3f} "
            f"| {row.clean_up:.3f} | {row.peer_error:.1e} | {row.peer_seconds['sparsecholesky']:.3f} "
            f"| {row.peer_seconds['umfpack']:.3f} | {ratio:.2f} | {row.peer_own_error:.1e} | {row.peer_leak:.1e} |"
        )
    by_order = ", ".join(
        f"order {order}: {min(part):.2f}–{max(part):.2f}"
        for order in ORDERS
        if (part := [ratio for row, ratio in zip(rows, ratios, strict=True) if row.order == order])
    )
    return "\n".join(
        [
            *lines,
            "",
            f"On the same mesh, NGSolve's time over granpipe's: {by_order}",
            "(below 1: NGSolve is faster). The ratio of one row changes by tens of per cent from run to run on a",
            "machine with other work.",
            "",
            "At equal error, NGSolve with order 2 on even meshes:",
            "",
            f"- same boundary values: {equal_error(rows, same.peer_error, min(same.peer_seconds.values()))};",
            f"- own boundary values: {equal_error(rows, own.peer_own_error, min(own.peer_seconds.values()))}.",
            "  This one measures the boundary values more than the solver.",
            "",
        ]
    )


if __name__ == "__main__":
    main()
