# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The options of an evaluation, its methods and its tasks, small enough to be sent anywhere."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Literal

from mnsf_ros.core.compute_device import node_threads
from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.methods import make_method
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings

TaskKey = tuple[str, str]

# Settings that follow from the options.
SET_BY_EVALUATOR: Final = ("compute.seed", "compute.num_threads")

# The paper's largest ablation uses five sweeps: t-3 to t+1.
MAX_SWEEPS: Final = 5
_PAIR: Final = 2


@dataclass(frozen=True)
class EvaluatedMethod:
    """A method and its traits under the settings of the run."""

    name: str
    traits: MethodTraits


@dataclass(frozen=True)
class EvaluationOptions:
    """Options of an evaluation.

    Attributes:
        settings: Settings of the methods, with the seed and a fixed number of threads: sums in
            another order give other last digits, of which early stopping on a noisy loss makes
            large differences. In real time it is the node's number.
        num_points: Number of random points of each sweep that are scored; None for all.
        seed: Seed of the random points and of the methods.
        ground: Source of the ground points: the flag in the truth, where there is truth, or the
            settings.
        realtime_rate: Simulate a replay at this rate and drop triplets as the live node does; None
            to estimate all of them.
        num_pictured: Number of the worst flows of each task that are kept for pictures.
        num_sweeps: Minimum number of sweeps of an example, the most that a method looks at, so that
            all methods get the same examples. A shorter recording needs as many as it has.
        every: Score every N-th example only, beginning with the first of a recording. Methods that
            carry state estimate the examples in between, too.
        max_examples: Maximum number of examples of each recording, from its beginning; None for
            all.

    Raises:
        EvaluationError: If a number is out of its range.
    """

    settings: Settings
    num_points: int | None = None
    seed: int = 0
    ground: Literal["truth", "settings"] = "truth"
    realtime_rate: float | None = None
    num_pictured: int = 0
    num_sweeps: int = 3
    every: int = 1
    max_examples: int | None = None

    def __post_init__(self) -> None:
        if self.num_points is not None and self.num_points < 1:
            raise EvaluationError(f"num_points: got {self.num_points}, expected 1 or more, or all")
        if not 0 <= self.seed <= 2_147_483_647:
            raise EvaluationError(f"seed: got {self.seed}, expected 0 to 2147483647")
        if self.num_pictured < 0:
            raise EvaluationError(f"num_pictured: got {self.num_pictured}, expected 0 or more")
        if self.every < 1:
            raise EvaluationError(f"every: got {self.every}, expected 1 or more")
        if self.max_examples is not None and self.max_examples < 1:
            raise EvaluationError(f"max_examples: got {self.max_examples}, expected 1 or more")
        rate = self.realtime_rate
        if self.every > 1 and rate is not None:
            raise EvaluationError("--every cannot be combined with --realtime")
        if rate is not None and not 0 < rate < math.inf:
            raise EvaluationError(f"realtime rate: got {rate}, must be above 0")
        values: dict[str, Any] = {"compute.seed": self.seed}
        if self.settings.compute.num_threads == 0:
            values["compute.num_threads"] = 1 if rate is None else node_threads()
        object.__setattr__(self, "settings", self.settings.changed(values))

    @property
    def identity(self) -> dict[str, object]:
        """Name to value of all that rows depend on."""
        others = {one.name for one in fields(self)} - {"settings", "num_pictured"}
        return {
            **self.settings.to_mapping(),
            "explicit": sorted(self.settings.explicit),
            **{name: getattr(self, name) for name in others},
        }

    def for_methods(self, methods: Iterable[EvaluatedMethod], *, pairs: bool) -> EvaluationOptions:
        """Returns the options with the sweeps that the methods look at, or two, for an example."""
        number = max([self.num_sweeps, *(one.traits.num_sweeps for one in methods)])
        return replace(self, num_sweeps=_PAIR if pairs else min(number, MAX_SWEEPS))

    def is_scored(self, place: int) -> bool:
        """Whether the example at a place among those of its recording is scored."""
        return place % self.every == 0

    def is_indivisible(self, method: EvaluatedMethod) -> bool:
        """Whether rows of a task depend on those before, so that it cannot be resumed halfway."""
        return self.realtime_rate is not None or method.traits.carries_state


@dataclass(frozen=True)
class EvaluationTask:
    """One method on one recording; sweeps whose number is `skipped` have their rows already."""

    recording: EvaluatedRecording
    method: EvaluatedMethod
    skipped: frozenset[int] = frozenset()

    @property
    def key(self) -> TaskKey:
        """Name of the recording and of the method."""
        return self.recording.name, self.method.name


def evaluated_methods(
    names: Iterable[str], options: EvaluationOptions, *, is_remote: bool = False
) -> list[EvaluatedMethod]:
    """Returns methods with their traits, so that a wrong name is found before a run.

    With `is_remote` methods run on other machines: their device may be missing here.

    Raises:
        MnsfError: There is no such method, or the settings do not suit it.
    """
    changes: dict[str, SettingValue] = {"compute.device": "cpu"} if is_remote else {}
    settings = options.settings.changed(changes)
    return [EvaluatedMethod(name, make_method(name, settings).traits) for name in names]


def num_sweeps_needed(options: EvaluationOptions, there: int) -> int:
    """Returns the minimum number of sweeps of an example; all if a recording has fewer."""
    return max(_PAIR, min(options.num_sweeps, there))
