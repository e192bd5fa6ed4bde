# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The chunks of an open ROS 1 bag that were read last.

rosbags keeps one for all scans of a bag. Topics that are read side by side are often in two of
them, which would be expanded again for every message, and each time taken from the budget.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Final

from rosbags.rosbag1 import Reader

# Recorders write chunks of 768 KiB.
_MAX_BYTES: Final = 64 * 2**20


class _LastChunks:
    """Decompressed chunks by their positions; the one that was not used for longest goes first."""

    def __init__(self) -> None:
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._num_bytes = 0

    def decompressed(
        self, position: int, decompress: Callable[[bytes], bytes], data: bytes
    ) -> bytes:
        if position in self._kept:
            self._kept.move_to_end(position)
            return self._kept[position]
        content = decompress(data)
        self._kept[position] = content
        self._num_bytes += len(content)
        while self._num_bytes > _MAX_BYTES:
            _, dropped = self._kept.popitem(last=False)
            self._num_bytes -= len(dropped)
        return content


def keep_last_chunks(reader: Reader) -> None:
    """Makes an open bag remember the chunks that were used last."""
    last = _LastChunks()
    for position, chunk in reader.chunks.items():
        remembered = partial(last.decompressed, position, chunk.decompressor)
        reader.chunks[position] = chunk._replace(decompressor=remembered)
