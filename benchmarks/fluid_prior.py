"""The frictional fluid as a prior of a short DEM run: what it would bring. Prints two tables of Markdown.

`--runs`: folders of productions of `cases/reactor.yaml` (``produce-…`` in a store, as `benchmarks/levers.py run` leaves
them). The first segments of each that are averaged are a short run; all others together are the truth. Compared are
the ψ fit as it is; one that smooths only the difference from the fluid, by the length that predicts left-out blocks
best; one that is also drawn to the fluid, each face by the weight of both errors, times a factor found the same way;
and the mean of run and fluid with the best weight, which only the truth can tell. μ_i, μ_w and the angle are those, of
eight, that are nearest to the run itself.

`--set-back`: results of `benchmarks/set_back.py run`. Runs with enlarged particles are corrected by the fluid's own
dependence on size: plus the fluid at the material's size, less the fluid at the simulated one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu
from set_back import AS_DRAWN, VESSELS, Fields, field_name, folder_of

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case, varied
from granpipe.case.schema import Case
from granpipe.errors import DataError, GranpipeError
from granpipe.field import Array, Field, flux_from_psi, level_flow
from granpipe.fluid.friction_law import LENGTH
from granpipe.homogenize import psi_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.psi_fit import NormalEquations, node_roles
from granpipe.homogenize.smooth import flowing_faces
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, flux_errors
from granpipe.pipeline import frictional_field
from granpipe.pipeline.averages import averaged_field, reference_plug, steady_segments
from granpipe.pipeline.frictional_field import solve_plan
from granpipe.pipeline.production import load_sums
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan

HERE = Path(__file__).resolve().parent
TRIED = tuple(product((0.49, 0.56), (0.32, 0.42), (33.5, 46.0)))
"""μ_i, μ_w and the angle of surfaces [°]."""

SMOOTHING = (0.1, 0.3, 0.6)
DRAWN = (0.0, 0.03, 0.3)
"""Weight of the fluid, over what its error and that of the average give."""

REACH = 3.0
"""Particle diameters over which the error of the fluid is averaged."""

LENGTHS = (10, 14, 23)
"""Segments averaged."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", nargs="*", type=Path, default=[])
    parser.add_argument("--tested", nargs="*", type=int, default=[1, 2], help="which of the runs are cut short")
    parser.add_argument("--set-back", type=Path)
    options = parser.parse_args()
    if options.runs:
        print("| run | segments | ψ fit | of the difference | drawn to the fluid | best mean (weight) | fluid |")
        print("|---" * 7 + "|")
        for line in short_runs(options.runs, options.tested):
            print(line, flush=True)
    if options.set_back:
        print("\n| vessel | k | run | corrected | fluid at d |\n|---|---|---|---|---|")
        for name, vessel in VESSELS.items():
            for factor in (one for one in vessel.speeds if one > 1):
                print(corrected(name, factor, options.set_back), flush=True)


def short_runs(folders: list[Path], tested: list[int]) -> Iterator[str]:
    case = read_case(HERE.parent / "cases" / "reactor.yaml", {"dem.ranks": "1"}).case
    plan = make_plan(case, 1)
    diameter, levels = plan.dem.classes.sauter_diameter, case.outline.levels
    chains = [
        steady_segments([load_sums(path, number) for path in sorted(folder.glob("segment-*"))], plan)
        for number, folder in enumerate(folders)
    ]
    fluids = reactor_fluids(case, plan)
    for number in tested:
        rest = [sums for i, chain in enumerate(chains) if i != number for sums in chain]
        truth = averaged_field(case, plan.outline, rest, diameter)
        noise = truth.figures["statistical_error"]["whole"]

        def wrong(field: Field, truth: Field = truth.field, noise: float = noise) -> float:
            whole, *_ = compare(*(replace(one, flux_r_se=None, flux_z_se=None) for one in (truth, field)), {}, diameter)
            return float(np.sqrt(max(whole.observed**2 - noise**2, 0.0)))

        for count in LENGTHS:
            try:
                short = Short(case, plan, chains[number][:count], diameter)
                plain = averaged_field(case, plan.outline, short.segments, diameter)
            except DataError as error:
                yield f"| {number} | {count} | {str(error)[:60]} | | | | |"
                continue
            own = {key: compare(plain.field, one, levels, diameter)[0].observed for key, one in fluids.items()}
            fluid = fluids[min(own, key=own.__getitem__)]
            smoothed = min((Fit(short, fluid, length, 0.0) for length in SMOOTHING), key=lambda fit: fit.misfit())
            drawn = min((Fit(short, fluid, *one) for one in product(SMOOTHING, DRAWN)), key=lambda fit: fit.misfit())
            means = {weight: wrong(short.mean(plain.field, fluid, weight)) for weight in np.arange(0, 0.55, 0.05)}
            best = min(means, key=means.__getitem__)
            cells = [f"{100 * wrong(one):.1f} %" for one in (plain.field, smoothed.field(), drawn.field())]
            cells += [f"{100 * means[best]:.1f} % ({best:.2f})", f"{100 * wrong(fluid):.1f} %"]
            yield f"| {number} | {count} | {' | '.join(cells)} |"


