"""The pool: cores are never overbooked, order is kept, and nothing is left running when something fails."""

import contextlib
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.system.pool import Task, run_together


class Machine:
    """Counts what runs at the same time."""

    def __init__(self):
        self.cores = self.most = 0
        self.begun, self.ended = [], []

    @contextlib.contextmanager
    def occupied(self, name, cores):
        self.begun.append(name)
        self.cores += cores
        self.most = max(self.most, self.cores)
        try:
            yield
        finally:
            self.cores -= cores
            self.ended.append(name)

    def task(self, name, cores=1, rounds=1, fails=None):
        def work():
            with self.occupied(name, cores):
                for _ in range(rounds):
                    yield
                if fails:
                    raise fails

        return Task(str(name), cores, work())


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 4), st.integers(0, 5)), max_size=12), st.integers(4, 6))
def test_cores_are_not_overbooked_and_tasks_begin_in_order(shapes, cores):
    machine = Machine()
    tasks = [machine.task(number, size, rounds) for number, (size, rounds) in enumerate(shapes)]
    run_together(tasks, cores, poll=0)
    assert machine.begun == list(range(len(shapes)))
    assert sorted(machine.ended) == machine.begun
    assert machine.most <= cores
    assert machine.cores == 0


def test_free_cores_are_used():
    machine = Machine()
    run_together([machine.task(n, 1, rounds=3) for n in range(8)], 4, poll=0)
    assert machine.most == 4


def test_task_that_wants_more_than_there_is_runs_alone():
    machine = Machine()
    alone = []

    def greedy():
        with machine.occupied("greedy", 9):
            alone.append(machine.cores)
            yield

    tasks = [machine.task("a", rounds=3), Task("greedy", 9, greedy()), machine.task("b", rounds=3)]
    run_together(tasks, 2, poll=0)
    assert alone == [9]
    assert machine.begun == ["a", "greedy", "b"]


@pytest.mark.parametrize("failure", [ValueError("lost"), KeyboardInterrupt()])
def test_what_one_raises_ends_all_and_is_raised(failure):
    machine = Machine()
    tasks = [machine.task("long", rounds=10**9), machine.task("bad", fails=failure), machine.task("later")]
    with pytest.raises(type(failure)):
        run_together(tasks, 2, poll=0)
    assert sorted(machine.ended) == ["bad", "long"]
    assert machine.cores == 0
    assert "later" not in machine.begun


def test_one_that_fails_to_close_does_not_keep_the_others_open():
    machine = Machine()

    def stubborn():
        try:
            while True:
                yield
        finally:
            raise RuntimeError("does not close")

    tasks = [Task("stubborn", 1, stubborn()), machine.task("long", rounds=10**9), machine.task("bad", fails=OSError())]
    with pytest.raises(RuntimeError):
        run_together(tasks, 3, poll=0)
    assert sorted(machine.ended) == ["bad", "long"]


def test_tasks_are_read_as_they_are_needed():
    machine, ahead = Machine(), []

    def thousands():
        for number in range(3000):
            ahead.append(number - len(machine.ended))
            yield machine.task(number)

    run_together(thousands(), 3, poll=0)
    assert len(machine.ended) == 3000
    assert max(ahead) <= 4


def test_the_pool_pauses_once_per_round(monkeypatch):
    pauses = itertools.count()
    monkeypatch.setattr("granpipe.system.pool.time.sleep", lambda seconds: next(pauses) if seconds else None)
    machine = Machine()
    run_together([machine.task(n, rounds=5) for n in range(3)], 3, poll=0.2)
    assert next(pauses) == 5
