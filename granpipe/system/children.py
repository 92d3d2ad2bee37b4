"""Processes that granpipe starts end with it, however it ends."""

from __future__ import annotations

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


class DieWithParent:
    """To be called in the child before the program: the kernel then signals it when its parent has gone.

    Parameters
    ----------
    end : the signal
    """

    def __init__(self, end: signal.Signals = signal.SIGTERM) -> None:
        self._end, self._parent = end, os.getpid()
        self._libc = ctypes.CDLL(None)  # loaded here: importing after a fork is not safe

    def __call__(self) -> None:
        self._libc.prctl(_PR_SET_PDEATHSIG, self._end)
        if os.getppid() != self._parent:
            os._exit(1)
