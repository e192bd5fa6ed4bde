"""Messages in the order of their header stamps, without holding more than a few of them."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from typing import Final, Protocol, TypeVar

# Recorders write messages as they receive them; more than this many places off is a jump in time.
REORDER_WINDOW: Final = 4


class HasStamp(Protocol):
    """Anything with a time."""

    @property
    def stamp_ns(self) -> int:
        """Integer nanoseconds."""


Item = TypeVar("Item", bound=HasStamp)


def in_stamp_order(
    items: Iterable[Item | None], window: int = REORDER_WINDOW
) -> Iterator[Item | None]:
    """Yields items by stamp, as far as that takes no more than a small window.

    Args:
        items: Items, and None wherever some may be missing: nothing moves across it.
        window: So many items are held back.

    Yields:
        The same items and Nones. After a jump back in time order begins anew.
    """
    waiting: list[tuple[int, int, Item]] = []
    newest_ns: int | None = None
    for number, item in enumerate(items):
        is_too_late = item is not None and newest_ns is not None and item.stamp_ns < newest_ns
        if item is None or is_too_late:
            yield from _in_order(waiting)
            newest_ns = None
        if item is None:
            yield None
            continue
        heapq.heappush(waiting, (item.stamp_ns, number, item))
        if len(waiting) > window:
            newest_ns, _, oldest = heapq.heappop(waiting)
            yield oldest
    yield from _in_order(waiting)


def _in_order(waiting: list[tuple[int, int, Item]]) -> Iterator[Item]:
    """Empties the heap."""
    while waiting:
        yield heapq.heappop(waiting)[2]
