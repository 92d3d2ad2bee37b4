"""What a search has found, for the user: text, YAML to paste, table, picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.repose.heap import Pair
from granpipe.repose.response import LEAST, MOST
from granpipe.repose.search import Found
from granpipe.system.surroundings import own_style

TABLE_STEP = 0.1
"""Sliding friction from one row of the printed table to the next."""


def found_text(found: Found) -> str:
    """The valley as a table, the recommended pair with its ranges, how well heaps and fit agree, the check."""
    given = f" ± {math.degrees(found.angle_error):.2g}°" if found.angle_error else ""
    best, response = found.best, found.response
    kept = "that of the case" if found.kept else "as near as possible to that of the case"
    slope = math.tan(found.angle)
    error = float(response.error(best.pair.friction, best.pair.rolling))
    return "\n".join(
        [
            f"equally good pairs for an angle of repose of {math.degrees(found.angle):.4g}°{given}:",
            "  friction   rolling_friction   95 % range",
            *(f"  {row}" for row in _rows(found)),
            "",
            f"recommended: friction {best.pair.friction:g} ({kept}), rolling_friction {best.pair.rolling:.3f}",
            "  95 % range of rolling_friction at this friction: "
            + _range(best.low, best.high, LEAST.rolling, MOST.rolling),
            "  95 % range of friction at this rolling_friction: "
            + _range(*found.frictions, LEAST.friction, MOST.friction),
            f"  fit: {len(found.records)} heaps, ± {_degrees(error, slope):.1f}° at this pair; one heap scatters by "
            f"{_degrees(response.scatter, slope):.1f}°",
            f"  for comparison: a surface that flows below a widening lies at {math.degrees(found.expected):.0f}° "
            "with this pair",
        ]
    )


def found_yaml(found: Found) -> str:
    """Keys for the case."""
    given = "" if not found.angle_error else f" ± {math.degrees(found.angle_error):.2g}"
    return (
        f"contact:  # from `granpipe repose`: angle of repose {math.degrees(found.angle):.4g}{given} deg\n"
        f"  friction: {found.best.pair.friction:g}\n"
        f"  rolling_friction: {found.best.pair.rolling:.3f}\n"
    )


def found_data(found: Found) -> dict[str, Any]:
    """All figures, for ``repose.json``; angles in degrees."""
    best = found.best
    return {
        "angle": math.degrees(found.angle),
        "angle_error": math.degrees(found.angle_error),
        "recommended": _pair(best.pair)
        | {
            "rolling_range": [best.low, best.high],
            "friction_range": list(found.frictions),
            "friction_kept": found.kept,
        },
        "expected_angle": math.degrees(found.expected),
        "valley": [_pair(one.pair) | {"rolling_range": [one.low, one.high]} for one in found.valley],
        "fit": {
            "coefficients": found.response.coefficients.tolist(),
            "covariance": found.response.covariance.tolist(),
            "scatter": found.response.scatter,
            "noise": found.noise,
        },
        "heaps": [
            _pair(asked.pair)
            | {
                "seed": asked.seed,
                "angle": math.degrees(math.atan(record.slope)),
                "slopes": record.slopes,
                "motion": record.motion,
            }
            for asked, record in zip(found.asked, found.records, strict=True)
        ],
        "failed": [gate.as_dict() for gate in found.failed],
    }


@own_style({})
def draw(found: Found, path: Path) -> None:
    """The plane of friction: angle of the fitted surface, heaps with their own angle, the valley with its range."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.5), layout="constrained")
    axes: Any = figure.subplots()
    friction, rolling = np.linspace(LEAST.friction, MOST.friction, 91), np.linspace(LEAST.rolling, MOST.rolling, 101)
    angle = np.degrees(np.arctan(found.response.slope(*np.meshgrid(friction, rolling))))
    own = [math.degrees(math.atan(record.slope)) for record in found.records]
    limits = min(angle.min(), *own), max(angle.max(), *own)
    shades = axes.contourf(friction, rolling, angle, np.linspace(*limits, 21), cmap="viridis", alpha=0.8)
    figure.colorbar(shades, label="angle of repose [°]", format="%.0f")
    x = [one.pair.friction for one in found.valley]
    axes.fill_between(
        x, [one.low for one in found.valley], [one.high for one in found.valley], color="white", alpha=0.4,
        label="95 % range",
    )  # fmt: skip
    axes.plot(
        x, [one.pair.rolling for one in found.valley], color="black",
        label=f"pairs that give {math.degrees(found.angle):.4g}°",
    )  # fmt: skip
    axes.scatter(
        [one.pair.friction for one in found.asked], [one.pair.rolling for one in found.asked], c=own, cmap="viridis",
        vmin=limits[0], vmax=limits[1], edgecolors="black", zorder=3, label="heaps, with their own angle",
    )  # fmt: skip
    axes.plot(*_xy(found.best.pair), "r*", markersize=16, zorder=4, label="recommended")
    axes.set_xlabel("contact.friction")
    axes.set_ylabel("contact.rolling_friction")
    axes.legend(loc="upper right", fontsize=8)
    figure.savefig(path, dpi=150)


def _rows(found: Found) -> Iterator[str]:
    for one in found.valley:
        steps = one.pair.friction / TABLE_STEP
        if math.isclose(steps, round(steps)):
            reach = _range(one.low, one.high, LEAST.rolling, MOST.rolling)
            yield f"{one.pair.friction:8.2f}   {one.pair.rolling:16.3f}   {reach}"


def _range(low: float, high: float, least: float, most: float) -> str:
    """Where a range ends at the edge of the search, it may go on beyond."""
    if low <= least and high >= most:
        return f"{least:g} to {most:g} and perhaps beyond: not determined"
    start = f"{low:.3f}" if low > least else f"{least:g} or less" if least > 0 else "0"
    return f"{start} to {high:.3f}" + ("" if high < most else " or more")


def _degrees(error: float, slope: float) -> float:
    return math.degrees(error / (1 + slope**2))


def _pair(pair: Pair) -> dict[str, float]:
    return {"friction": pair.friction, "rolling_friction": pair.rolling}


def _xy(pair: Pair) -> tuple[float, float]:
    return pair.friction, pair.rolling
