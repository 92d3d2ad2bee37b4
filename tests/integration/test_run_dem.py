"""The main job on the real LIGGGHTS, in small: results, balance, caching, interruption and resume."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granpipe.case import CaseFile, read_case
from granpipe.dem.run import Liggghts, Limits
from granpipe.errors import RunError
from granpipe.field import Field, level_flow
from granpipe.homogenize.average import Sums, merge
from granpipe.pipeline import Outcome, run_case
from granpipe.progress import Silent

pytestmark = pytest.mark.liggghts


class Stages(Silent):
    """Remembers which stages were worked and which were found done."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def stage(self, name: str, detail: str = "") -> None:
        self.seen.append(f"{name}: {detail}" if detail else name)


def run(file: CaseFile, results: Path) -> tuple[Outcome, list[str]]:
    stages = Stages()
    return run_case(file, results, stages), stages.seen


def provenance(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "provenance.json").read_text())
    return data


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, tiny_text: str) -> tuple[Path, Path]:
    """(case file, results) of one finished run."""
    folder = tmp_path_factory.mktemp("run")
    case = folder / "tiny.yaml"
    case.write_text(tiny_text)
    run(read_case(case), folder / "results")
    return case, folder / "results"


def test_a_run_leaves_every_promised_file(finished: tuple[Path, Path]) -> None:
    folder = finished[1] / "tiny"
    names = {"case.yaml", "plan.json", "provenance.json", "field.npz", "comsol/flow_spreadsheet.txt", "logs/settle.txt"}
    assert all((folder / name).is_file() for name in names)


def test_the_field_carries_the_same_flow_through_every_level(finished: tuple[Path, Path]) -> None:
    field = Field.load(finished[1] / "tiny" / "field.npz")
    flow = level_flow(field.flux_z, field.grid)
    np.testing.assert_allclose(flow, field.bulk_flow * field.bulk_packing, rtol=1e-10)


def test_the_raw_flow_is_that_of_the_plate(finished: tuple[Path, Path]) -> None:
    """A plug of measured packing on a plate of known speed: flow = packing × area × speed, within the noise."""
    figures = provenance(finished[1] / "tiny")["figures"]
    imposed = figures["bulk_packing"] * np.pi * 0.06**2 * 0.03
    assert figures["solids_flow_m3_per_s"] == pytest.approx(imposed, rel=0.15)


def test_raw_flow_and_storage_close_the_balance_of_every_row(finished: tuple[Path, Path]) -> None:
    """Flow from displacement between snapshots: what flows into a row and stays is what the row has gained."""
    chain = next((finished[1] / ".store").glob("produce-*"))
    sums = merge([Sums.load(path) for path in sorted(chain.glob("segment-*/sums.npz"))])
    flow = level_flow(sums.mean_flux[1], sums.grid)
    gained = sums.storage.sum(axis=1)
    assert np.abs(np.diff(flow) - gained).max() < 2e-3 * flow.mean()


def test_a_second_run_has_nothing_to_do(finished: tuple[Path, Path]) -> None:
    case, results = finished
    outcome, seen = run(read_case(case), results)
    assert not outcome.made
    assert seen == []


def test_another_smoothing_reruns_no_dem(finished: tuple[Path, Path]) -> None:
    case, results = finished
    _, seen = run(read_case(case, {"homogenize.smoothing_passes": "1", "name": "other"}), results)
    assert seen == ["walls: done before", "settle: done before", "produce: done before", "field", "results"]


def test_a_faster_plate_settles_no_new_bed_if_the_box_still_fits(finished: tuple[Path, Path]) -> None:
    case, results = finished
    changes = {"dem.plate_speed": "0.015", "dem.max_time": "2.4", "name": "slow"}
    _, seen = run(read_case(case, changes), results)
    assert seen[:3] == ["walls: done before", "settle: done before", "produce"]


def test_snapshots_are_gone_unless_they_are_asked_for(finished: tuple[Path, Path]) -> None:
    chain = next((finished[1] / ".store").glob("produce-*"))
    assert not list(chain.glob("**/snapshot.*.bin"))
    kept = [path.parent.name for path in sorted(chain.glob("segment-*/restart"))]
    assert kept == [path.name for path in sorted(chain.glob("segment-*"))][-2:]


def start(case: Path, results: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "granpipe", "run", str(case), "--results", str(results)]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=_listen_to_interrupts
    )


