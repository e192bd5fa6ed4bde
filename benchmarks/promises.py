# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a promise of docs/reliability.md is, and the rounds in which it is tried."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

# What was measured, the figure, and whether the promise holds.
Figure = tuple[str, str, bool]


class Rounds:
    """Numbers of rounds, each with randomness of its own; they end early when the time is over.

    Attributes:
        done: Rounds that have ended.
        seed: Of the randomness.
    """

    def __init__(self, number: int, minutes: float, first: int = 0, seed: int = 0) -> None:
        """There are `number` rounds from `first` on."""
        self.done = 0
        self._numbers = range(first, first + number)
        self._end_s = time.monotonic() + minutes * 60
        self.seed = seed

    def __iter__(self) -> Iterator[tuple[int, np.random.Generator]]:
        """The number of each round, and its random numbers."""
        for number in self._numbers:
            if time.monotonic() > self._end_s:
                return
            yield number, np.random.default_rng([self.seed, number])
            self.done += 1

    def stop(self) -> None:
        """Makes the round that is under way the last one."""
        self._end_s = 0.0


@dataclass(frozen=True)
class Promise:
    """Something that holds however often it is tried.

    Attributes:
        text: The promise.
        number: Rounds after which it counts as measured.
        unit: What a round is, in the plural.
        measure: Tries it and yields figures.
    """

    text: str
    number: int
    unit: str
    measure: Callable[[Rounds], Iterator[Figure]]


def fates(name: str, found: Counter[str], wrong: Iterable[str] = ()) -> Figure:
    """What became of all that was tried; a fate that begins with "wrong" is none that may be."""
    text = ", ".join(f"{fate}: {count:,}" for fate, count in sorted(found.items()))
    return name, text, not any(fate.startswith(("wrong", *wrong)) for fate in found)
