# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How the process keeps memory: what each sweep needs stays, what a large one left goes back."""

from __future__ import annotations

import ctypes
import os
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

# Of malloc.h of glibc.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
# Clouds and what is computed of them are below the first; with every sweep their pages would be
# taken from the system and returned, which costs more than building and sending a cloud.
_MMAP_BYTES: Final = 32 * 2**20
_TRIM_BYTES: Final = 256 * 2**20
_OWN_VARIABLES: Final = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES")

# So many sweeps later, the estimator remembers no large one any more.
_NUM_SWEEPS: Final = 16
_LARGER: Final = 2


def keep_memory(environment: Mapping[str, str] = os.environ) -> None:
    """Lets malloc keep what sweeps need again and again, unless the user says how it should work.

    Does nothing where the C library is another one than glibc.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None or any(name in environment for name in _OWN_VARIABLES):
        return
    mallopt(_M_MMAP_THRESHOLD, _MMAP_BYTES)
    mallopt(_M_TRIM_THRESHOLD, _TRIM_BYTES)


def return_memory() -> None:
    """Gives all memory that is free inside the process back to the system, where glibc can."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)


class MemoryOfLargeSweeps:
    """Returns memory once sweeps are smaller than they were."""

    def __init__(self, return_: Callable[[], None] = return_memory) -> None:
        self._return = return_
        self._recent: deque[int] = deque(maxlen=_NUM_SWEEPS)
        self._largest = 0

    def after(self, num_points: int) -> None:
        """To be called when the work on a sweep of so many points has ended."""
        self._recent.append(num_points)
        self._largest = max(self._largest, num_points)
        usual = max(self._recent)
        if len(self._recent) == _NUM_SWEEPS and self._largest > _LARGER * usual:
            self._return()
            self._largest = usual
