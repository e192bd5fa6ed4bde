# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Loops over points that NumPy needs many passes for, compiled to machine code by Numba."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final, TypeVar, cast

import numba
from numba.core import event

_LOG = logging.getLogger(__name__)
# Numba's event of a compilation; machine code from the cache causes none.
_COMPILING: Final = "numba:compile"

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(*signatures: str) -> Callable[[Function], Function]:
    """Compiles a function for the types of its signatures, and for no others.

    The types are named, so that all is compiled when the module is imported, nothing while a robot
    drives, and an array of another type or layout is a TypeError instead of a pause.
    The machine code is kept on disk, beside the source or in the user's cache; where neither can
    be written, each process compiles anew.

    A compiled function runs without the GIL. It sums in the order of its loops, so that its digits
    are those of the same function in plain Python (`NUMBA_DISABLE_JIT=1`). It must call no
    compiled function of another file: Numba does not notice when that one changes.

    Args:
        signatures: As Numba writes them, for example `float32[::1](float32[:, ::1], int64)`.
    """

    def compile_(function: Function) -> Function:
        try:
            return _jit(signatures, function, cache=True)
        except RuntimeError:  # there is no folder for the cache
            return _jit(signatures, function, cache=False)

    return compile_


def _jit(signatures: tuple[str, ...], function: Function, *, cache: bool) -> Function:
    decorate = numba.njit(list(signatures), nogil=True, error_model="numpy", cache=cache)
    return cast(Function, decorate(function))


class _FirstCompilation(event.Listener):
    """Announces once that this start takes longer, before the first compilation."""

    def on_start(self, _event: event.Event) -> None:
        """Logs the line."""
        _LOG.warning(
            "loops are compiled for this computer, about a second each; later starts load them"
        )
        event.unregister(_COMPILING, self)  # type: ignore[no-untyped-call]

    def on_end(self, _event: event.Event) -> None:
        """Logs nothing."""


event.register(_COMPILING, _FirstCompilation())  # type: ignore[no-untyped-call]
