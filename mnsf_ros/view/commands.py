# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Commands of viewers: anybody's JSON, until it is checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mnsf_ros.core.flow_estimate import TrackedObject

_USUAL: Final = 2**31


def are_usual(*values: object) -> bool:
    """Whether values are numbers, neither NaN nor too large for whatever is done with them."""
    return all(isinstance(value, (int, float)) and abs(value) < _USUAL for value in values)


@dataclass(frozen=True)
class Asked:
    """What a viewer wants explained.

    Attributes:
        at: Place (x, y), metres, sensor frame.
        track: `track_id` of an object to be followed from sweep to sweep; 0 for none.
    """

    at: tuple[float, float]
    track: int

    @classmethod
    def by(cls, command: Mapping[str, Any]) -> Asked | None:
        """Returns what a command asks for; None for nothing, or nothing usual."""
        match command:
            case {"at": [x, y], "track": int(track)} if are_usual(x, y, track):
                return cls((x, y), track)
        return None

    def place_in(self, objects: Sequence[TrackedObject]) -> tuple[float, float]:
        """Returns (x, y) of the object in a sweep, or the place that was clicked."""
        for item in objects:
            if item.track_id == self.track:
                return float(item.center[0]), float(item.center[1])
        return self.at
