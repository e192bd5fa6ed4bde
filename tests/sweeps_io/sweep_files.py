# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweep files of every format, written byte by byte as their documents say."""

from __future__ import annotations

import struct

import numpy as np

# Exact in float32; a row without a measurement; one far away.
XYZ = np.array(
    [[1.5, -2.25, 0.125], [np.nan, np.nan, np.nan], [-70.0, 3.0, 1.0], [8.0, 8.5, -1.75]],
    dtype=np.float32,
)
INTENSITY = np.array([7, 0, 255, 31], dtype=np.uint8)
RING = np.array([1, 2, 3, 40], dtype=np.uint16)

PCD_HEADER = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
    "FIELDS ring x y _ z normal\nSIZE 2 4 4 1 4 8\nTYPE U F F U F F\nCOUNT 1 1 1 3 1 2\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {encoding}\n"
)


def pcd_rows(xyz):
    """Packed rows with fields before, between and after."""
    dtype = np.dtype(
        [("ring", "<u2"), ("x", "<f4"), ("y", "<f4"), ("_", "u1", 3), ("z", "<f4"), ("n", "<f8", 2)]
    )
    rows = np.zeros(len(xyz), dtype)
    rows["ring"] = 9
    for axis, name in enumerate("xyz"):
        rows[name] = xyz[:, axis]
    return rows


def pcd_ascii(xyz=XYZ):
    lines = [f"9 {x!r} {y!r} 0 0 0 {z!r} 0.5 -1" for x, y, z in xyz.tolist()]
    return (PCD_HEADER.format(n=len(xyz), encoding="ascii") + "\n".join(lines) + "\n").encode()


def pcd_binary(xyz=XYZ):
    return PCD_HEADER.format(n=len(xyz), encoding="binary").encode() + pcd_rows(xyz).tobytes()


def pcd_compressed(xyz=XYZ, compress=None):
    rows = pcd_rows(xyz)
    content = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    data = (compress or lzf_literal)(content)
    header = PCD_HEADER.format(n=len(xyz), encoding="binary_compressed").encode()
    return header + struct.pack("<II", len(data), len(content)) + data


def lzf_literal(content):
    """LZF that compresses nothing: runs of up to 32 bytes as they are."""
    pieces = [content[start : start + 32] for start in range(0, len(content), 32)]
    return b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)


def lzf_greedy(content):
    """LZF that takes the longest match that it finds, of any length and distance."""
    out, place, literal = bytearray(), 0, bytearray()
    while place < len(content):
        match = _match(content, place)
        if match is None:
            literal.append(content[place])
            place += 1
        if literal and (match is not None or len(literal) == 32 or place == len(content)):
            out += bytes([len(literal) - 1]) + literal
            literal = bytearray()
        if match is not None:
            distance, length = match
            high, low = divmod(distance - 1, 256)
            short = min(length - 2, 7)
            out += bytes([(short << 5) | high])
            out += bytes([length - 2 - 7]) if short == 7 else b""
            out += bytes([low])
            place += length
    return bytes(out)


def _match(content, place):
    for length in (264, 100, 20, 9, 8, 3):
        piece = content[place : place + length]
        start = content.rfind(piece, max(0, place - 8192), place + length - 1)
        if len(piece) == length and 0 <= start < place:
            return place - start, length
    return None


PLY_HEADER = (
    "ply\nformat {encoding} 1.0\ncomment made by hand\nobj_info nothing\n"
    "element camera 2\nproperty float view\nproperty uchar kind\n"
    "element vertex {n}\nproperty uchar intensity\nproperty double x\nproperty float y\n"
    "property float32 z\nproperty int16 ring\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


def ply_ascii(xyz=XYZ):
    lines = ["0.5 1", "0.25 2"]
    lines += [f"7 {x!r} {y!r} {z!r} -3" for x, y, z in xyz.tolist()]
    header = PLY_HEADER.format(encoding="ascii", n=len(xyz))
    return (header + "\n".join([*lines, "3 0 1 2"]) + "\n").encode()


def ply_binary(order, xyz=XYZ):
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    rows = b"".join(
        struct.pack(f"{order}Bdffh", 7, x, y, z, -3) for x, y, z in xyz.astype(float).tolist()
    )
    cameras = struct.pack(f"{order}fBfB", 0.5, 1, 0.25, 2)
    face = struct.pack(f"{order}Biii", 3, 0, 1, 2)
    return PLY_HEADER.format(encoding=name, n=len(xyz)).encode() + cameras + rows + face


def kitti_bin(xyz=XYZ):
    return np.hstack([xyz, np.full((len(xyz), 1), 0.5)]).astype("<f4").tobytes()
