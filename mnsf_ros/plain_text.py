# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Names and messages of others as text that does nothing to a terminal and fits into any file."""

from __future__ import annotations

import re
from typing import Final

# Not decoded from bytes by Python.
_LONE_SURROGATES: Final = re.compile("[\ud800-\udc7f\udd00-\udfff]")
# They move the cursor, change colours, ring, or reverse the direction of writing.
_CONTROL: Final = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def plain_text(text: object) -> str:
    r"""Returns a text, for example a path, as one line that every file and terminal can hold.

    Control characters are shown as `\x1b`. Python keeps the bytes of a file name that its locale
    cannot decode as lone surrogates: those that are UTF-8 after all are decoded, so that the text
    is the same in every locale; the others are shown as `\xff`.
    """
    known = _LONE_SURROGATES.sub(_escaped, str(text))
    decoded = known.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return _CONTROL.sub(_escaped, decoded)


def _escaped(character: re.Match[str]) -> str:
    return character[0].encode("unicode_escape").decode("ascii")
