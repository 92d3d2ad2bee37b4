"""What a sweep checks before it runs, how it ends when it is interrupted, and what it writes at the end."""

import contextlib
import csv
import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from granpipe.errors import CaseError, DataError
from granpipe.progress import Silent
from granpipe.sweep.collect import write_table
from granpipe.sweep.file import read_sweep
from granpipe.sweep.folder import Folder
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.local import interrupted_once, run_here
from granpipe.sweep.points import Point, plan_points
from granpipe.sweep.state import State
from granpipe.sweep.variants import Variant
from granpipe.system.manifest import write_manifest

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"

SWEEP = f"""\
name: walls
case: {HOPPER}
set: {{model: fluid}}
axes:
  - outline.sections.b.wall_factor: [0.5, 0.6]
points:
  slip: {{fluid.walls: slip}}
"""


def planned(folder, text):
    path = folder / "sweep.yaml"
    path.write_text(text)
    return plan_points(read_sweep(path), folder / "results")


def test_planning_writes_nothing(tmp_path):
    folder, points = planned(tmp_path, SWEEP)
    assert [point.name for point in points] == ["wall_factor-0_5", "wall_factor-0_6", "slip"]
    assert not folder.root.exists()


def test_planning_knows_what_is_done_by_the_case_that_is_to_be_run(tmp_path):
    folder, _ = planned(tmp_path, SWEEP)
    with folder.started():
        replace(State.begins(folder.key("slip")), phase="done").save(folder.state_file("slip"))
        (folder.points / "slip").mkdir()
        (folder.points / "slip" / "provenance.json").write_text('{"case": "slip"}')
        write_manifest(folder.points / "slip")
    assert Folder(folder.root).is_done("slip")
    assert len(planned(tmp_path, SWEEP)[1]) == 2
    (folder.points / "slip" / "provenance.json").write_text('{"case": "slip" }')  # damaged: to be made anew
    assert len(planned(tmp_path, SWEEP)[1]) == 3
    (folder.points / "slip" / "provenance.json").write_text('{"case": "slip"}')
    assert len(planned(tmp_path, SWEEP.replace("model: fluid", "figures: []"))[1]) == 3


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[0.5, 0.6]", "[0.5, 1.6]", "sweep.yaml:5 outline.sections.b.wall_factor: 1.6; must be in [0, 1] (point wall"),
        ("sections.b.", "sections.zz.", "sweep.yaml:5 outline.sections.zz.z: missing"),
        ("{model: fluid}", "{model: fluid, fluid.order: 9}", "sweep.yaml:3 fluid.order: 9"),
        ("{fluid.walls: slip}", "{fluid.walls: slippery}", "sweep.yaml:7 fluid.walls: slippery"),
        (
            "{fluid.walls: slip}",
            "{outline.sections.b.wall_factor: 7}",
            "sweep.yaml:7 outline.sections.b.wall_factor: 7",
        ),
    ],
)
def test_a_wrong_point_is_told_where_the_sweep_sets_it(tmp_path, old, new, expected):
    text = SWEEP.replace(old, new)
    assert text != SWEEP
    with pytest.raises(CaseError) as caught:
        planned(tmp_path, text)
    assert expected in str(caught.value)
    assert not (tmp_path / "results").exists()


def test_an_error_of_the_case_itself_names_its_file(tmp_path):
    (tmp_path / "mine.yaml").write_text(HOPPER.read_text().replace("flow_rate:", "flow_rat:"))
    with pytest.raises(CaseError, match=r"mine\.yaml:\d+ flow_rat: "):
        planned(tmp_path, SWEEP.replace(str(HOPPER), "mine.yaml"))


def test_too_many_ranks_are_refused_before_anything_is_written(tmp_path):
    folder, _ = planned(tmp_path, SWEEP)
    with pytest.raises(CaseError, match="3 ranks, but this machine has 2 cores"):
        run_here(folder, [Point("slip", 3, True)], 2, Silent())
    assert not folder.root.exists()


def test_further_signals_do_not_disturb_the_clean_up():
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    cleaned = []

    @contextlib.contextmanager
    def work():
        try:
            yield
        finally:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGTERM)
            cleaned.append(True)

    with pytest.raises(KeyboardInterrupt), interrupted_once(), work():
        os.kill(os.getpid(), signal.SIGTERM)
    assert cleaned
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


def done_folder(root, values, chart, key="fluid.order"):
    """A folder with a done point for each value."""
    variants = {f"p{at}": Variant(f"p{at}", {key: value}) for at, value in enumerate(values)}
    folder = Folder(root / "sweep", SweepInput("name: a\n", variants, (key,), chart))
    with folder.started():
        pass
    provenance = {"case": "", "quality": [], "wall_seconds": 3.0, "figures": {"residual": 1e-9}}
    for name in variants:
        replace(State.begins(folder.key(name)), phase="done").save(folder.state_file(name))
        (folder.points / name).mkdir()
        (folder.points / name / "provenance.json").write_text(json.dumps(provenance | {"case": name}))
        write_manifest(folder.points / name)
    return folder


def test_results_of_two_points_that_changed_places_are_noticed(tmp_path):
    folder = done_folder(tmp_path, ["2", "3"], ())
    assert folder.is_whole("p0")
    for old, new in (("p0", "aside"), ("p1", "p0"), ("aside", "p1")):
        (folder.points / old).rename(folder.points / new)
    assert not folder.is_whole("p0")
    with pytest.raises(DataError, match="p0: the results of another point, p1; run it again"):
        write_table(folder)


def test_a_table_is_not_made_of_records_that_were_changed(tmp_path):
    folder = done_folder(tmp_path, ["2", "3"], ())
    record = folder.points / "p1" / "provenance.json"
    record.write_text(record.read_text().replace("3.0", "1.0"))
    with pytest.raises(DataError, match="changed since granpipe wrote it"):
        write_table(folder)


@pytest.mark.parametrize("values", [["2"], ["slip", "stick"]])
def test_without_two_numbers_on_an_axis_there_is_no_chart_and_no_error(tmp_path, values):
    written = write_table(done_folder(tmp_path, values, ("wall_seconds",)))
    assert [path.name for path in written.files] == ["table.csv"]
    assert not written.problems


def test_a_chart_is_drawn_over_two_numbers(tmp_path):
    written = write_table(done_folder(tmp_path, ["2", "3"], ("wall_seconds", "residual")))
    assert [path.name for path in written.files] == ["table.csv", "chart.png"]
    assert not written.problems


def test_a_column_that_is_not_there_costs_the_chart_alone(tmp_path):
    written = write_table(done_folder(tmp_path, ["2", "3"], ("nonsense",)))
    assert [path.name for path in written.files] == ["table.csv"]
    assert "no numbers in column nonsense, so nothing is drawn; columns with numbers: fluid.order, wall_seconds" in str(
        written.problems[0]
    )
    with written.files[0].open(newline="") as file:
        assert [row["point"] for row in csv.DictReader(file)] == ["p0", "p1"]


def test_two_jobs_may_write_the_table_at_the_same_moment(tmp_path: Path) -> None:
    """HDF5 locks the file that it writes: a second writer must not meet the first one's."""
    h5py = pytest.importorskip("h5py")
    folder = done_folder(tmp_path, ["2", "3"], ())
    object.__setattr__(folder.inputs, "table", ("csv", "netcdf"))
    with h5py.File(folder.root / "table.nc", "w"):
        written = write_table(folder)
    assert written.problems == []
    assert not list(folder.root.glob(".table*"))