def _listen_to_interrupts() -> None:
    """A shell starts background jobs deaf to SIGINT, and the test run may be one."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def wait_for(pattern: str, folder: Path, timeout: float = 120) -> Path:
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if found := sorted(folder.glob(pattern)):
            return found[0]
        time.sleep(0.02)
    raise AssertionError(f"no {pattern} in {folder} within {timeout} s")


def running_below(folder: Path) -> list[str]:
    """Commands of processes that work below a folder."""
    found = []
    for link in Path("/proc").glob("[0-9]*/cwd"):
        try:
            if link.readlink().is_relative_to(folder):
                found.append((link.parent / "cmdline").read_bytes().replace(b"\0", b" ").decode())
        except OSError:
            continue
    return found


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_ended_run_leaves_no_process_and_continues_where_it_was(
    tiny: Path, tmp_path: Path, by: signal.Signals
) -> None:
    results = tmp_path / "results"
    process = start(tiny, results)
    wait_for(".store/produce-*/segment-00001", results)
    process.send_signal(by)
    status = process.wait(20)
    assert status == (-signal.SIGKILL if by is signal.SIGKILL else 130)
    end = time.monotonic() + 10
    while running_below(results) and time.monotonic() < end:
        time.sleep(0.05)
    assert running_below(results) == []
    assert not (results / "tiny").exists()
    _, seen = run(read_case(tiny), results)
    assert seen[1] == "settle: done before"
    assert seen[2].startswith("produce: continues after segment")
    assert (results / "tiny" / "field.npz").is_file()


@pytest.mark.parametrize("damage", [b"", b"short", "flip"])
def test_a_damaged_restart_file_is_refused_and_the_one_before_is_used(tiny: Path, tmp_path: Path, damage: Any) -> None:
    results = tmp_path / "results"
    process = start(tiny, results)
    chain = wait_for(".store/produce-*/segment-00002", results).parent
    process.kill()
    process.wait(20)
    newest = max(chain.glob("segment-*/restart"))
    data = newest.read_bytes()
    newest.write_bytes(damage if damage != "flip" else data[:5000] + bytes([data[5000] ^ 1]) + data[5001:])
    _, seen = run(read_case(tiny), results)
    assert seen[2].startswith(f"produce: continues after segment {int(newest.parent.name[-5:]) - 1} ")


def test_two_runs_of_a_case_do_not_fight(tiny: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    process = start(tiny, results)
    try:
        wait_for(".store/.settle-*.part", results)
        with pytest.raises(RunError, match="another granpipe"):
            run(read_case(tiny), results)
    finally:
        process.terminate()
        process.wait(20)


def test_liggghts_own_error_reaches_the_user(tmp_path: Path) -> None:
    (tmp_path / "bad.in").write_text("units si\nno_such_command 1\n")
    with Liggghts("bad.in", tmp_path, 1, {}) as process, pytest.raises(RunError, match="Unknown command"):
        list(process.wait())


def test_a_deck_that_ends_early_is_no_success(tmp_path: Path) -> None:
    (tmp_path / "short.in").write_text("units si\n")
    with Liggghts("short.in", tmp_path, 1, {}) as process, pytest.raises(RunError, match="end of its deck"):
        list(process.wait())


def test_output_without_end_is_cut_off(tmp_path: Path) -> None:
    """The cap must leave room for the MPI library's own shared files of some megabytes."""
    (tmp_path / "loop.in").write_text('label a\nprint "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"\njump SELF a\n')
    with (
        Liggghts("loop.in", tmp_path, 1, {}, Limits(file_bytes=64_000_000)) as process,
        pytest.raises(RunError, match="outgrew its cap"),
    ):
        list(process.wait())
    assert (tmp_path / "output.txt").stat().st_size <= 64_000_000


def test_free_discharge_closes_its_balance_and_is_fed_as_fast_as_it_flows(tiny: Path, tmp_path: Path) -> None:
    changes = {"dem.outlet": "open", "outline.wall": "[[6, 10], [6, 6], [5, 0]]", "material.size.diameter": "1.4 cm"}
    outcome, _ = run(read_case(tiny, changes), tmp_path / "results")
    figures = provenance(outcome.folder)["figures"]
    segments = sorted((tmp_path / "results" / ".store").glob("produce-*/segment-*/segment.json"))
    last = json.loads(segments[-1].read_text())
    assert last["discharged"] > figures["inserted_to_settle"][0]  # the whole bed has been renewed
    assert last["particles"] > 0.7 * figures["inserted_to_settle"][0]
    assert [gate for gate in outcome.failed if "raw flow" in gate.name] == []
