# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The options of `mnsf tune`."""

from dataclasses import dataclass
from typing import Final

from mnsf_ros.setting import check_declared, declared

AUTO: Final = "auto"
EPE: Final = "epe"
CONSISTENCY: Final = "consistency"


@dataclass(frozen=True)
class TuneOptions:
    """How to tune, each an option of the command.

    Raises:
        SettingsError: If a value is out of its range.
    """

    goal: str = declared(
        AUTO,
        "what to improve, see below; auto: epe with true flow",
        choices=(AUTO, EPE, CONSISTENCY),
    )
    trials: int = declared(60, "number of trials in all", 1, 100_000)
    parameters: str = declared(
        "all", "parameters to tune, NAME,...; all: those listed in docs/parameters.md"
    )

    def __post_init__(self) -> None:
        check_declared(self)

    @property
    def names(self) -> tuple[str, ...]:
        """The `parameters`; empty for all."""
        names = "" if self.parameters == "all" else self.parameters
        return tuple(filter(None, map(str.strip, names.split(","))))
