# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The options of an evaluation, its methods and its tasks, small enough to be sent anywhere."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Final

from mnsf_ros.core.compute_device import node_threads
from mnsf_ros.core.method_traits import MethodTraits
from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.setting import SettingValue, check_declared, declared
from mnsf_ros.settings import Settings

TaskKey = tuple[str, str]

# Settings that follow from the options.
SET_BY_EVALUATOR: Final = ("compute.seed", "compute.num_threads")

# The paper's largest ablation uses five sweeps: t-3 to t+1.
MAX_SWEEPS: Final = 5
_PAIR: Final = 2
_LARGE: Final = 2_147_483_647


@dataclass(frozen=True)
class EvaluatedMethod:
    """A method and its traits under the settings of the run."""

    name: str
    traits: MethodTraits


@dataclass(frozen=True)
class EvaluationOptions:
    """Options of an evaluation; those that are declared are options of the command, too.

    Attributes:
        settings: Settings of the methods, with the seed and a fixed number of threads: sums in
            another order give other last digits, of which early stopping on a noisy loss makes
            large differences. In real time it is the node's number.
        num_sweeps: Minimum number of sweeps of an example, the most that a method looks at, so that
            all methods get the same examples. A shorter recording needs as many as it has.

    Raises:
        SettingsError: If a value is out of its range.
    """

    settings: Settings
    num_points: int = declared(0, "use N random points of each sweep; 0: all", 0, _LARGE)
    every: int = declared(
        1,
        "score every N-th example only, not with --realtime; methods that carry state still "
        "estimate those between",
        1,
        _LARGE,
    )
    max_examples: int = declared(0, "score at most N examples of each recording; 0: all", 0, _LARGE)
    seed: int = declared(0, "seed of everything random, of points and methods", 0, _LARGE)
    ground: str = declared(
        "truth",
        "truth: find ground points by the flags in the truth, where there is truth; settings: by "
        "the ground settings, as the live node does",
        choices=("truth", "settings"),
    )
    realtime: float = declared(
        0.0,
        "replay at this many times the speed of the recording: triplets are dropped as in the live "
        "node (default: none are)",
        0,
        _LARGE,
    )
    pictures: int = declared(
        0, "draw the N worst sweeps of each method, and an animation, for report.html", 0, _LARGE
    )
    num_sweeps: int = 3

    def __post_init__(self) -> None:
        check_declared(self)
        if self.every > 1 and self.realtime:
            raise SettingsError("--every cannot be combined with --realtime")
        values: dict[str, Any] = {"compute.seed": self.seed}
        if self.settings.compute.num_threads == 0:
            values["compute.num_threads"] = node_threads() if self.realtime else 1
        object.__setattr__(self, "settings", self.settings.changed(values))

    @property
    def identity(self) -> dict[str, object]:
        """Everything that rows depend on, by name."""
        others = {one.name for one in fields(self)} - {"settings", "pictures"}
        return {
            **self.settings.to_mapping(),
            "explicit": sorted(self.settings.explicit),
            **{name: getattr(self, name) for name in others},
        }

    def for_methods(
        self, methods: Iterable[EvaluatedMethod], *, pairs: bool
    ) -> "EvaluationOptions":
        """Returns the options with as many sweeps for an example as methods need; two for pairs."""
        number = max([self.num_sweeps, *(one.traits.num_sweeps for one in methods)])
        return replace(self, num_sweeps=_PAIR if pairs else min(number, MAX_SWEEPS))

    def is_indivisible(self, method: EvaluatedMethod) -> bool:
        """Whether rows of a task depend on earlier ones, so that it cannot be resumed halfway."""
        return self.realtime > 0 or method.traits.carries_state


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
    from mnsf_ros.methods import make_method

    changes: dict[str, SettingValue] = {"compute.device": "cpu"} if is_remote else {}
    settings = options.settings.changed(changes)
    return [EvaluatedMethod(name, make_method(name, settings).traits) for name in names]


def num_sweeps_needed(options: EvaluationOptions, there: int) -> int:
    """Returns the minimum number of sweeps of an example; all if a recording has fewer."""
    return max(_PAIR, min(options.num_sweeps, there))
