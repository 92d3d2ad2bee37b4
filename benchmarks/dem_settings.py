"""What softening and plate speed do to a field: the same scene at five stiffnesses and at three speeds.

Writes docs/validation/dem_settings.md. Every run is an ordinary granpipe run: interrupted, it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
from run import machine

from granpipe.analysis.compare import Difference, compare
from granpipe.case.reader import CaseFile, read_case, varied
from granpipe.case.schema import Case
from granpipe.field import Field
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.progress import Silent

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "cases" / "smoke.yaml"
MODULI = ("auto", "5e6", "1e7", "5e7", "1e9")
SPEEDS = (0.5, 1.0, 2.0)
SOFTENING_SPEED = 2.0
"""Plate speed over the automatic one at which stiffnesses are compared: a thousand megapascals take small steps."""
START = 0.06
"""Plate travel before the average begins [m]: three diameters."""


@dataclass(frozen=True)
class Run:
    """A finished run."""

    field: Field
    figures: Mapping[str, object]

    @property
    def seconds(self) -> float:
        return float(sum(self.figures["produce_wall_seconds"]))  # type: ignore[call-overload]

    @property
    def error(self) -> float:
        return float(self.figures["statistical_error"]["whole"])  # type: ignore[index]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=ROOT / "results" / "dem_settings")
    parser.add_argument("--stiffness-travel", type=float, default=0.15, help="averaged plate travel [m]")
    parser.add_argument("--stiffest-travel", type=float, default=0.08, help="the same, of the stiffest [m]")
    parser.add_argument("--speed-travel", type=float, default=0.35, help="averaged plate travel [m]")
    options = parser.parse_args()
    base = read_case(SCENE, {"dem.ranks": "1", "figures": "[]", "export": "[]"})
    speed = make_plan(base.case).dem.plate_speed
    fast = {
        factor: run(options.results, base, f"speed-{100 * factor:.0f}", factor * speed, options.speed_travel, "auto")
        for factor in SPEEDS
    }
    travels = [options.stiffness_travel] * (len(MODULI) - 1) + [options.stiffest_travel]
    soft = {
        modulus: run(options.results, base, f"modulus-{modulus}", SOFTENING_SPEED * speed, travel, modulus)
        for modulus, travel in zip(MODULI, travels, strict=True)
    }
    lines = [*head(options), *softening(base.case, soft), *plate_speed(base.case, speed, fast)]
    (ROOT / "docs" / "validation" / "dem_settings.md").write_text("\n".join(lines) + "\n")


def run(results: Path, base: CaseFile, name: str, speed: float, travel: float, modulus: str) -> Run:
    """Run the scene at a plate speed [m/s], averaged over a plate travel [m]."""
    changes = {
        "name": name,
        "contact.youngs_modulus": modulus,
        "dem.plate_speed": repr(speed),
        "dem.max_time": repr((START + travel) / speed),
        "homogenize.start": repr(START / speed),
    }
    outcome = run_case(CaseFile(varied(base.case, changes), base.places), results, Silent())
    figures = json.loads((outcome.folder / "provenance.json").read_text())["figures"]
    print(name, f"{sum(figures['produce_wall_seconds']):.0f} s", figures["statistical_error"], flush=True)
    return Run(Field.load(outcome.folder / "field.npz"), figures)


def head(options: argparse.Namespace) -> Iterator[str]:
    yield "# What softening and plate speed do to the field"
    yield ""
    yield f"Written by `python benchmarks/dem_settings.py` on {date.today()}, {machine()}. The scene is"
    yield "`cases/smoke.yaml`: a shaft, a hopper, a throat 6 particles wide, and a widening with a free surface. The"
    yield "differences are those of `granpipe compare`: noise-free, in brackets the 95 % upper bound."
    yield ""


def softening(case: Case, runs: Mapping[str, Run]) -> Iterator[str]:
    """The field at each modulus against the stiffest."""
    stiffest = runs[MODULI[-1]]
    names = ["whole", *case.outline.sections]
    yield "## Softening"
    yield ""
    yield f"Fields at each Young's modulus against that at {MODULI[-1]} Pa, all at {SOFTENING_SPEED:g} times the"
    yield "automatic plate speed."
    yield ""
    yield (
        "| E [Pa] | mean / p99 overlap | time step [s] | production [s] | statistical error | "
        + " | ".join(names)
        + " |"
    )
    yield "|---|---|---|---|---|" + "---|" * len(names)
    for modulus, one in runs.items():
        overlap = one.figures["flowing_overlap"][0]  # type: ignore[index]
        cells = ["reference"] * len(names) if one is stiffest else differences(case, stiffest.field, one.field)
        label = f"{one.figures['youngs_modulus_pa']:.3g}" + (" (auto)" if modulus == "auto" else "")
        yield (
            f"| {label} | {overlap['mean']:.2%} / {overlap['p99']:.2%} | {one.figures['time_step_s']:.2g} "
            f"| {one.seconds:.0f} | {one.error:.1%} | " + " | ".join(cells) + " |"
        )
    yield ""


def differences(case: Case, one: Field, other: Field) -> list[str]:
    return [f"{d.noise_free:.1%} (< {d.upper:.1%})" for d in found(case, one, other)]


def found(case: Case, one: Field, other: Field) -> list[Difference]:
    return compare(one, other, case.outline.levels, make_plan(case).dem.classes.sauter_diameter)


def plate_speed(case: Case, speed: float, runs: Mapping[float, Run]) -> Iterator[str]:
    """The field at each speed against the field extrapolated to speed 0, with a straight line in every cell."""
    fields = [in_speeds(one.field) for one in runs.values()]
    names = ["whole", *case.outline.sections]
    yield "## Plate speed"
    yield ""
    yield f"`auto` is {1e3 * speed:.3g} mm/s here. Fields at equal plate travel, each against that at speed 0,"
    yield "which a straight line through the three gives in every cell."
    yield ""
    yield "| speed over auto | production [s] | statistical error | " + " | ".join(names) + " |"
    yield "|---|---|---|" + "---|" * len(names)
    for factor, one in runs.items():
        bias = [f"{d.noise_free:.1%} (< {d.upper:.1%})" for d in biases(case, factor, list(runs), fields)]
        yield f"| {factor:g} | {one.seconds:.0f} | {one.error:.1%} | " + " | ".join(bias) + " |"
    yield ""


def in_speeds(field: Field) -> Field:
    """The field with bulk velocities at the case's flow rate in place of solids fluxes."""
    scale = field.velocity_scale
    assert field.flux_r_se is not None
    assert field.flux_z_se is not None
    return replace(
        field,
        flux_r=field.flux_r * scale,
        flux_z=field.flux_z * scale,
        flux_r_se=field.flux_r_se * scale,
        flux_z_se=field.flux_z_se * scale,
        bulk_packing=1.0,
        flow_scale=1.0,
    )


def biases(case: Case, factor: float, factors: Sequence[float], fields: Sequence[Field]) -> list[Difference]:
    """What the slope of the straight line over the speeds makes at one of them, with the slope's own error."""
    away = np.array(factors) - np.mean(factors)
    weights = factor * away / (away @ away)
    middle = fields[len(fields) // 2]

    def combined(name: str) -> np.ndarray:
        return np.asarray(sum(w * getattr(field, name) for w, field in zip(weights, fields, strict=True)))

    def error(name: str) -> np.ndarray:
        return np.sqrt(sum((w * getattr(field, name)) ** 2 for w, field in zip(weights, fields, strict=True)))

    moved = replace(
        middle,
        flux_r=middle.flux_r + combined("flux_r"),
        flux_z=middle.flux_z + combined("flux_z"),
        flux_r_se=error("flux_r_se"),
        flux_z_se=error("flux_z_se"),
    )
    return found(case, replace(middle, flux_r_se=None, flux_z_se=None), moved)


if __name__ == "__main__":
    main()