def reactor_fluids(case: Case, plan: Plan) -> dict[tuple[float, float, float], Field]:
    """The fluids to choose from, at the simulated size and as they are before the layers along walls."""
    changes = {"model": "fluid", "fluid.rheology": "frictional", "material.bulk_density": "600 kg/m^3"}
    asked = make_plan(varied(case, changes | {"homogenize.cell": repr(float(plan.grid.cell))}), 1)
    law, found = bulk_friction(case), {}
    for internal, wall, angle in TRIED:
        friction = replace(law, internal=internal, wall=wall, repose=np.radians(angle))
        found[internal, wall, angle] = fluid_of(asked, friction, case.dem.coarse_grain_factor, packed=False)
    return found


def fluid_of(plan: Plan, friction, factor: float, packed: bool = True) -> Field:  # type: ignore[no-untyped-def]
    """The fluid with particles enlarged by a factor: its length is that of theirs."""
    with patch.object(frictional_field, "LENGTH", LENGTH * factor):
        if packed:
            own = frictional_field.packed_along_walls
            with patch.object(frictional_field, "packed_along_walls", lambda f, s, d, m: own(f, s, factor * d, m)):
                return solve_plan(plan, friction, 0.6).field
        with patch.object(frictional_field, "packed_along_walls", lambda field, *rest: field):
            return solve_plan(plan, friction, 0.6).field


@dataclass
class Short:
    """A short run: its average, plug, weights and blocks, as the ψ fit sees them."""

    case: Case
    plan: Plan
    segments: list[Sums]
    diameter: float

    def __post_init__(self) -> None:
        self.sums = merge(self.segments)
        self.grid = self.sums.grid
        inside = self.plan.outline.inside_fraction(self.grid)
        packing = self.case.material.packing
        self.plug = reference_plug(self.case, self.plan.outline, self.sums, inside, self.diameter, packing)
        self.raw = averaged_field(self.case, self.plan.outline, self.segments, self.diameter).field
        parts = blocks(self.segments)
        run = np.array([block.run for block in parts])
        se, _ = flux_errors([block.mean_flux for block in parts], run, self.grid, self.diameter)
        self.faces = flowing_faces(self.raw.bulk, inside)
        self.weights = psi_field._weights(se, self.faces, self.grid, self.diameter)
        self.steady = psi_field._Steady(self.sums, self.plug)
        self.blocks = [self.steady.data(one) for one in blocks(self.segments, LEAST_BLOCKS)]
        self.equations = NormalEquations(
            self.grid, node_roles(inside, self.raw.bulk), self.weights, psi_field.CLEARANCE * self.diameter
        )

    def fluxes(self, fluid: Field) -> tuple[Array, Array]:
        """Of the fluid, for the flow of the run."""
        share = self.plug.solids_flow / float(np.median(level_flow(fluid.flux_z, fluid.grid)))
        return share * fluid.flux_r, share * fluid.flux_z

    def mean(self, field: Field, fluid: Field, weight: float) -> Field:
        r, z = self.fluxes(fluid)
        return replace(
            field, flux_r=(1 - weight) * field.flux_r + weight * r, flux_z=(1 - weight) * field.flux_z + weight * z
        )


