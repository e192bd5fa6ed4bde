# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How the process keeps memory: what each sweep needs stays, what few need goes back."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from typing import Final

# Of malloc.h of glibc.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
# Clouds and what is computed of them are below the first; with every sweep their pages would be
# taken from the system and returned, which costs more than building and sending a cloud.
_MMAP_BYTES: Final = 32 * 2**20
_TRIM_BYTES: Final = 256 * 2**20
_OWN_VARIABLES: Final = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES")

# Returning takes some 10 ms, and as much until what is needed is there again. Without it the heap
# grows for hours, by what the threads of the node happen to need at the same time.
RETURN_PERIOD_S: Final = 30.0


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
