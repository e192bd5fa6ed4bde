"""Paths as text that every file and terminal can hold."""

from __future__ import annotations

from pathlib import Path


def path_text(path: Path | str) -> str:
    r"""Returns a path, or text with paths in it, without what no encoding knows.

    Python keeps the bytes of a file name that its locale cannot decode as lone surrogates. Those
    that are UTF-8 after all are decoded, so that the text is the same in every locale; the others
    are shown as `\xff`.
    """
    return str(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
