# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Just enough of protocol buffers and TFRecord to write files for tests."""

from __future__ import annotations

import struct

import numpy as np


def varint(value):
    out = b""
    while value > 0x7F:
        value, low = value >> 7, value & 0x7F
        out += bytes([low | 0x80])
    return out + bytes([value])


def field(number, value):
    """One field: int as varint, float as double, str and bytes with a length, others repeated."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return b"".join(field(number, one) for one in value)
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def crc32c(data):
    """Bit by bit, by polynomial division."""
    crc = 0xFFFFFFFF
    for byte in data:
        for bit in range(8):
            feedback = (crc ^ (byte >> bit)) & 1
            crc = (crc >> 1) ^ (0x82F63B78 * feedback)
    return crc ^ 0xFFFFFFFF


def tf_record(data):
    length = struct.pack("<Q", len(data))
    crc = crc32c(length)
    masked = ((crc >> 15 | crc << 17) + 0xA282EAD8) % 2**32
    return length + struct.pack("<I", masked) + data + b"crc!"
