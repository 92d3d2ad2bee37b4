"""Faults of all kinds, on a stand-in for LIGGGHTS: each is named, and run again nothing is lost.

The stand-in's particles follow from the step number alone, so the field of an interrupted run must be that of an
unbroken one to rounding.
"""

from __future__ import annotations

import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fakes.liggghts import install
from fakes.runs import all_gone, chain, run, running_below, segments, start, wait_for

from granpipe.case.reader import read_case
from granpipe.dem import run as run_module
from granpipe.errors import GranpipeError
from granpipe.field import Field
from granpipe.planning.make import make_plan


@pytest.fixture(autouse=True)
def stand_in(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = install(tmp_path_factory.mktemp("bin"))
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory, tiny_text: str) -> Path:
    """Results of an undisturbed run."""
    folder = tmp_path_factory.mktemp("unbroken")
    path = os.environ["PATH"]
    os.environ["PATH"] = f"{install(folder)}:{path}"
    try:
        (folder / "tiny.yaml").write_text(tiny_text)
        run(read_case(folder / "tiny.yaml"), folder / "results")
    finally:
        os.environ["PATH"] = path
    return folder / "results"


@pytest.fixture
def results(unbroken: Path, tmp_path: Path) -> Path:
    """Results in which walls and bed are done, and nothing of production."""
    shutil.copytree(unbroken / ".store", tmp_path / "results" / ".store")
    shutil.rmtree(chain(tmp_path / "results"))
    return tmp_path / "results"


def assert_same_field(results: Path, unbroken: Path) -> None:
    one, other = (Field.load(folder / "tiny" / "field.npz") for folder in (results, unbroken))
    for name in ("flux_r", "flux_z", "packing_fraction"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-15)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("sums.npz")}


def fails(tiny: Path, results: Path) -> GranpipeError:
    with pytest.raises(GranpipeError) as caught:
        run(read_case(tiny), results)
    return caught.value


def produced(stages: list[str]) -> str:
    """What was said of production."""
    (line,) = [stage for stage in stages if stage.startswith("produce")]
    return line


ENDINGS = {
    "early": r"ended with status 0 .* did not reach the end of its deck",
    "killed": r"was killed by signal 9",
    "error": r"ERROR: Lost atoms",
    "hang": r"no new step for \d+ s, \d+ s allowed: it hangs",
    "endless": r"it printed \d+ MB: it repeats itself without end",
    "truncated": r"snapshot\.\d+\.bin is incomplete though LIGGGHTS has reached step \d+",
}
"""How LIGGGHTS may fail to work on."""

UNPHYSICAL = {
    "lost": r"particle balance does not close: (\d+) present before \+ 0 inserted − 0 discharged ≠ \d+ present",
    "blow-up": r"kinetic energy is .* J/kg at the most: the contacts are unstable; make dem\.time_step smaller",
    "nan": r"kinetic energy is nan",
    "not a number": r"column 'x' is not finite",
    "outside": r"1 particle outside the walls",
    "fast": r"a particle moves at 100 m/s",
    "soft": r"overlap by .* give a larger contact\.youngs_modulus",
}


def failed(tiny: Path, results: Path, monkeypatch: pytest.MonkeyPatch, fault: str, words: str) -> Path:
    """Run into a fault in the fourth segment; the folder with its evidence."""
    monkeypatch.setattr(run_module, "_LEAST_SILENCE", 1.0)
    monkeypatch.setattr(run_module, "_SLOWER", 2)
    monkeypatch.setenv("FAKE_LIGGGHTS", f"{fault}@4")
    monkeypatch.setenv("FAKE_PAUSE", "0.1")
    begun = time.monotonic()
    error = fails(tiny, results)
    assert time.monotonic() - begun < 30
    assert error.exit_status == 3
    assert re.search(words, str(error)), str(error)
    assert all_gone(results)
    evidence = Path(str(error).rpartition("evidence: ")[2])
    assert {"produce.in", "output.txt"} <= {path.name for path in evidence.iterdir()}
    assert list(evidence.glob("snapshot.*.bin"))
    return evidence


