"""What is wrong with a recording, and where."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Damage:
    """A part of a recording that is lost.

    Attributes:
        file: The file or folder.
        position: Where in it, such as `byte 4711` or `after 30 messages on '/points'`.
        text: What was found there.
    """

    file: str
    position: str
    text: str

    def __str__(self) -> str:
        """One line for people."""
        return ", ".join(filter(None, (self.file, self.position))) + f": {self.text}"
