"""granpipe: granular flow in axisymmetric vessels as a velocity field for multiphysics programs.

Five names are all that is needed from Python:

- `load_case` reads a case file, `run` does with it what ``granpipe run`` does, `load_result` opens a results folder;
- a `Result` holds case, field, figures and quality gates; its `Flow` is the field **at the process flow rate**.

They live in `granpipe.api` and are loaded when first used: ``import granpipe`` costs no more than Python itself. The
rooms below (`granpipe.pipeline`, `granpipe.fluid`, …) are the program's own and change without notice.

>>> import granpipe
>>> case = granpipe.load_case("cases/hopper.yaml", {"flow_rate": "2 m^3/h"})
>>> result = granpipe.run(case, results=tmp, progress=None)
>>> result
<Result hopper: fluid, no quality gate failed>
>>> u, w = result.field.velocity([0.0, 0.3, 0.7], 4.4)  # the cone is 0.75 m wide here
>>> (u < 0).tolist(), (w < 0).tolist()
([False, True, True], [True, True, True])
>>> result.field.velocity(0.8, 4.4)  # outside the vessel
(np.float64(nan), np.float64(nan))
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granpipe.api.flow import Flow, Profile, SpaceFlow
    from granpipe.api.result import Result, load_case, load_result, run
    from granpipe.errors import CaseError, DataError, GranpipeError, MeshError, RunError, SolveError

__version__ = "0.1.0"

_HOMES = {
    "api.result": ("Result", "load_case", "load_result", "run"),
    "api.flow": ("Flow", "Profile", "SpaceFlow"),
    "errors": ("CaseError", "DataError", "GranpipeError", "MeshError", "RunError", "SolveError"),
}

__all__ = [
    "CaseError",
    "DataError",
    "Flow",
    "GranpipeError",
    "MeshError",
    "Profile",
    "Result",
    "RunError",
    "SolveError",
    "SpaceFlow",
    "__version__",
    "load_case",
    "load_result",
    "run",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used (PEP 562)."""
    from importlib import import_module

    for module, names in _HOMES.items():
        if name in names:
            globals()[name] = getattr(import_module(f"granpipe.{module}"), name)
            return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
