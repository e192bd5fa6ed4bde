"""Tells when clouds come in and no flow goes out, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mnsf_ros.online.online_pipeline import (
    ESTIMATES_FAILED,
    FLOWS_OUT,
    SWEEPS_RECEIVED,
    TRIPLETS_DROPPED,
    TRIPLETS_UNWATCHED,
)

CLOUDS_UNDECODABLE: Final = "clouds_undecodable"
CLOUDS_EMPTY: Final = "clouds_empty"
CLOUDS_MISSED: Final = "clouds_missed"

_ARRIVALS: Final = (SWEEPS_RECEIVED, CLOUDS_UNDECODABLE, CLOUDS_EMPTY)
# Signs that the node does what it should.
_WELL: Final = (FLOWS_OUT, TRIPLETS_UNWATCHED)

# Counter to what keeps the flow from coming if it grows.
_REASONS: Final = {
    "sweeps_frame_changed": "frame_id changes from sweep to sweep, as of two lidars on one topic",
    "sweeps_duplicate": "sweeps have the same stamp",
    "sweeps_out_of_order": "stamps go backwards",
    "sweeps_time_went_back": "stamps jump back again and again",
    "sweeps_gap": "sweeps are more than buffer.max_interval_s apart",
    CLOUDS_UNDECODABLE: "clouds cannot be decoded",
    CLOUDS_EMPTY: "clouds have no finite point",
    ESTIMATES_FAILED: "every estimate fails",
    TRIPLETS_DROPPED: "the estimate under way takes too long",
}


class FlowWatch:
    """Follows the counters of a pipeline; ask it again and again."""

    def __init__(self) -> None:
        self._last: Mapping[str, int] = {}
        self._arrived_s = float("-inf")
        # Since when clouds come without flow, and the counters then.
        self._since_s: float | None = None
        self._before: Mapping[str, int] = {}

    def complaint(self, counts: Mapping[str, int], now_s: float, patience_s: float) -> str:
        """Returns why no flow has come for longer than the patience; empty if all is well.

        Args:
            counts: Event to how often it has happened.
            now_s: Of a steady clock.
            patience_s: Time with clouds and without flow that is no reason to complain, and time
                without clouds after which none are expected.
        """
        last, self._last = self._last, counts
        if _has_grown(_ARRIVALS, last, counts):
            self._arrived_s = now_s
        is_silent = now_s - self._arrived_s > patience_s
        if is_silent or _has_grown(_WELL, last, counts):
            self._since_s = None
        elif self._since_s is None:
            self._since_s, self._before = now_s, last
        if self._since_s is None or now_s - self._since_s <= patience_s:
            return ""
        return self._reason(counts)

    def _reason(self, counts: Mapping[str, int]) -> str:
        growth = {name: counts.get(name, 0) - self._before.get(name, 0) for name in _REASONS}
        name = max(growth, key=lambda name: growth[name])
        if not growth[name]:
            return "clouds come in, but no flow goes out"
        return f"no flow: {_REASONS[name]} (see {name})"


def _has_grown(events: tuple[str, ...], last: Mapping[str, int], counts: Mapping[str, int]) -> bool:
    return any(counts.get(event, 0) > last.get(event, 0) for event in events)
