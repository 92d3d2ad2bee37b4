"""Solve the moving-wall hopper with NGSolve; prints results as JSON. Runs in an environment of its own.

Argument: a JSON file with the ``.npz`` meshes (points, triangles, edges, names), the orders, sample points and
repetitions. The forms are those of granpipe. Boundary values are either NGSolve's own (`Set` of the wall's law) or
those that granpipe has at order+1 places of every edge (``given_<order>``), so that solver and data can be told apart.
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


HELD = "inlet|wall:a|wall:b|wall:c"


def own_values(mesh, radial, vertical):
    """Boundary values as `Set` makes them of the law."""
    wall, slope = -1 / (pi * x * x), 0.5
    w_on = {"inlet": -1 / pi, "wall:a": wall, "wall:b": 2 / 3 * wall, "wall:c": wall}
    u_on = {"wall:b": 2 / 3 * slope * wall}
    u, w = GridFunction(radial), GridFunction(vertical)
    u.Set(mesh.BoundaryCF(u_on, default=0), definedon=mesh.Boundaries(f"{HELD}|axis"))
    w.Set(mesh.BoundaryCF(w_on, default=0), definedon=mesh.Boundaries(HELD))
    return u, w


def given_values(mesh, space, data, order: int, part: int):
    """The polynomial along each held edge that has granpipe's values at order+1 equally spaced places.

    Vertex unknowns are the values there; those of an edge follow from the values at its inner places.
    """
    values, ends = data[f"given_{order}"][..., part], data["points"][data["edges"]]
    held = np.isin(data["names"], HELD.split("|"))
    found, trial = GridFunction(space), GridFunction(space)
    for (a, b), line in zip(data["edges"][held], values[held], strict=True):
        for vertex, value in ((a, line[0]), (b, line[-1])):
            found.vec[space.GetDofNrs(ngsolve.NodeId(ngsolve.VERTEX, int(vertex)))[0]] = value
    edge_of = {frozenset(v.nr for v in edge.vertices): edge for edge in mesh.edges}
    for (a, b), line, (start, end) in zip(data["edges"][held], values[held], ends[held], strict=True):
        dofs = space.GetDofNrs(edge_of[frozenset((int(a), int(b)))])
        at = [mesh(*(start + (end - start) * i / order)) for i in range(1, order)]
        missing = line[1:-1] - [found(point) for point in at]
        shapes = np.empty((order - 1, order - 1))
        for column, dof in enumerate(dofs):
            trial.vec[dof] = 1
            shapes[:, column] = [trial(point) for point in at]
            trial.vec[dof] = 0
        for dof, value in zip(dofs, np.linalg.solve(shapes, missing), strict=True):
            found.vec[dof] = value
    return found


def leak(mesh, u, w) -> float:
    """Flow through the walls, edge by edge without sign, over the whole flow of 1."""
    normal = ngsolve.specialcf.normal(2)
    through = (u * normal[0] + w * normal[1]) * 2 * pi * x
    region = mesh.Boundaries("wall:a|wall:b|wall:c")
    edges = ngsolve.Integrate(through, mesh, ngsolve.BND, definedon=region, element_wise=True, order=12)
    return float(np.abs(np.array(edges)).sum())


def solve(mesh, order: int, inverse: str, values):
    radial = H1(mesh, order=order, dirichlet=f"{HELD}|axis")
    vertical, pressure = H1(mesh, order=order, dirichlet=HELD), H1(mesh, order=order - 1)
    space = radial * vertical * pressure
    (u, w, p), (f, g, q) = space.TnT()
    form = BilinearForm(space, symmetric=True)
    momentum = x * (grad(u) * grad(f) + grad(w) * grad(g)) + u * f / x
    flow = -p * (x * grad(f)[0] + f + x * grad(g)[1]) - q * (x * grad(u)[0] + u + x * grad(w)[1])
    form += (momentum + flow - SHIFT * x * p * q) * dx(bonus_intorder=2)
    form.Assemble()
    result = GridFunction(space)
    for component, value in zip(result.components, values(radial, vertical), strict=False):
        component.vec.data = value.vec
    factors = form.mat.Inverse(space.FreeDofs(), inverse=inverse)
    for _ in range(2):
        result.vec.data -= factors @ form.mat * result.vec
    return result, space


task = json.loads(Path(sys.argv[1]).read_text())
rows = []
for name in task["meshes"]:
    data = np.load(name)
    mesh = build(data)
    at = [mesh(r, z) for r, z in task["points"]]
    for order in task["orders"]:
        fixed = [given_values(mesh, H1(mesh, order=order), data, order, part) for part in (0, 1)]
        row = {"mesh": name, "order": order, "seconds": {}}
        for inverse in SOLVERS:
            times = []
            for _ in range(task["repetitions"]):
                begun = time.process_time()
                same, space = solve(mesh, order, inverse, lambda u, w, fixed=fixed: fixed)
                times.append(time.process_time() - begun)
            row["seconds"][inverse] = min(times)
        own, _ = solve(mesh, order, SOLVERS[0], lambda u, w, mesh=mesh: own_values(mesh, u, w))
        row["unknowns"] = sum(space.FreeDofs())
        for kind, result in (("same", same), ("own", own)):
            row[kind] = [[part(point) for point in at] for part in result.components[:2]]
            row[f"{kind}_leak"] = leak(mesh, *result.components[:2])
        rows.append(row)
print(json.dumps({"version": ngsolve.__version__, "rows": rows}))