@pytest.mark.parametrize("fault", ENDINGS)
def test_however_liggghts_ends_it_is_named_and_nothing_is_lost(
    tiny: Path, results: Path, unbroken: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    evidence = failed(tiny, results, monkeypatch, fault, ENDINGS[fault])
    done = contents(chain(results))
    monkeypatch.delenv("FAKE_LIGGGHTS")
    _, stages = run(read_case(tiny), results)
    assert produced(stages).startswith(f"produce: continues after segment {len(done)} of") or not done
    assert contents(chain(results)).items() >= done.items()
    assert_same_field(results, unbroken)
    assert not evidence.exists()
    assert len(segments(results)) == len(segments(unbroken))


def rest_is_slow(names: Iterable[object], quick: set[object]) -> list[object]:
    """Parameters of which all but the quick ones are left to `make verify`: one mechanism serves them all."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.mark.parametrize("fault", rest_is_slow(UNPHYSICAL, {"lost", "blow-up", "outside"}))
def test_what_is_not_physics_is_stopped_within_seconds_with_its_evidence(
    tiny: Path, results: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    failed(tiny, results, monkeypatch, fault, UNPHYSICAL[fault])


def test_a_bed_that_never_rests_is_refused_with_the_remedy_and_leaves_its_log(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for fault, words in {
        "restless": r"did not come to rest; make dem\.time_step smaller",
        "lost": "balance",
        "blow-up": "unstable",
    }.items():
        monkeypatch.setenv("FAKE_LIGGGHTS", fault)
        error = fails(tiny, tmp_path / "results")
        assert re.search(words, str(error)), str(error)
        assert (Path(str(error).rpartition("evidence: ")[2]) / "output.txt").stat().st_size > 100


def test_output_without_end_is_named_although_the_program_ended_before_it_was_looked_at(
    tiny: Path, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "_LEAST_FILE", 48 * 1024**2)
    monkeypatch.setattr(run_module, "_POLL", 2.0)
    monkeypatch.setenv("FAKE_LIGGGHTS", "endless@1")
    error = str(fails(tiny, results))
    assert "ended with status 1" in error
    assert re.search(ENDINGS["endless"], error), error
    assert all_gone(results)


def test_memory_beyond_what_the_run_can_need_ends_it(
    tiny: Path, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "_RANK_MEMORY", 200_000_000)
    monkeypatch.setattr(run_module, "_MEMORY_EVERY", 0.0)
    monkeypatch.setenv("FAKE_LIGGGHTS", "fat@1")
    assert re.search(
        r"takes \d+ MB of memory, 2\d\d MB are more than a run of this size needs", str(fails(tiny, results))
    )
    assert all_gone(results)


# --- damaged checkpoints -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cut(unbroken: Path, tmp_path_factory: pytest.TempPathFactory, tiny_text: str) -> Path:
    """Results of a run that was ended in segment 10: the segments 8 and 9 have restart files."""
    folder = tmp_path_factory.mktemp("cut")
    (folder / "tiny.yaml").write_text(tiny_text)
    shutil.copytree(unbroken / ".store", folder / "results" / ".store")
    shutil.rmtree(chain(folder / "results"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{install(folder)}:{os.environ['PATH']}")
        patch.setenv("FAKE_LIGGGHTS", "killed@10")
        patch.setenv("FAKE_PAUSE", "0.1")
        fails(folder / "tiny.yaml", folder / "results")
    assert len(segments(folder / "results")) == 9
    return folder / "results"


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "short": lambda data: data[:-100],
    "flipped": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :],
}


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *(("restart", damage) for damage in DAMAGES),
        ("snapshot.bin", "short"),
        ("sums.npz", "flipped"),
        pytest.param("segment.json", "empty", marks=pytest.mark.slow),
        pytest.param("manifest.json", "short", marks=pytest.mark.slow),
    ],
)
def test_of_a_damaged_checkpoint_the_one_before_is_used(
    tiny: Path, cut: Path, unbroken: Path, tmp_path: Path, name: str, damage: str
) -> None:
    results = tmp_path / "results"
    shutil.copytree(cut, results)
    path = chain(results) / "segment-00009" / name
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    _, stages = run(read_case(tiny), results)
    assert produced(stages).startswith("produce: continues after segment 8 of")
    assert_same_field(results, unbroken)


def test_what_is_left_of_a_segment_that_was_killed_while_it_appeared_is_removed(
    tiny: Path, cut: Path, unbroken: Path, tmp_path: Path
) -> None:
    results = tmp_path / "results"
    shutil.copytree(cut, results)
    left = chain(results) / ".segment-00010.0123abcd.part"
    left.mkdir()
    (left / "restart").write_bytes(b"half")
    run(read_case(tiny), results)
    assert not left.exists()
    assert_same_field(results, unbroken)


def test_without_a_whole_restart_file_production_starts_anew(
    tiny: Path, cut: Path, unbroken: Path, tmp_path: Path
) -> None:
    results = tmp_path / "results"
    shutil.copytree(cut, results)
    for path in chain(results).glob("segment-*/restart"):
        path.write_bytes(b"")
    _, stages = run(read_case(tiny), results)
    assert produced(stages) == "produce"
    assert_same_field(results, unbroken)


@pytest.mark.parametrize("damaged", ["settle-*/settled.restart", "settle-*/settled.bin", "walls-*/*.stl"])
def test_damage_in_the_store_is_noticed_and_made_anew(tiny: Path, results: Path, unbroken: Path, damaged: str) -> None:
    """A wall changed in the store once gave a field that was 19 % wrong."""
    files = {path: path.read_bytes() for path in (results / ".store").glob(damaged)}
    for path, whole in files.items():
        path.write_bytes(DAMAGES["flipped"](whole))
    _, stages = run(read_case(tiny), results)
    assert files
    assert damaged.partition("-")[0] in stages  # made, not "done before"
    assert {path: path.read_bytes() for path in files} == files
    assert_same_field(results, unbroken)


@pytest.mark.parametrize("damage", ["empty", "short", "flipped", "gone"])
@pytest.mark.parametrize("name", ["field.npz", "provenance.json", "plan.json", "comsol/u_grid.txt", "report.html"])
def test_damaged_results_are_noticed_and_made_anew(
    tiny: Path, unbroken: Path, tmp_path: Path, name: str, damage: str
) -> None:
    shutil.copytree(unbroken, tmp_path / "results")
    path = tmp_path / "results" / "tiny" / name
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    outcome, _ = run(read_case(tiny), tmp_path / "results")
    assert outcome.made
    assert_same_field(tmp_path / "results", unbroken)
    outcome, _ = run(read_case(tiny), tmp_path / "results")
    assert not outcome.made


def test_a_damaged_last_snapshot_is_made_anew(tiny: Path, unbroken: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    shutil.copytree(unbroken, results)
    (results / "tiny" / "field.npz").unlink()
    path = sorted(chain(results).glob("segment-*"))[-1] / "snapshot.bin"
    whole = path.read_bytes()
    path.write_bytes(DAMAGES["flipped"](whole))
    _, stages = run(read_case(tiny), results)
    assert produced(stages).startswith("produce: continues after segment")
    assert path.read_bytes() == whole
    assert_same_field(results, unbroken)


def test_cases_that_want_more_or_fewer_segments_share_them_and_lose_none(
    tiny: Path, unbroken: Path, tmp_path: Path
) -> None:
    """The same particles, averaged for longer by one case; a shorter one once deleted the segments of the longer."""
    longer, shorter = read_case(tiny), read_case(tiny, {"dem.max_time": "0.8 s"})
    one, other = tmp_path / "longer first", tmp_path / "shorter first"
    shutil.copytree(unbroken / ".store", one / ".store")
    run(shorter, other)
    alone = Field.load(other / "tiny" / "field.npz")
    for results, case, stage in (
        (one, shorter, "produce: done"),
        (other, longer, "produce: continues after segment"),
        (other, shorter, "produce: done"),
    ):
        before = contents(chain(results))
        _, stages = run(case, results)
        assert produced(stages).startswith(stage)
        assert contents(chain(results)).items() >= before.items()
        if case is longer:
            assert_same_field(results, unbroken)
        else:
            field = Field.load(results / "tiny" / "field.npz")
            np.testing.assert_allclose(field.flux_z, alone.flux_z, rtol=1e-9, atol=1e-15)


def test_a_case_that_changes_goes_on_and_another_of_its_name_is_refused(tiny: Path, tmp_path: Path) -> None:
    results, text = tmp_path / "results", tiny.read_text()
    run(read_case(tiny), results)
    (results / "tiny" / "comsol" / "flow.mph").write_text("mine")
    tiny.write_text(text.replace("flow_rate: 1 kg/s", "flow_rate: 0.5 kg/s"))
    assert run(read_case(tiny), results)[0].made
    (tmp_path / "copied.yaml").write_text(text.replace("density: 2000", "density: 1000"))
    refused = r"another case of this name, .*/tiny\.yaml; change `name` in copied\.yaml"
    with pytest.raises(GranpipeError, match=refused):
        run(read_case(tmp_path / "copied.yaml"), results)
    assert "0.5" in (results / "tiny" / "case.yaml").read_text()
    tiny.unlink()  # the case was moved, then
    assert run(read_case(tmp_path / "copied.yaml"), results)[0].made
    (tmp_path / "wider.yaml").write_text(text.replace("[6, 10], [6, 0]", "[7, 10], [7, 0]"))
    (tmp_path / "copied.yaml").unlink()
    with pytest.raises(GranpipeError, match="another case of this name"):
        run(read_case(tmp_path / "wider.yaml"), results)
    assert (results / "tiny" / "comsol" / "flow.mph").read_text() == "mine"


# --- ended by force ------------------------------------------------------------------------------------------------


def producing(results: Path) -> list[int]:
    """The processes of LIGGGHTS that are at work on production."""
    return [number for number, command in running_below(results).items() if "-in produce.in" in command]


def ended_at_random(tiny: Path, results: Path, rng: random.Random, by: str) -> None:
    """Start a run and end it at some moment after its first segment, or let it finish if it is faster."""
    process = start(tiny, results, FAKE_PAUSE="0.05")
    while not producing(results) and process.poll() is None:
        time.sleep(0.02)
    time.sleep(rng.uniform(0, 0.8))
    if by == "liggghts":
        for number in producing(results):
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        expected = {0, 3, 4}
    else:
        process.send_signal(getattr(signal, by))
        expected = {0, 4, -signal.SIGKILL if by == "SIGKILL" else 130}
        if by == "SIGINT":  # caught in the midst of an import Python itself may end by the signal, for a shell 130 too
            expected.add(-signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode in expected, said
    assert "Traceback" not in said
    assert all_gone(results)


@pytest.mark.parametrize("by", ["SIGKILL", "liggghts", "SIGINT", "SIGTERM"])
def test_ended_at_random_moments_a_run_ends_as_if_unbroken(tiny: Path, results: Path, unbroken: Path, by: str) -> None:
    ended_at_random(tiny, results, random.Random(by), by)
    done = contents(chain(results)) if list((results / ".store").glob("produce-*/")) else {}
    run(read_case(tiny), results)
    assert contents(chain(results)).items() >= done.items()
    assert_same_field(results, unbroken)
    assert not list(chain(results).glob(".*"))
    assert len(segments(results)) == len(segments(unbroken))


def state_of(process: int) -> str:
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]


def test_ctrl_z_stops_liggghts_too_and_it_goes_on_with_granpipe(tiny: Path, results: Path, unbroken: Path) -> None:
    process = start(tiny, results, FAKE_PAUSE="0.5")
    wait_for(".store/produce-*/segment-00002", results)
    process.send_signal(signal.SIGTSTP)
    end = time.monotonic() + 10
    while state_of(process.pid) != "T" and time.monotonic() < end:
        time.sleep(0.02)
    (liggghts,) = producing(results)
    assert state_of(process.pid) == state_of(liggghts) == "T"
    before = sorted(chain(results).rglob("snapshot*"))
    time.sleep(1)
    assert sorted(chain(results).rglob("snapshot*")) == before
    process.send_signal(signal.SIGCONT)
    _, said = process.communicate(timeout=60)
    assert process.returncode in (0, 4), said
    assert_same_field(results, unbroken)


def test_granpipe_killed_while_it_is_stopped_leaves_no_process(tiny: Path, results: Path) -> None:
    process = start(tiny, results, FAKE_PAUSE="0.5")
    wait_for(".store/produce-*/segment-00001", results)
    process.send_signal(signal.SIGTSTP)
    time.sleep(1)
    process.kill()
    process.wait(10)
    assert all_gone(results)


def test_liggghts_waits_for_an_averaging_that_is_slow(
    tiny: Path, results: Path, unbroken: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paused, pause = [], run_module.Liggghts.pause
    monkeypatch.setattr("granpipe.pipeline.production._MOST_AHEAD", 6)
    monkeypatch.setattr("granpipe.pipeline.production._AT_ONCE", 1)
    monkeypatch.setattr(run_module.Liggghts, "pause", lambda self, on: (paused.append(on), pause(self, on))[1])
    run(read_case(tiny), results)
    assert True in paused
    assert_same_field(results, unbroken)


def test_two_runs_of_a_case_do_not_fight(tiny: Path, results: Path, unbroken: Path) -> None:
    first = start(tiny, results, FAKE_LIGGGHTS="hang@3")
    wait_for(".store/produce-*/segment-00001", results)
    assert re.search(r"another granpipe \(process \d+ on", str(fails(tiny, results)))
    assert first.poll() is None
    first.terminate()
    _, said = first.communicate(timeout=60)
    assert first.returncode == 130, said
    run(read_case(tiny), results)
    assert_same_field(results, unbroken)


# --- disks ---------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def mounted(folder: Path, options: str) -> Iterator[Path]:
    """A small file system of its own; the test is skipped where this is not allowed."""
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f"needs the right to mount: {done.stderr.decode().strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def test_a_disk_that_fills_up_stops_the_run_and_with_room_it_goes_on(
    tiny: Path, results: Path, unbroken: Path, tmp_path: Path
) -> None:
    with mounted(tmp_path / "disk", "size=300m") as disk:
        shutil.copytree(results / ".store", disk / "results" / ".store")
        process = start(tiny, disk / "results", FAKE_PAUSE="0.2")
        wait_for("results/.store/produce-*/segment-00002", disk)
        with contextlib.suppress(OSError):
            (disk / "ballast").write_bytes(bytes(200_000_000))
        _, said = process.communicate(timeout=60)
        assert process.returncode == 3, said
        assert re.search(r"MB free on this disk, \d+ MB needed; make room", said), said
        assert "Traceback" not in said
        (disk / "ballast").unlink()
        done = contents(chain(disk / "results"))
        assert done
        _, stages = run(read_case(tiny), disk / "results")
        assert produced(stages).startswith(f"produce: continues after segment {len(done)} of")
        assert_same_field(disk / "results", unbroken)


def test_a_disk_without_a_byte_left_is_one_message(
    tiny: Path, results: Path, unbroken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reserve that is kept free is taken away here, so that writing itself fails."""
    monkeypatch.setattr("granpipe.system.files.RESERVE", -(10**12))
    with mounted(tmp_path / "disk", "size=100m") as disk:
        shutil.copytree(results / ".store", disk / "results" / ".store")
        used = shutil.disk_usage(disk).used
        subprocess.run(["mount", "-o", f"remount,size={used + 300_000}", disk], check=True)
        error = fails(tiny, disk / "results")
        assert re.search("no space left|full disk|did not reach the end|without end", str(error)), str(error)
        subprocess.run(["mount", "-o", "remount,size=100m", disk], check=True)
        run(read_case(tiny), disk / "results")
        assert_same_field(disk / "results", unbroken)


def test_a_read_only_folder_is_one_message(tiny: Path, results: Path, tmp_path: Path) -> None:
    with mounted(tmp_path / "disk", "size=10m") as disk:
        shutil.copytree(results / ".store", disk / "results" / ".store")
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        process = start(tiny, disk / "results")
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    assert re.search(r"disk/results/.*(not writable|[Rr]ead-only).*", said), said
    assert "Traceback" not in said


def test_a_file_in_the_way_is_one_message(tiny: Path, tmp_path: Path) -> None:
    (tmp_path / "results").write_text("mine")
    process = start(tiny, tmp_path / "results")
    _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "Traceback" not in said
    assert "results" in said.splitlines()[-1]
    assert (tmp_path / "results").read_text() == "mine"


def test_a_run_that_is_cut_in_its_faster_start_at_its_end_or_after_it_ends_as_if_unbroken(
    tiny: Path, tmp_path: Path
) -> None:
    case = read_case(tiny, {"outline.wall": "[[6, 30], [6, 0]]", "dem.start_speed": "auto"})
    run(case, tmp_path / "unbroken")
    segments_at_start = make_plan(case.case).dem.start_segments
    assert segments_at_start >= 2
    for last in (segments_at_start - 1, segments_at_start, segments_at_start + 3):
        results = tmp_path / f"cut-{last}"
        with pytest.MonkeyPatch.context() as faulty:
            faulty.setenv("FAKE_LIGGGHTS", f"early@{last + 1}")
            with pytest.raises(GranpipeError):
                run(case, results)
        assert len(segments(results)) == last
        _, stages = run(case, results)
        assert produced(stages) == f"produce: continues after segment {last} of {make_plan(case.case).dem.segments}"
        assert_same_field(results, tmp_path / "unbroken")
