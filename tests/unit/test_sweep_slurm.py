"""Scripts and lists for Slurm, without one: what is submitted, and that nothing unsafe gets into a script."""

import json
import subprocess
from pathlib import Path

import pytest

from granpipe.errors import RunError
from granpipe.progress import Silent
from granpipe.sweep import slurm
from granpipe.sweep.file import Profile
from granpipe.sweep.folder import Folder
from granpipe.sweep.jobs import cancel, submit
from granpipe.sweep.points import Point
from granpipe.sweep.queue import queued
from granpipe.sweep.slurm import Element


class Cluster:
    """Remembers what is submitted; `elements` is what `squeue` would tell."""

    def __init__(self):
        self.scripts, self.options, self.elements, self.longest = [], [], [], 1000

    def submit(self, path, *options):
        self.scripts.append(path)
        self.options.append(options)
        return str(100 + len(self.scripts))


@pytest.fixture
def cluster(monkeypatch):
    fake = Cluster()
    monkeypatch.setattr(slurm, "submit", fake.submit)
    monkeypatch.setattr(slurm, "queue", lambda: fake.elements)
    monkeypatch.setattr(slurm, "largest_array", lambda: fake.longest)
    monkeypatch.setattr(slurm, "is_here", lambda: True)
    return fake


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "sweep").mkdir()
    return Folder(tmp_path / "sweep")


def lines(path):
    return [line.split() for line in path.with_suffix(".txt").read_text().splitlines()]


def points(number, ranks=0, particles=True, word="p"):
    return [Point(f"{word}{n}", ranks, particles) for n in range(number)]


def test_points_with_particles_get_an_element_each_by_their_ranks(cluster, folder):
    submit(folder, points(3) + points(2, ranks=4, word="q"), Profile(time="1 h", ranks=2), Silent())
    twos, fours, table = cluster.scripts
    assert lines(twos) == [["p0"], ["p1"], ["p2"]]
    assert lines(fours) == [["q0"], ["q1"]]
    assert "--ntasks=4" in fours.read_text()
    assert cluster.options[2] == ("--dependency=afterany:101:102",)
    assert table.name == "table.sh"


def test_points_without_particles_share_elements(cluster, folder):
    submit(folder, points(1000, particles=False), Profile(time="1 h", ranks=8), Silent())
    assert {len(line) for line in lines(cluster.scripts[0])} == {25}
    assert "--ntasks=1" in cluster.scripts[0].read_text()


def test_an_array_is_never_longer_than_the_cluster_lets(cluster, folder):
    cluster.longest = 10
    submit(folder, points(95), Profile(time="1 h"), Silent())
    found = lines(cluster.scripts[0])
    assert len(found) == 10
    assert [name for line in found for name in line] == [point.name for point in points(95)]


def test_what_is_in_the_queue_is_not_submitted_again(cluster, folder):
    submit(folder, points(3), Profile(time="1 h"), Silent())
    cluster.elements = [Element("101_1", "RUNNING", ""), Element("101_3", "PENDING", "Priority"), Element("7", "X", "")]
    assert set(queued(folder)) == {"p0", "p2"}
    submit(folder, points(3), Profile(time="1 h"), Silent())
    assert lines(cluster.scripts[2]) == [["p1"]]
    assert cluster.options[3] == ("--dependency=afterany:101:103",)
    noted = json.loads((folder.root / "slurm" / "jobs.json").read_text())["jobs"]
    assert [job["job"] for job in noted if job["points"]] == ["101", "103"]


def test_with_all_in_the_queue_nothing_is_submitted(cluster, folder):
    submit(folder, points(1), Profile(time="1 h"), Silent())
    cluster.elements = [Element("101_1", "PENDING", "")]
    assert submit(folder, points(1), Profile(time="1 h"), Silent()) == []
    assert len(cluster.scripts) == 2


def test_cancelling_takes_the_job_of_the_table_along(cluster, folder, monkeypatch):
    cancelled = []
    monkeypatch.setattr(slurm, "cancel", cancelled.extend)
    submit(folder, points(3), Profile(time="1 h"), Silent())
    cluster.elements = [
        Element("101_2", "PENDING", ""),
        Element("102", "PENDING", "Dependency"),
        Element("9", "RUNNING", ""),
    ]
    assert cancel(folder) == "cancelled jobs 101, 102"
    assert cancelled == ["101", "102"]
    cluster.elements = []
    assert "nothing to cancel" in cancel(folder)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"memory": "2 GB", "partition": "main,long", "account": "a.b", "at_once": 7, "options": ["--qos=long"]},
        {"modules": ["LIGGGHTS/3.8"], "setup": ["source ~/x/bin/activate", 'export A="b c"'], "ranks": 16},
    ],
)
def test_scripts_are_bash_and_say_what_the_profile_says(cluster, folder, given):
    profile = Profile(time="90 min", **given)
    submit(folder, points(2), profile, Silent())
    for script in cluster.scripts:
        subprocess.run(["bash", "-n", str(script)], check=True)
    text = cluster.scripts[0].read_text()
    wanted = ["#SBATCH --time=90\n", "#SBATCH --signal=B:USR1@60\n", f"--ntasks={profile.ranks}\n", "--array=1-2"]
    wanted += [f"module load {module}\n" for module in profile.modules] + [f"{line}\n" for line in profile.setup]
    wanted += (
        ["--mem=2000M", "--partition=main,long", "--account=a.b", "%7\n", "--qos=long"] if "memory" in given else []
    )
    assert all(word in text for word in wanted)
    assert "\n\n#SBATCH" not in text


@pytest.mark.parametrize("name", ["a b", "a;b", "a$(b)", "a'b", "ä", 'a"b', "a\nb"])
def test_a_path_that_is_not_plain_reaches_no_script(cluster, tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(RunError, match="use another folder"):
        submit(Folder(tmp_path / name), points(1), Profile(time="1 h"), Silent())
    assert not cluster.scripts


def test_without_slurm_the_message_says_so(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RunError, match="not of a Slurm cluster"):
        slurm.submit(Path("x.sh"))
