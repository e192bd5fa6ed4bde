"""Checksums for mcap files whose writer left them out."""

from __future__ import annotations

import struct
import sys
import zlib
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from mcap.opcode import Opcode

from mnsf_ros.recording.mcap_records import MAGIC, RECORD_HEAD

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# Of a chunk: first and last time, size and checksum of its content, then how it is compressed.
_CHUNK_HEAD: Final = struct.Struct("<QQQII")
_CHECKSUM: Final = struct.Struct("<I")
_CHECKSUM_OFFSET: Final = 24
_SIZE: Final = struct.Struct("<Q")


@contextmanager
def checksums_added(folder: Path) -> Iterator[None]:
    """Completes the mcap file that a block leaves in a folder, if the block ends well.

    Raises:
        OSError: The file cannot be read or written.
    """
    yield
    (file,) = folder.glob("*.mcap")
    add_checksums(file)


def add_checksums(path: Path) -> None:
    """Fills in the checksum of each chunk, so that flipped bits in it will be noticed.

    The place for it is there in any chunk, with a zero that says that there is none; nothing else
    in the file changes. (rosbags writes zeros.)

    Args:
        path: An intact mcap file, uncompressed or compressed with zstd.

    Raises:
        OSError: It cannot be read or written.
    """
    with path.open("r+b") as file:
        file.seek(len(MAGIC))
        while head := file.read(RECORD_HEAD.size):
            opcode, length = RECORD_HEAD.unpack(head)
            start = file.tell()
            if opcode == Opcode.DATA_END:
                return
            if opcode == Opcode.CHUNK:
                checksum = zlib.crc32(_content(file))
                file.seek(start + _CHECKSUM_OFFSET)
                file.write(_CHECKSUM.pack(checksum))
            file.seek(start + length)


def _content(file: BinaryIO) -> bytes:
    """The records in a chunk whose head comes next."""
    *_, length = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
    compression = file.read(length)
    (size,) = _SIZE.unpack(file.read(_SIZE.size))
    data = file.read(size)
    return zstd.decompress(data) if compression == b"zstd" else data
