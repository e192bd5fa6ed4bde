# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""ROS 1 messages in the wire format of ROS 2."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


@cache
def _jazzy() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def cdr_from_ros1(raw: bytes, msgtype: str, ros1: Typestore) -> bytes:
    """Returns a ROS 1 message as CDR bytes.

    Raises:
        ValueError: ROS 2 has no type of this name with the same fields.
    """
    if not _same_fields(msgtype, ros1):
        raise ValueError(f"ROS 1 type {msgtype} has no equal in ROS 2 Jazzy")
    return bytes(_jazzy().ros1_to_cdr(raw, msgtype))


def _same_fields(msgtype: str, ros1: Typestore) -> bool:
    if msgtype == "std_msgs/msg/Header":
        # It lost its field `seq` in ROS 2; the conversion skips it.
        return True
    jazzy = _jazzy()
    if msgtype not in jazzy.fielddefs or msgtype not in ros1.fielddefs:
        return False
    fields = jazzy.fielddefs[msgtype][1]
    if fields != ros1.fielddefs[msgtype][1]:
        return False
    return all(_same_fields(name, ros1) for _, field in fields for name in _names(field))


def _names(field: object) -> list[str]:
    """Returns the message type that a field (or the elements of an array field) consists of."""
    while isinstance(field, tuple):
        _, detail = field
        if isinstance(detail, str):
            return [detail]
        field = detail[0] if isinstance(detail, tuple) else None
    return []
