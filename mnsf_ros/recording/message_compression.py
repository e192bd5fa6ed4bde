"""Messages that the recorder compressed one by one (`--compression-mode message`)."""

from __future__ import annotations

import sys
from typing import Final

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# What every zstd frame begins with. A ROS 2 message begins with a zero byte, so the bytes tell
# for themselves, also in a file that has lost the metadata.yaml which says so.
_FRAME_MAGIC: Final = b"\x28\xb5\x2f\xfd"
# No sensor sends more at a time; a damaged length must not ask for all memory there is.
_MAX_MESSAGE_BYTES: Final = 2**30


def decompressed(raw: bytes) -> bytes:
    """Returns a ROS 2 message as it was before it was compressed, if it was.

    Args:
        raw: CDR bytes, or one zstd frame of them.

    Raises:
        ValueError: The frame claims an impossible size.
        ZstdError: The frame is damaged or cut short; see `bag_errors.UNREADABLE`.
    """
    if raw[: len(_FRAME_MAGIC)] != _FRAME_MAGIC:
        return raw
    size = zstd.get_frame_info(raw).decompressed_size
    if size is not None and size > _MAX_MESSAGE_BYTES:
        raise ValueError(f"compressed message claims {size} bytes")
    return zstd.decompress(raw)
