# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A finding: an assumption about the input that does not hold."""

from dataclasses import dataclass
from enum import IntEnum


class Severity(IntEnum):
    """How much a finding harms the flow."""

    INFO = 0  # cannot be decided from the input
    WARNING = 1  # less accurate, or false movers near by
    ERROR = 2  # the flow is wrong


@dataclass(frozen=True)
class Finding:
    """An assumption that does not hold, for the user.

    Attributes:
        assumption: What is assumed, the same text as in docs/reliability.md.
        severity: How much it harms.
        found: What was measured, with figures.
        remedy: The parameter or command that mends it.
    """

    assumption: str
    severity: Severity
    found: str
    remedy: str

    @property
    def is_wrong(self) -> bool:
        """Whether it harms the flow for sure."""
        return self.severity > Severity.INFO

    def __str__(self) -> str:
        """Returns one line."""
        return f"{self.found}. {self.remedy}"
