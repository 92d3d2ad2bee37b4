"""An interrupt waits for the end of what must not be interrupted, and is not lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from granpipe.system.interrupts import uninterrupted


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    before = {one: signal.signal(one, interrupt) for one in (signal.SIGINT, signal.SIGTERM)}
    yield
    for one, handler in before.items():
        signal.signal(one, handler)


def worked_through(one: signal.Signals, done: list[str], fault: Exception | None = None) -> None:
    with uninterrupted():
        os.kill(os.getpid(), one)
        done.append("all")
        if fault is not None:
            raise fault


@pytest.mark.parametrize("one", [signal.SIGINT, signal.SIGTERM])
def test_it_acts_at_the_end_of_the_block(one: signal.Signals) -> None:
    done: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        worked_through(one, done)
    assert done
    assert signal.getsignal(one) is interrupt


def test_it_is_not_lost_where_the_block_fails() -> None:
    with pytest.raises(KeyboardInterrupt):
        worked_through(signal.SIGTERM, [], ValueError())


def test_without_one_nothing_happens() -> None:
    with uninterrupted():
        pass
    assert signal.getsignal(signal.SIGINT) is interrupt
