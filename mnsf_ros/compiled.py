# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Loops over points that NumPy needs many passes for, compiled to machine code by Numba."""

import functools
import inspect
import logging
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast

import numba
from numba.core import config

_LOG = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable[..., object])
_postponed: list[tuple[str, Callable[[], bool]]] | None = None


def compiled(*signatures: str) -> Callable[[Function], Function]:
    """Compiles a function for the types of its signatures, and for no others.

    The types are named, so that all is compiled when the module is imported, nothing while a robot
    drives, and an array of another type or layout is a TypeError instead of a pause.
    The machine code is kept on disk: beside the source, where the installation puts it, else in
    the user's cache, else in a folder of this process. Code that was installed is used in any case,
    unless it is for another kind of CPU.

    A compiled function runs without the GIL. It sums in the order of its loops, so that its digits
    are those of the same function in plain Python (`NUMBA_DISABLE_JIT=1`). It must call no
    compiled function of another file: Numba does not notice when that one changes.

    Args:
        signatures: As Numba writes them, for example `float32[::1](float32[:, ::1], int64)`.
    """

    def compile_(function: Function) -> Function:
        if config.DISABLE_JIT:  # type: ignore[attr-defined]
            return function
        dispatcher = _dispatcher(function)

        def finish() -> bool:
            for signature in signatures:
                dispatcher.compile(signature)
            dispatcher.disable_compile()
            return bool(dispatcher.stats.cache_misses)

        if _postponed is not None:
            _postponed.append((inspect.getfile(function), finish))
        elif finish():
            _announce()
        return cast(Function, dispatcher)

    return compile_


@contextmanager
def postponed() -> Iterator[list[tuple[str, Callable[[], bool]]]]:
    """Compiles nothing meanwhile; yields a list that gets the file of each function, and its rest.

    That compiles it and returns whether it had to, as no machine code was on disk.
    """
    global _postponed  # noqa: PLW0603 - decorators have no other argument
    _postponed = []
    try:
        yield _postponed
    finally:
        _postponed = None


def _dispatcher(function: Callable[..., object]) -> Any:  # noqa: ANN401 - a class of Numba
    """Numba's object of a function, which looks for machine code on disk."""
    decorate = functools.partial(numba.njit, nogil=True, error_model="numpy")
    if not Path(inspect.getfile(function)).is_file():  # it was typed in
        return decorate()(function)
    try:
        dispatcher = decorate(cache=True)(function)
    except RuntimeError:  # neither the folder of the source nor that of the user can be written
        config.CACHE_DIR = _folder_of_process().name  # type: ignore[attr-defined]
        dispatcher = decorate(cache=True)(function)
    _take_installed(function, Path(str(dispatcher.stats.cache_path)))
    return dispatcher


@functools.cache
def _folder_of_process() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="mnsf_ros_loops.")


def _take_installed(function: Callable[..., object], cache: Path) -> None:
    """Copies machine code from beside the source into another cache that has none, or older one."""
    source = Path(inspect.getfile(function))
    installed = source.parent / "__pycache__"
    if cache == installed:
        return
    for index in installed.glob(f"{source.stem}.{function.__qualname__}-*.nbi"):
        known = cache / index.name
        if known.exists() and known.stat().st_mtime >= index.stat().st_mtime:
            continue
        # Without them, the function is compiled. The index comes last, as it names the others.
        with suppress(OSError):
            for file in (*installed.glob(f"{index.stem}.*.nbc"), index):
                draft = cache / f"{file.name}.{os.getpid()}"
                shutil.copy2(file, draft)
                draft.replace(cache / file.name)


@functools.cache
def _announce() -> None:
    """Tells once that this start takes longer."""
    _LOG.warning(
        "loops are compiled for this computer, about a second each; later starts load them"
    )
