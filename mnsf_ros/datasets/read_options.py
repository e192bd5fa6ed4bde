"""What a user may say about a source beside where it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ReadOptions:
    """Options of the formats that take them.

    Attributes:
        sequence: Which sequence to read from a source that holds several.
        labels: Folder of labels that are kept apart from the sweeps.
    """

    sequence: str | None = None
    labels: Path | None = None
