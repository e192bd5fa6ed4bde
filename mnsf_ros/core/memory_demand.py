# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How much memory networks and grids need, checked before any of it is taken.

Without this check the system ends the process, or another one, when memory runs out.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from mnsf_ros.core.compute_device import compute_device
from mnsf_ros.errors import SettingsError
from mnsf_ros.settings import Settings

# Limits of the container or service that the process runs in; without a limit: a word, or no file.
_GROUP_LIMITS: Final = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)
_FLOAT_BYTES: Final = 4
# Weights, their gradient, and two moments of Adam.
_COPIES_OF_WEIGHTS: Final = 4
# Toward the next and the previous sweep; and the mask that the second of them is made from.
_BYTES_PER_CELL: Final = 2 * _FLOAT_BYTES + 1


def machine_bytes() -> int:
    """Returns how much memory the process can ever have: that of the machine or its container."""
    limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for file in _GROUP_LIMITS:
        with suppress(OSError, ValueError):
            limits.append(int(file.read_text()))
    return min(limits)


def check_memory(settings: Settings, num_points: int = 0) -> None:
    """Checks that what the networks and grids of the settings need fits into memory.

    On CUDA nothing is checked: there a failed allocation costs one estimate, and no process.

    Args:
        settings: All settings.
        num_points: Points in one step of an optimization, where they are known.

    Raises:
        SettingsError: It does not fit; with both figures, and the settings that decide.
    """
    needs = {
        "field.num_hidden_layers, field.hidden_width, fusion.num_hidden_layers, "
        "fusion.hidden_width": _weight_bytes(settings),
        "field.num_hidden_layers, field.hidden_width, optimization.batch_points": num_points
        * settings.field.num_hidden_layers
        * settings.field.hidden_width
        * _FLOAT_BYTES,
        "distance.max_cells": settings.distance.max_cells * _BYTES_PER_CELL
        if settings.distance.kind == "grid"
        else 0,
    }
    available = machine_bytes()
    if sum(needs.values()) <= available or _is_on_cuda(settings):
        return
    names = max(needs, key=lambda name: needs[name])
    raise SettingsError(
        f"networks and distance transform need {sum(needs.values()) / 1e9:.1f} GB of memory, this "
        f"machine has {available / 1e9:.1f} GB: reduce {names}"
    )


def _is_on_cuda(settings: Settings) -> bool:
    try:
        return compute_device(settings.compute).type == "cuda"
    except SettingsError:  # there is no torch: said where a method needs it
        return False


def _weight_bytes(settings: Settings) -> int:
    """Memory of two fields and the fusion while they are fitted."""
    field, fusion = settings.field, settings.fusion
    weights = 2 * _num_weights(field.num_hidden_layers, field.hidden_width)
    weights += _num_weights(fusion.num_hidden_layers, fusion.hidden_width)
    return weights * _COPIES_OF_WEIGHTS * _FLOAT_BYTES


def _num_weights(num_hidden_layers: int, width: int) -> int:
    """Those between hidden layers; the few of the first and the last layer do not count."""
    return (num_hidden_layers - 1) * width * (width + 1)
