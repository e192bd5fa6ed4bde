# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recent stamped items in order, live or read from a recording as far as they are needed."""

from collections import deque
from collections.abc import Iterable
from typing import Final, Generic, Protocol, TypeVar

# A stamp this much older than the last one means that the clock jumped, as when a bag loops.
_JUMP_NS: Final = 1_000_000_000


class Stamped(Protocol):
    """Anything with a time."""

    @property
    def stamp_ns(self) -> int:
        """Integer nanoseconds."""
        ...


Item = TypeVar("Item", bound=Stamped)


class StampedTrack(Generic[Item]):
    """The last items, each newer than the one before. Not safe for several threads.

    Live items come by `add`; those of a recording are read as far ahead as a stamp needs them.
    """

    def __init__(self, recorded: Iterable[Item | None], max_items: int) -> None:
        """Starts without items, and reads them on the way; None stands where some may be missing.

        The oldest ones are dropped beyond `max_items`.
        """
        self._recorded = iter(recorded)
        self._items: deque[Item] = deque(maxlen=max_items)

    def __len__(self) -> int:
        return len(self._items)

    def add(self, item: Item) -> bool:
        """Adds an item; returns False and ignores it if it is not newer than the last one.

        An item more than a second older means that the clock jumped: earlier items are dropped.
        """
        if self._is_newest_after(item.stamp_ns + _JUMP_NS):
            self._items.clear()
        if self._is_newest_after(item.stamp_ns - 1):
            return False
        self._items.append(item)
        return True

    def read_until(self, stamp_ns: int) -> None:
        """Reads recorded items until one is not older than a stamp, or to the end."""
        while not self._is_newest_after(stamp_ns - 1) and self._read_one():
            pass

    def _is_newest_after(self, stamp_ns: int) -> bool:
        return bool(self._items) and self._items[-1].stamp_ns > stamp_ns

    def _read_one(self) -> bool:
        """Reads a recorded item; returns False at the end."""
        for item in self._recorded:
            if item is None:
                # What happened where items are missing is unknown.
                self._items.clear()
            else:
                self.add(item)
            return True
        return False
