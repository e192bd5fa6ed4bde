# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Groups and arrays that an HDF5 file holds itself, never larger than a sweep can be.

The format can lead to any other file: by links, virtual data sets and external storage. Errors are
those of h5py, or a ValueError that names the group or data set: see `files.UNREADABLE`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.source_files import as_type
from mnsf_ros.decompression import check_size, decompress
from mnsf_ros.sweeps_io.files import require

if TYPE_CHECKING:
    from numpy.typing import DTypeLike, NDArray

# Kinds of NumPy types: bool, integers, floats.
_REAL: Final = "biuf"
# Numbers of filters of HDF5, in the order in which programs apply them.
_SHUFFLE, _GZIP, _FLETCHER32 = 2, 1, 3
_FILTERS: Final = (_SHUFFLE, _GZIP, _FLETCHER32)


def group(parent: Any, name: str) -> Any:  # noqa: ANN401
    """Returns a group that is in the file, or in a group of it.

    Raises:
        ValueError: The name is that of something else, or leads out of its place.
    """
    return _member(parent, name, "Group")


def array(parent: Any, name: str, dtype: DTypeLike) -> NDArray[Any]:  # noqa: ANN401
    """Returns the numbers of a data set in a group, in the type asked for.

    Raises:
        ValueError: They are not in the file itself, no numbers, or too large.
        FloatingPointError: One of them does not exist in that type.
    """
    data = _member(parent, name, "Dataset")
    try:
        _check(data, np.dtype(dtype))
        return as_type(data, dtype)
    except ValueError as error:
        raise ValueError(f"data set {name!r}: {error}") from error


def _check(data: Any, dtype: np.dtype[Any]) -> None:  # noqa: ANN401
    """Checks where the values of a data set are and how large it is, before any is read."""
    if data.is_virtual or data.external:
        place = repr(data.external[0][0]) if data.external else "other data sets"
        raise ValueError(f"its values are in {place}, expected them in the file itself")
    # The size of text, objects and lists of any length is that of a pointer.
    if data.shape is None or data.dtype.kind not in _REAL:
        raise ValueError(f"it holds {data.dtype} of shape {data.shape}, expected real numbers")
    check_size(math.prod(data.shape) * max(data.dtype.itemsize, dtype.itemsize), "it")
    if data.chunks:
        _check_chunks(data)


def _member(parent: Any, name: str, kind: str) -> Any:  # noqa: ANN401
    h5py = require("h5py")
    # `get(name, getlink=True)` of h5py would follow the link before it says what it is.
    if parent.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise ValueError(f"{name!r} is a link to another place, expected it in the file itself")
    member = parent[name]
    if not isinstance(member, getattr(h5py, kind)):
        raise ValueError(f"{name!r} is a {type(member).__name__}, expected a {kind}")
    return member


def _check_chunks(data: Any) -> None:  # noqa: ANN401
    """Checks what the chunks expand to: HDF5 itself expands them without a limit."""
    chunk_bytes = math.prod(data.chunks) * data.dtype.itemsize
    check_size(data.id.get_num_chunks() * chunk_bytes, "all chunks together")
    settings = data.id.get_create_plist()
    filters = [settings.get_filter(number)[0] for number in range(settings.get_nfilters())]
    if filters != [one for one in _FILTERS if one in filters]:
        raise ValueError(
            f"it has the filters {filters}, expected none, or of {list(_FILTERS)} (shuffle, gzip, "
            "Fletcher32) in this order; rewrite the file with h5repack"
        )
    if _GZIP not in filters:
        return
    # A chunk may be stored as it is.
    as_it_is = 1 << filters.index(_GZIP)
    chunks: list[Any] = []
    data.id.chunk_iter(chunks.append)
    for chunk in chunks:
        if not chunk.filter_mask & as_it_is:
            check_size(chunk.size, "a chunk")
            decompress("zlib", data.id.read_direct_chunk(chunk.chunk_offset)[1], chunk_bytes)
