"""Solve the moving-wall hopper with NGSolve; prints results as JSON. Runs in an environment of its own.

Argument: a JSON file with the ``.npz`` meshes (points, triangles, edges, names), the orders, sample points and
repetitions. The forms are those of granpipe; wall speeds are set as NGSolve sets boundary values.
"""

import json
import sys
import time
from pathlib import Path

import ngsolve
import numpy as np
from netgen.csg import Pnt
from netgen.meshing import Element1D, Element2D, Mesh, MeshPoint
from ngsolve import H1, BilinearForm, GridFunction, dx, grad, pi, x

SOLVERS = ("sparsecholesky", "umfpack")
SHIFT = 1e-10


def build(data) -> ngsolve.Mesh:
    mesh = Mesh(dim=2)
    points = [mesh.Add(MeshPoint(Pnt(r, z, 0))) for r, z in data["points"]]
    inside = mesh.AddRegion("inside", dim=2)
    for triangle in data["triangles"]:
        mesh.Add(Element2D(inside, [points[i] for i in triangle]))
    regions = {name: mesh.AddRegion(name, dim=1) for name in np.unique(data["names"])}
    for (a, b), name in zip(data["edges"], data["names"], strict=True):
        mesh.Add(Element1D([points[a], points[b]], index=regions[name]))
    return ngsolve.Mesh(mesh)


def solve(mesh, order: int, inverse: str):
    wall, slope = -1 / (pi * x * x), 0.5
    w_on = {"inlet": -1 / pi, "wall:a": wall, "wall:b": 2 / 3 * wall, "wall:c": wall}
    u_on = {"wall:b": 2 / 3 * slope * wall}
    held = "inlet|wall:a|wall:b|wall:c"
    radial = H1(mesh, order=order, dirichlet=f"{held}|axis")
    vertical, pressure = H1(mesh, order=order, dirichlet=held), H1(mesh, order=order - 1)
    space = radial * vertical * pressure
    (u, w, p), (f, g, q) = space.TnT()
    form = BilinearForm(space, symmetric=True)
    momentum = x * (grad(u) * grad(f) + grad(w) * grad(g)) + u * f / x
    flow = -p * (x * grad(f)[0] + f + x * grad(g)[1]) - q * (x * grad(u)[0] + u + x * grad(w)[1])
    form += (momentum + flow - SHIFT * x * p * q) * dx(bonus_intorder=2)
    form.Assemble()
    result = GridFunction(space)
    result.components[0].Set(mesh.BoundaryCF(u_on, default=0), definedon=mesh.Boundaries(f"{held}|axis"))
    result.components[1].Set(mesh.BoundaryCF(w_on, default=0), definedon=mesh.Boundaries(held))
    factors = form.mat.Inverse(space.FreeDofs(), inverse=inverse)
    for _ in range(2):
        result.vec.data -= factors @ form.mat * result.vec
    return result, space


task = json.loads(Path(sys.argv[1]).read_text())
rows = []
for name in task["meshes"]:
    mesh = build(np.load(name))
    at = [mesh(r, z) for r, z in task["points"]]
    for order in task["orders"]:
        row = {"mesh": name, "order": order, "seconds": {}}
        for inverse in SOLVERS:
            times = []
            for _ in range(task["repetitions"]):
                begun = time.process_time()
                result, space = solve(mesh, order, inverse)
                times.append(time.process_time() - begun)
            row["seconds"][inverse] = min(times)
        row["unknowns"] = sum(space.FreeDofs())
        row["velocity"] = [[part(point) for point in at] for part in result.components[:2]]
        rows.append(row)
print(json.dumps({"version": ngsolve.__version__, "rows": rows}))
