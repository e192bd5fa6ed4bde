# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What `paper_table.py` estimates, in which order, and what of it is done.

With which settings the rows of each method were computed is kept, too: others belong into another
table.

A part of a plan is SCALE:METHODS:SEEDS. METHODS are names with commas between, or names of the
groups below; a name PRESET/NAME stands for another preset than `paper`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from kitti_examples import MOMENTS, SCALES

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.presets import preset
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings

_GROUPS = {
    "main": "zero,ego,fnsf,mnsf,nsfp,mnsf-cycle,fnsf-linear,fnsf-joint,fnsf-time,nsfp-linear",
    "ablations": "mnsf-no-backward,mnsf+fusion.kind=mean,mnsf+fusion.inversion=false",
    "variants": "mnsf+fusion.kind=weighted_sum,mnsf+fusion.num_hidden_layers=2,"
    "mnsf+fusion.num_hidden_layers=5,mnsf+fusion.num_hidden_layers=7,mnsf-frames4,mnsf-frames5",
    # Not of the paper.
    "ours": "ego-estimated,online,online/online",
}
# What matters most comes first, so that an interrupted run has that.
PLAN = (
    "8192:main,ablations,variants,authors/mnsf:1",
    "full:zero,ego,fnsf,mnsf,mnsf+fusion.kind=mean:1",
    "8192:fnsf,mnsf,nsfp:3",
    "full:nsfp,ablations,main,authors/mnsf:1",
    "8192:ours:3",
    "full:ours:1",
    "8192:main,ablations,variants,authors/mnsf:3",
    "full:variants:1",
)

Values = dict[str, SettingValue]

_OBJECTS = ("online", "online/online")
_GROUPS_OF_OBJECTS = ("crop", "ground", "field", "ego_motion", "objects", "compute")
# Groups of settings that nobody else looks at.
_ONLY_FOR = {
    "ego_motion": (*_OBJECTS, "ego-estimated"),
    "objects": _OBJECTS,
    "nsfp": ("nsfp", "nsfp-linear"),
    "linear": ("nsfp-linear", "fnsf-linear"),
    "mnsf_cycle": ("mnsf-cycle",),
    "node": (),
}


@dataclass(frozen=True)
class Job:
    """One estimate: `method` is a name, or PRESET/NAME for another preset than `paper`."""

    scale: str
    method: str
    seed: int
    moment: int

    @property
    def recording(self) -> str:
        """What the result row has as its recording."""
        return f"{self.scale} seed {self.seed}"

    @property
    def preset(self) -> str:
        """Name of the preset."""
        return preset_of(self.method)

    @property
    def settings(self) -> Settings:
        """Settings of the preset, for sweeps that come without ground."""
        values = {"ground.remove": False, "compute.seed": self.seed, "compute.num_threads": 1}
        return preset(self.preset).changed(values)


def preset_of(method: str) -> str:
    """The preset of NAME or PRESET/NAME."""
    return method.rpartition("/")[0] or "paper"


def method_names(text: str) -> list[str]:
    """The methods of a text with commas, groups taken apart."""
    return [name for word in text.split(",") for name in _GROUPS.get(word, word).split(",")]


def planned(part: str) -> list[Job]:
    """The jobs of SCALE:METHODS:SEEDS; method by method, so that rows get complete early."""
    try:
        scale, names, seeds = part.rsplit(":", 2)
        num_seeds = int(seeds)
    except ValueError:
        raise ValueError(f"got plan {part!r}, expected SCALE:METHODS:SEEDS") from None
    if scale not in SCALES:
        raise ValueError(f"plan {part!r}: got scale {scale!r}, expected one of {SCALES}")
    return [
        Job(scale, method, seed, moment)
        for method in method_names(names)
        for seed in range(num_seeds)
        for moment in MOMENTS
    ]


def done_jobs(rows: Iterable[ResultRow]) -> set[Job]:
    """The jobs that have a row."""
    found = set()
    for row in rows:
        scale, _, seed = row.recording.split()
        found.add(Job(scale, row.method, int(seed), row.number))
    return found


def missing(jobs: Iterable[Job], rows: Iterable[ResultRow]) -> list[str]:
    """What was planned and has no row yet, one line for each scale and seed."""
    done = done_jobs(rows)
    methods: dict[str, dict[str, None]] = {}
    for job in jobs:
        if job not in done:
            methods.setdefault(job.recording, {})[job.method] = None
    return [f"{recording}: {', '.join(names)}" for recording, names in methods.items()]


@dataclass(frozen=True)
class PaperRecord:
    """What the rows in a folder were computed with.

    Attributes:
        sessions: When and where.
        settings: Method, or in the first records preset, to its settings.
    """

    sessions: list[SessionRecord]
    settings: dict[str, Values]


def settings_of(method: str) -> Values:
    """The settings that a method has now; those that it does not look at are left out."""
    return _its_own(method, preset(preset_of(method)).to_mapping())


def recorded_settings(recorded: Mapping[str, Values], methods: Iterable[str]) -> dict[str, Values]:
    """Method to the settings that its rows were computed with."""
    # The first records had them for each preset.
    return {
        method: _its_own(method, recorded.get(method) or recorded.get(preset_of(method), {}))
        for method in methods
    }


def changed(method: str, recorded: Values) -> list[str]:
    """Names of the settings that are others now. What was no setting then had no other value."""
    now = settings_of(method)
    return [name for name, value in recorded.items() if now.get(name) != value]


def outdated(recorded: Mapping[str, Values], methods: Iterable[str]) -> list[str]:
    """One line for each method whose rows were computed with other settings than it has now."""
    own = recorded_settings(recorded, methods)
    names = {method: changed(method, values) for method, values in own.items()}
    return [f"{method}: {', '.join(found)}" for method, found in names.items() if found]


def merged_settings(
    recorded: Mapping[str, Values], done: Iterable[str], todo: Iterable[str]
) -> dict[str, Values]:
    """Method to settings, of rows that are there and of rows to come.

    Raises:
        EvaluationError: A method has rows that were computed with other settings.
    """
    merged = recorded_settings(recorded, done)
    for method in todo:
        names = changed(method, merged.get(method, {}))
        if names:
            raise EvaluationError(
                f"the rows of {method} were computed with another {names[0]}; "
                f"`--again {method}` computes them again"
            )
        merged[method] = settings_of(method)
    return merged


def _its_own(method: str, settings: Mapping[str, SettingValue]) -> Values:
    is_removed = settings.get("ego_motion.removed", False)

    def matters(name: str) -> bool:
        group = name.partition(".")[0]
        if name == "ego_motion.removed" or (group == "ego_motion" and is_removed):
            return True
        if method in _OBJECTS:
            return group in _GROUPS_OF_OBJECTS
        return method in _ONLY_FOR.get(group, (method,))

    return {name: value for name, value in settings.items() if matters(name)}
