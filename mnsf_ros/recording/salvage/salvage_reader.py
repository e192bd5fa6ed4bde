# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading storage files from front to end, around whatever is damaged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_typestore

from mnsf_ros.decompression import FileBudget
from mnsf_ros.recording.bag_files import ROS1
from mnsf_ros.recording.bag_reader import (
    BagReader,
    Converted,
    Readable,
    StoredMessage,
    decompressed,
)
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage, reason
from mnsf_ros.recording.mcap_parts import Summary, read_summary
from mnsf_ros.recording.ros1_messages import cdr_from_ros1
from mnsf_ros.recording.salvage.mcap_file import read_mcap_messages
from mnsf_ros.recording.salvage.ros1_file import read_ros1_messages


def salvaged_messages(file: Path) -> tuple[Summary, Iterator[StoredMessage | Damage]]:
    """Returns what the index of a file says, and all messages, or a Damage, in its order.

    Args:
        file: An mcap file or a ROS 1 bag. The iterator raises an OSError if it cannot be read.
    """
    if file.suffix == ROS1:
        return Summary(), read_ros1_messages(file)
    summary = read_summary(file)
    return summary, read_mcap_messages(file, summary)


class SalvageReader(BagReader):
    """A reader that needs no index, verifies checksums and goes on after damage.

    Messages come in the order of the files. Any number of scans may be under way at a time.
    What is damaged is left out; only `readable_messages` tells where.
    """

    def __init__(
        self, path: Path | str, files: Sequence[Path], topics: Mapping[str, TopicSummary]
    ) -> None:
        """Takes mcap files in the order of time, or ROS 1 bags, and what is in them."""
        super().__init__(path)
        self._files = tuple(files)
        self._known_topics = dict(topics)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def __enter__(self) -> SalvageReader:
        """Opens the recording; the files themselves are opened by each scan."""
        self.topics = dict(self._known_topics)
        return self

    def _opened_files(self) -> Sequence[Path]:
        return self._files

    def _whole(self, found: Iterator[Readable[Converted]]) -> Iterator[tuple[int, Converted]]:
        return (item for item in found if not isinstance(item, Damage))

    def _deserialized(self, raw: bytes, msgtype: str, budget: FileBudget) -> Any:  # noqa: ANN401
        return self._typestore.deserialize_cdr(self._serialized(raw, msgtype, budget), msgtype)

    def _serialized(self, raw: bytes, msgtype: str, budget: FileBudget) -> bytes:
        if self._files[0].suffix == ROS1:
            return cdr_from_ros1(raw, msgtype, get_typestore(Stores.ROS1_NOETIC))
        return decompressed(raw, budget)

    def _stored(
        self, topic: str, start_ns: int | None, stop_ns: int | None, _budget: FileBudget
    ) -> Iterator[StoredMessage | Damage]:
        # Each file has a budget of its own, so that what is found does not depend on their order.
        start = float("-inf") if start_ns is None else start_ns
        stop = float("inf") if stop_ns is None else stop_ns
        for file in self._files:
            try:
                for item in salvaged_messages(file)[1]:
                    if isinstance(item, Damage) or (
                        item.topic == topic and start <= item.received_ns < stop
                    ):
                        yield item
            except OSError as error:
                yield Damage(str(file), "", f"cannot be read: {reason(error)}")
