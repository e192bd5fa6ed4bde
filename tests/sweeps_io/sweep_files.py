# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweep files of every format, written byte by byte as their documents say."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest

# Exact in float32; a row without a point; one far away.
XYZ = np.array(
    [[1.5, -2.25, 0.125], [np.nan, np.nan, np.nan], [-70.0, 3.0, 1.0], [8.0, 8.5, -1.75]],
    dtype=np.float32,
)

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


def pcd_compressed(xyz=XYZ):
    """LZF that compresses nothing: runs of up to 32 bytes as they are."""
    rows = pcd_rows(xyz)
    content = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    pieces = [content[start : start + 32] for start in range(0, len(content), 32)]
    data = b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)
    header = PCD_HEADER.format(n=len(xyz), encoding="binary_compressed").encode()
    return header + struct.pack("<II", len(data), len(content)) + data


def kitti_bin(xyz=XYZ):
    return np.hstack([xyz, np.full((len(xyz), 1), 0.5)]).astype("<f4").tobytes()


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def feather(xyz=XYZ):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather as writer

    columns = {name: xyz[:, axis] for axis, name in enumerate("xyz")}
    table = pyarrow.table({"intensity": np.arange(len(xyz)), **columns})
    stream = io.BytesIO()
    writer.write_feather(table, stream)
    return stream.getvalue()
