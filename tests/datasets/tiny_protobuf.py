# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Just enough of protocol buffers and TFRecord to write files for tests."""

from __future__ import annotations

import struct

import numpy as np


def varint(value):
    value &= 2**64 - 1
    out = bytearray()
    while True:
        value, low = value >> 7, value & 0x7F
        out.append(low | (0x80 if value else 0))
        if not value:
            return bytes(out)


def field(number, value, *, packed=False):
    """One field: int as varint, float as double, str and bytes with a length, lists repeated."""
    if isinstance(value, (list, tuple)):
        return b"".join(field(number, one) for one in value)
    if isinstance(value, np.ndarray):
        if packed:
            return field(number, value.tobytes())
        return b"".join(varint(number << 3 | 1) + struct.pack("<d", one) for one in value)
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
    def masked(part):
        crc = crc32c(part)
        return struct.pack("<I", ((crc >> 15 | crc << 17) + 0xA282EAD8) % 2**32)

    length = struct.pack("<Q", len(data))
    return length + masked(length) + data + b"crc!"
