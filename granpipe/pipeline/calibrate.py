"""A short real run, from filling to averages, that tells how many particle-steps a second this machine makes."""

from __future__ import annotations

import tempfile
from pathlib import Path

from granpipe.case.reader import resolve
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import Convergence
from granpipe.pipeline.dem_stages import simulate
from granpipe.pipeline.records import SettleRecord
from granpipe.planning.make import make_plan
from granpipe.progress import Progress
from granpipe.system.cores import free_cores, usable_cores
from granpipe.system.rates import Rates, keep_rates, require_place
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

_COLUMN = {
    # a straight column of some thousand spheres on a plate: about 1e7 particle-steps
    "name": "calibration",
    "outline": {"wall": [[0.1, 0.3], [0.1, 0.0]]},
    "material": {"density": 1000, "size": {"diameter": 0.02}},
    "contact": {"youngs_modulus": 1e6},
    "flow_rate": "1 kg/h",
    "model": "dem",
    "dem": {"plate_speed": 0.05, "start_speed": 0.05, "max_time": 0.4},
}


def calibration_case(ranks: int) -> Case:
    """What is run."""
    return resolve(dict(_COLUMN), Places("calibration"), {"dem.ranks": str(ranks)}).case


def calibrate(progress: Progress) -> Rates:
    """Run the column on one core, and on two where there are and other programs leave them free; keep the rates."""
    require_place()
    most = min(2, usable_cores())
    if (free := min(most, free_cores())) < most:
        progress.note("other programs keep cores busy: two ranks would wait for each other, so only one is measured")
    return keep_rates({ranks: _rate(ranks, progress) for ranks in range(1, free + 1)})


def _rate(ranks: int, progress: Progress) -> float:
    plan = make_plan(calibration_case(ranks), ranks)
    with tempfile.TemporaryDirectory(prefix="granpipe-") as folder:
        store = Store(Path(folder))
        versions = library_versions() | program_versions(store.root / "programs.json")
        context = Context(store, versions, progress, ranks)
        (production,) = simulate(plan, context, lambda _: Convergence())
        settled, produced = SettleRecord.read(production.settled), production.reports()[-1]
        return plan.particle_steps * ranks / (settled.processor_seconds + produced.processor_seconds)
