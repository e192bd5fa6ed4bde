"""Large JSON files that are one list of objects, read object by object."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from mnsf_ros.datasets.source_files import reading

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_CHUNK_CHARACTERS: Final = 1 << 20
_BETWEEN: Final = " \t\r\n,"


def json_rows(path: Path) -> Iterator[dict[str, Any]]:
    """Yields the objects of a list, of which only a part is in memory at a time.

    Raises:
        DatasetError: If the file is missing, cut short, or no list of objects.
    """
    decoder = json.JSONDecoder()
    with reading(path), path.open(encoding="utf-8") as file:
        text = file.read(_CHUNK_CHARACTERS).lstrip()
        if not text.startswith("["):
            raise ValueError("is no JSON list")
        position = 1
        while True:
            while position < len(text) and text[position] in _BETWEEN:
                position += 1
            if text.startswith("]", position):
                return
            try:
                row, position = decoder.raw_decode(text, position)
            except json.JSONDecodeError:
                # The rest of this object may be in the next chunk.
                more = file.read(_CHUNK_CHARACTERS)
                if not more:
                    raise ValueError("the list has no end, the file is cut short") from None
                text, position = text[position:] + more, 0
                continue
            if not isinstance(row, dict):
                raise ValueError(f"the list holds {row!r}, expected objects")
            yield row
