"""A plan as text, for people."""

from __future__ import annotations

from collections.abc import Sequence

from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.errors import CaseError, GranpipeError
from granpipe.fluid.friction_error import expected_error
from granpipe.planning.forecast import forecast
from granpipe.planning.plan import Model, Plan
from granpipe.planning.scene import scene_of
from granpipe.progress import counted, duration_text
from granpipe.system.rates import Rates


def plan_text(
    plan: Plan, others: dict[Model, Plan | CaseError], fluid: tuple[str, Plan | CaseError], rates: Rates | None
) -> str:
    """All of a plan.

    Parameters
    ----------
    others : the plans of all models, to stand side by side
    fluid : the rheology that the case does not ask for, and the plan of a fluid with it
    rates : of this machine, where they are known
    """
    width = max(len(stage.name) for stage in (*plan.stages, *plan.left_out))
    lines = [f"{plan.case.name}: model {plan.model}", "", "stages"]
    lines += [f"  {stage.name:<{width}}  {stage.reason}" for stage in plan.stages]
    lines += ["", "left out"]
    lines += [f"  {stage.name:<{width}}  {stage.reason}" for stage in plan.left_out]
    cells = " × ".join(map(str, plan.grid.shape))
    lines += ["", f"grid  {cells} cells of {plan.grid.cell:.4g} m", ""]
    if plan.friction:
        lines += ["fluid", *_decision_lines(tuple(plan.friction.decisions())), ""]
    if plan.wall_factors:
        lines += ["fluid", *_decision_lines(plan.wall_factors), ""]
    for title, part in _dem_runs(plan):
        lines += _dem_lines(title, part)
    beside: list[tuple[str, Plan | CaseError]] = [*others.items()]
    beside[1:1] = [(f"fluid, {fluid[0]}", fluid[1])]
    width = max(len(name) for name, _ in beside)
    lines += ["the models side by side", *(_variant_line(f"{name:<{width}}", other, rates) for name, other in beside)]
    lines += [f"  times {_source(rates)}", ""]
    lines += [f"note: {warning}" for warning in plan.warnings]
    lines += [f"outside the range (a run ends with status 4): {breach}" for breach in plan.breaches]
    return "\n".join(lines)


def _dem_runs(plan: Plan) -> list[tuple[str, Plan]]:
    if plan.settings is not None:
        return [("DEM run", plan)]
    return [
        (f"DEM of {span.name}, z = {span.cut_bottom:g} … {span.cut_top:g} m", submodel)
        for span, submodel in plan.submodels
    ]


def _dem_lines(title: str, plan: Plan) -> list[str]:
    dem = plan.dem
    return [
        title,
        *_decision_lines(plan.decisions),
        f"  {dem.particles} particles in {len(dem.classes.radius)} size classes; {dem.steps} steps of "
        f"{dem.time_step:.3g} s: {dem.duration:.4g} s in {dem.segments} segments; {counted(dem.ranks, 'rank')}",
        *_length_lines(plan.case),
        "",
    ]


def _decision_lines(decisions: Sequence[Decision]) -> list[str]:
    width = max(len(decision.name) for decision in decisions)
    return [f"  {decision.name:<{width}}  {decision.value:<12} {decision.criterion}" for decision in decisions]


def _length_lines(case: Case) -> list[str]:
    lines = []
    if case.dem.replicas > 1:
        lines.append(
            f"  {case.dem.replicas} replicas, seeds {case.dem.seed} to {case.dem.seed + case.dem.replicas - 1}"
        )
    if (target := case.dem.statistical_error) is not None:
        lines.append(f"  ends sooner if the statistical error of every section is at most {100 * target:.3g} %")
    return lines


def _source(rates: Rates | None) -> str:
    if rates is None:
        return "as on the machine that granpipe is developed on; `granpipe calibrate` measures this one"
    return f"by the speed of this machine, as measured on {rates.made}"


def _variant_line(name: str, plan: Plan | CaseError, rates: Rates | None) -> str:
    if isinstance(plan, GranpipeError):
        return f"  {name} not possible: {plan}"
    time_text = duration_text(forecast(plan, rates))
    unfit = "; does not describe every section" if plan.unfit else ""
    error = f"; {_error_text(plan)}" if plan.model == "fluid" else ""
    runs = [part.dem for _, part in _dem_runs(plan)]
    particles = " + ".join(str(dem.particles) for dem in runs) or "no"
    return (
        f"  {name} {particles} particles, {plan.particle_steps:.3g} particle-steps, about {time_text}, "
        f"{plan.disk_bytes / 1e6:.3g} MB of disk at the most{unfit}{error}"
    )


def _error_text(plan: Plan) -> str:
    """What error is to be expected of a fluid, or why that is not known."""
    expected = expected_error(plan.case.fluid.rheology, scene_of(plan.case, plan.outline))
    return expected if isinstance(expected, str) else expected.text()
