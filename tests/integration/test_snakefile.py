"""The Snakefile, where there is a Snakemake: points become rules, and what is done is not done again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SNAKEMAKE = os.environ.get("GRANPIPE_SNAKEMAKE") or shutil.which("snakemake")

SWEEP = f"""\
name: walls
case: {ROOT / "cases" / "hopper.yaml"}
set: {{figures: [], export: []}}
axes: [{{outline.sections.b.wall_factor: [0.5, 0.6]}}]
chart: []
"""


@pytest.mark.skipif(SNAKEMAKE is None, reason="Snakemake is not installed (it is optional)")
def test_snakemake_runs_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    granpipe = Path(sys.executable).with_name("granpipe")
    command = [str(SNAKEMAKE), "-s", str(ROOT / "Snakefile"), "--cores", "2", "--config", "sweep=sweep.yaml"]

    def run() -> str:
        done = subprocess.run(
            [*command, f"granpipe={granpipe}"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return done.stderr + done.stdout

    assert run().count("rule point:") == 2
    assert len((tmp_path / "results" / "walls" / "table.csv").read_text().splitlines()) == 3
    shutil.rmtree(tmp_path / "results" / "walls" / "points" / "wall_factor-0_6")
    assert run().count("rule point:") == 1
