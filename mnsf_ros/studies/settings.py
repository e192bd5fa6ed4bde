# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The names of the studies, and their settings."""

from dataclasses import dataclass
from typing import Final

from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import check_declared, declared

# Name to module, which is imported for this study alone because it needs PyTorch, and summary. The
# module has `run`, which gets the name and the options and returns a StudyResult.
STUDIES: Final = {
    "ablation": ("method_study", "FNSF, and MNSF without single parts: (a) to (d) of the paper"),
    "fusion": ("method_study", "fusion by mean, by weighted sum and by a network"),
    "depth": ("method_study", "fusion network with 2, 3, 5 and 7 layers"),
    "frames": ("method_study", "2, 3, 4 and 5 sweeps"),
    "landscape": ("landscape_study", "loss around the optimum, FNSF and MNSF"),
    "stability": (
        "stability_study",
        "effect of replacing one point of N, expected to fall with 1/N",
    ),
    "warm-start": ("warm_study", "errors over the sweeps since the start, warm and from scratch"),
}


@dataclass(frozen=True)
class CaseStudySettings:
    """Settings of the case studies, each an option of the command.

    Raises:
        SettingsError: If a value is out of its range.
    """

    directions: int = declared(10, "landscape: random directions, for its sharpness", 2, 10_000)
    sizes: str = declared(
        "128,256,512,1024,2048", "stability: numbers of points, three or more in ascending order"
    )
    repeats: int = declared(5, "stability: random draws for each number of points", 1, 10_000)
    methods: str = declared("nsfp,fnsf,mnsf", "stability: methods to compare")
    warm_steps: str = declared(
        "2,5,10", "warm-start: steps per sweep of warm-started networks, in ascending order"
    )
    cold_steps: str = declared(
        "10,40", "warm-start: steps of networks from scratch, in ascending order"
    )

    def __post_init__(self) -> None:
        check_declared(self)
        for name, count, least in (("sizes", 3, 2), ("warm_steps", 1, 1), ("cold_steps", 1, 1)):
            text = getattr(self, name)
            numbers = numbers_of(text)
            if len(numbers) < count or min(numbers) < least or numbers != sorted(set(numbers)):
                raise SettingsError(
                    f"{name}: got {text}, expected {count} or more numbers from {least} in "
                    "ascending order"
                )

    @property
    def method_names(self) -> list[str]:
        """The `methods`, each once."""
        return list(dict.fromkeys(self.methods.split(",")))


def numbers_of(text: str) -> list[int]:
    """Returns whole numbers with commas between them; 0 stands for any other text."""
    return [int(part) if part.isdecimal() else 0 for part in text.split(",")]
