# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory limit of a command, enforced by the operating system for all libraries.

A few kilobytes of a hostile file can expand to all memory there is. Under the limit (RLIMIT_DATA,
Linux) the allocation fails instead, and Python raises a MemoryError.
"""

import argparse
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import Arguments

_GB: Final = 10**9
# What NumPy and SciPy reserve: with less, OpenBLAS asks for it again and again, without an end.
_LEAST_GB: Final = 0.5
# Limits of the container or service that the process runs in; without a limit: a word, or no file.
_GROUP_LIMITS: Final = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)
_INFINITE: Final = float("inf")


def add_max_memory(arguments: Arguments) -> None:
    """Adds `--max-memory`, for `limited_memory`."""
    arguments.value(
        "--max-memory GB",
        "memory that each process may take; inf: no limit (default: half of the machine's)",
        _gigabytes,
    )


@contextmanager
def limited_memory(max_gb: float | None) -> Iterator[str]:
    """Limits this process, and each that it starts, to `max_gb`; None: half of the machine's.

    The limit counts what is allocated and what is reserved, for example for stacks of threads, but
    neither files mapped to memory nor the memory of a GPU.

    Yields:
        For the user, the limit and the option that changes it.
    """
    before, most = resource.getrlimit(resource.RLIMIT_DATA)
    num_bytes = max(machine_bytes() / 2, _LEAST_GB * _GB) if max_gb is None else max_gb * _GB
    limit = most if num_bytes == _INFINITE else int(num_bytes)
    if most != resource.RLIM_INFINITY:
        limit = min(limit, most)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, most))
    limited = "exhausted" if limit == resource.RLIM_INFINITY else f"limited to {limit / _GB:.1f} GB"
    try:
        yield f"memory is {limited} (--max-memory)"
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, most))


def machine_bytes() -> int:
    """Returns the memory of the machine or its container."""
    limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for file in _GROUP_LIMITS:
        with suppress(OSError, ValueError):
            limits.append(int(file.read_text()))
    return min(limits)


def _gigabytes(text: str) -> float:
    with suppress(ValueError):
        if float(text) >= _LEAST_GB:
            return float(text)
    raise argparse.ArgumentTypeError(f"got {text!r}, expected {_LEAST_GB} GB or more, or inf")
