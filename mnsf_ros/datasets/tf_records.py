"""TFRecord files: records of bytes, one after the other."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.source_files import reading

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HEADER: Final = struct.Struct("<QI")
_FOOTER_BYTES: Final = 4
_CASTAGNOLI: Final = 0x82F63B78


def tf_records(path: Path) -> Iterator[bytes]:
    """Yields the records of an uncompressed file.

    The checksum of the length of a record is compared, which tells other files apart; that of
    its content is not, since without a library for it this takes longer than all the rest.

    Raises:
        DatasetError: If the file is missing, is none of these, is empty, or is cut short.
    """
    with reading(path), path.open("rb") as file:
        index = 0
        while header := file.read(_HEADER.size):
            if len(header) < _HEADER.size:
                raise DatasetError(f"{path}: is cut short in the header of record {index}")
            length, checksum = _HEADER.unpack(header)
            if checksum != _masked_checksum(header[:8]):
                raise DatasetError(
                    f"{path}: checksum of record {index} is wrong; "
                    "it is damaged or no uncompressed TFRecord file"
                )
            record = file.read(length)
            if len(record) < length or len(file.read(_FOOTER_BYTES)) < _FOOTER_BYTES:
                raise DatasetError(f"{path}: is cut short in record {index}")
            yield record
            index += 1
    if index == 0:
        raise DatasetError(f"{path}: is empty")


def _masked_checksum(data: bytes) -> int:
    """CRC-32C, rotated and shifted as TFRecord wants it."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_CASTAGNOLI if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & 0xFFFFFFFF
