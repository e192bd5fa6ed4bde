# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The process ends in time, also when a library never returns while it cleans up."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

# A participant of Fast DDS that is destroyed while it discovers another one may wait for ever: it
# holds the lock that the discovery needs to end.
END_TIMEOUT_S: Final = 10

# Of signal.h: a thread of its own calls a function.
_SIGEV_THREAD: Final = 2


class _Event(ctypes.Structure):
    """`struct sigevent` of 64-bit Linux."""

    _fields_ = (
        ("value", ctypes.c_long),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("padding", ctypes.c_long * 4),
    )


class _Times(ctypes.Structure):
    """`struct itimerspec`."""

    _fields_ = tuple(
        (name, ctypes.c_long) for name in ("every_s", "every_ns", "first_s", "first_ns")
    )


def exit_within(seconds: int, status: int, clock: int = time.CLOCK_MONOTONIC) -> Callable[[], None]:
    """Ends the process with a status after some time, unless what is returned is called by then.

    Without the interpreter: a thread of Python could not run while a library holds its lock. Does
    nothing where the C library has no such timer.

    Args:
        seconds: By the clock.
        status: Exit status.
        clock: With `time.CLOCK_PROCESS_CPUTIME_ID` a process that is stopped, or hardly gets to
            run, has as long as it needs; one that waits without computing then has no end.
    """
    library = ctypes.CDLL(None)
    if not hasattr(library, "timer_create"):
        return _nothing
    function = ctypes.cast(library._exit, ctypes.c_void_p)
    event = _Event(value=status, notify=_SIGEV_THREAD, function=function.value)
    timer = ctypes.c_void_p()
    if library.timer_create(clock, ctypes.byref(event), ctypes.byref(timer)) != 0:
        return _nothing
    library.timer_settime(timer, 0, ctypes.byref(_Times(first_s=seconds)), None)
    return lambda: library.timer_delete(timer)


@contextmanager
def leaving_ros() -> Iterator[None]:
    """Ends the process with status 1 if Fast DDS hangs while what is inside destroys a node.

    It computes while it hangs. There is more to come after this, so that a machine on which it only
    takes long must not end the process.
    """
    call_off = exit_within(END_TIMEOUT_S, 1, time.CLOCK_PROCESS_CPUTIME_ID)
    try:
        yield
    finally:
        call_off()


def _nothing() -> None:
    """Calls off what never began."""
