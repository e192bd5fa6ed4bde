"""What `paper_table.py` estimates, in which order, and what of it is done.

A part of a plan is SCALE:METHODS:SEEDS. METHODS are names with commas between, or names of the
groups below; a name PRESET/NAME stands for another preset than `paper`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from kitti_examples import MOMENTS, SCALES

from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings

_GROUPS = {
    "main": "zero,ego,fnsf,mnsf,nsfp,mnsf-cycle,fnsf-linear,fnsf-joint,fnsf-time,nsfp-linear",
    # mnsf-mlp, mnsf-depth3 and mnsf-frames3 are mnsf, mnsf-frames2 is mnsf-no-backward.
    "ablations": "mnsf-no-backward,mnsf-mean,mnsf-no-inversion",
    "variants": "mnsf-weighted-sum,mnsf-depth2,mnsf-depth5,mnsf-depth7,mnsf-frames4,mnsf-frames5",
    # Not of the paper.
    "ours": "ego-estimated,online,online/online",
}
# What matters most comes first, so that an interrupted run has that.
PLAN = (
    "8192:main,ablations,variants,authors/mnsf:1",
    "full:zero,ego,fnsf,mnsf,mnsf-mean:1",
    "8192:fnsf,mnsf,nsfp:3",
    "full:nsfp,ablations,main,authors/mnsf:1",
    "8192:ours:3",
    "full:ours:1",
    "8192:main,ablations,variants,authors/mnsf:3",
    "full:variants:1",
)


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