class Fit:
    """ψ that is near to the average, whose difference from the fluid is smooth and, where drawn, small."""

    def __init__(self, short: Short, fluid: Field, length: float, drawn: float) -> None:
        self.short, equations = short, short.equations
        self.expand, self.wall = equations.unknowns
        prior = [one / short.plug.solids_flow for one in short.fluxes(fluid)]
        assert fluid.psi is not None
        psi = fluid.psi / -(fluid.psi[:, -1:] * short.grid.measure.turn)  # −1/turn on the wall
        share = (length * short.diameter / short.grid.cell) ** 4
        matrix = equations._data_part + share * equations._smooth_part
        self.told = share * (equations._smooth_part @ psi.ravel())
        if drawn > 0:
            for data, weight, one in zip(equations.data, self._prior_weights(prior), prior, strict=True):
                own = (short.weights.r if one.shape == short.weights.r.shape else short.weights.z).ravel()
                part = data @ sparse.diags_array(drawn * weight.ravel() / own)
                operator = (data @ sparse.diags_array(1 / own)).T
                matrix = matrix + part @ operator
                self.told = self.told + part @ one.ravel()
        self.matrix = sparse.csr_matrix(matrix)
        self.factor = splu(
            sparse.csc_matrix(self.expand.T @ self.matrix @ self.expand),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0,
            options={"SymmetricMode": True},
        )

    def _prior_weights(self, prior: list[Array]) -> Iterator[Array]:
        """1/t², t² the squared difference of average and fluid, less noise, around each face."""
        short = self.short
        flux, flow, reach = short.steady.flux(short.sums), short.plug.solids_flow, REACH * short.diameter
        own = (short.weights.r, short.weights.z)
        for mean, one, weight, faces in zip(flux, prior, own, short.faces, strict=True):
            apart = np.where(faces, (mean - flow * one) ** 2 - 1 / weight, 0.0)
            seen, counted = (ndimage.gaussian_filter(x, reach / short.grid.cell) for x in (apart, faces.astype(float)))
            yield 1 / np.maximum(seen / np.maximum(counted, 1e-6), 0.05 * apart[faces].mean())

    def solve(self, flux: tuple[Array, Array], flow: float) -> tuple[Array, Array]:
        wall = -flow / self.short.grid.measure.turn
        told = sum(data @ one.ravel() for data, one in zip(self.short.equations.data, flux, strict=True))
        load = self.expand.T @ (told + flow * self.told - wall * (self.matrix @ self.wall))
        psi = (self.expand @ self.factor.solve(load) + wall * self.wall).reshape(self.short.equations.shape)
        return flux_from_psi(psi, self.short.grid)

    def field(self) -> Field:
        r, z = self.solve(self.short.steady.flux(self.short.sums), self.short.plug.solids_flow)
        return replace(self.short.raw, flux_r=r, flux_z=z)

    def misfit(self) -> float:
        """Weighted squares of what each block holds less what the fit to all others says."""
        many, weights = self.short.blocks, self.short.weights
        count, total = len(many), 0.0
        for flux, flow in many:
            rest = tuple((sum(one[axis] for one, _ in many) - flux[axis]) / (count - 1) for axis in (0, 1))
            told = self.solve(rest, (sum(one for _, one in many) - flow) / (count - 1))
            total += float((weights.r * (told[0] - flux[0]) ** 2).sum() + (weights.z * (told[1] - flux[1]) ** 2).sum())
        return total


def corrected(name: str, factor: float, results: Path) -> str:
    """A line: error of the run with enlarged particles, as it is and corrected, and of the fluid."""
    fields = Fields(name, results)
    case = fields.vessel.case(results / f"{name}-drawn", 1.0)
    changes = {"model": "fluid", "fluid.rheology": "frictional", "material.bulk_density": "1500 kg/m^3"}
    try:
        run = Field.load(folder_of(results, name, factor, AS_DRAWN) / field_name(range(fields.vessel.seeds[factor])))
        plan = replace(make_plan(varied(case, changes), 1), grid=run.grid)
        fluids = [fluid_of(plan, bulk_friction(case), one) for one in (1.0, factor)]
    except GranpipeError as error:
        return f"| {name} | {factor:g} | no field | | {str(error).split(':')[-1]} |"
    flow = level_flow(run.flux_z, run.grid).mean()
    own, large = ([flow / level_flow(f.flux_z, f.grid).mean() * x for x in (f.flux_r, f.flux_z)] for f in fluids)
    made = replace(run, flux_r=run.flux_r + own[0] - large[0], flux_z=run.flux_z + own[1] - large[1])
    told = [fields.errors(one, factor)["whole"].noise_free for one in (run, made)]
    told.append(fields.errors(replace(fluids[0], flux_r_se=None, flux_z_se=None), 1.0)["whole"].noise_free)
    return f"| {name} | {factor:g} | " + " | ".join(f"{100 * one:.1f} %" for one in told) + " |"


if __name__ == "__main__":
    main()
