# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings of the case studies."""

from __future__ import annotations

from dataclasses import dataclass

from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import check_declared, declared


@dataclass(frozen=True)
class CaseStudySettings:
    """Settings of the case studies, each an option of the command.

    Raises:
        SettingsError: If a value is out of its range.
    """

    radius: float = declared(
        0.5, "landscape: half width of the picture, in lengths of the weight vector", 0.001, 10
    )
    steps: int = declared(21, "landscape: grid points along each side, an odd number", 3, 9_999)
    directions: int = declared(10, "landscape: random directions, for its sharpness", 2, 10_000)
    sizes: str = declared(
        "128,256,512,1024,2048", "stability: numbers of points, three or more in ascending order"
    )
    repeats: int = declared(5, "stability: random draws for each number of points", 1, 10_000)
    methods: str = declared("nsfp,fnsf,mnsf", "stability: methods to compare")

    def __post_init__(self) -> None:
        check_declared(self)
        if self.steps % 2 == 0:
            raise SettingsError(f"steps: got {self.steps}, expected an odd number")
        numbers = self.numbers_of_points
        if len(numbers) < 3 or min(numbers) < 2 or numbers != sorted(set(numbers)):
            raise SettingsError(
                f"sizes: got {self.sizes}, expected 3 or more numbers from 2 in ascending order"
            )
        methods = self.methods.split(",")
        if len(set(methods)) < len(methods):
            raise SettingsError(f"methods: got {self.methods}, expected each once")

    @property
    def numbers_of_points(self) -> list[int]:
        """The `sizes`."""
        return [int(text) if text.isdecimal() else 0 for text in self.sizes.split(",")]
