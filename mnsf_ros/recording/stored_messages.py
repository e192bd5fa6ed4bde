"""The messages of one storage file in the order of the file, whatever its format."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rosbags.typesys import Stores, get_typestore

from mnsf_ros.recording.mcap_messages import StoredMessage, read_messages
from mnsf_ros.recording.message_compression import decompressed
from mnsf_ros.recording.ros1_messages import cdr_from_ros1
from mnsf_ros.recording.ros1_records import ROS1, read_ros1_messages

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mnsf_ros.recording.damage import Damage
    from mnsf_ros.recording.mcap_summary import Summary

CDR: Final = "cdr"
# How messages are serialized that can be read.
ENCODINGS: Final = frozenset({CDR, ROS1})
_ROS1_SUFFIX: Final = ".bag"


def stored_messages(file: Path, summary: Summary | None = None) -> Iterator[StoredMessage | Damage]:
    """Yields all messages, and a Damage in place of what cannot be read.

    Args:
        file: An mcap file or a ROS 1 bag.
        summary: What the index of an mcap file says; read from the file if not given.

    Raises:
        OSError: The file cannot be opened or read.
    """
    if file.suffix == _ROS1_SUFFIX:
        return read_ros1_messages(file)
    return read_messages(file, summary)


def as_cdr(message: StoredMessage) -> bytes:
    """Returns a message as it goes over the wire in ROS 2.

    Raises:
        ValueError: ROS 2 has no such type. See also `bag_errors.UNREADABLE`.
    """
    if message.channel.encoding == ROS1:
        noetic = get_typestore(Stores.ROS1_NOETIC)
        return cdr_from_ros1(message.raw, message.channel.msgtype, noetic)
    return decompressed(message.raw)
