"""The one error of this package, and how values from a message are shown in its text."""

from __future__ import annotations

import reprlib


class MessageError(ValueError):
    """A message that cannot be decoded, or arrays that cannot be encoded as one."""


def _bounded_repr() -> reprlib.Repr:
    shortener = reprlib.Repr()
    shortener.maxstring = shortener.maxother = 80
    shortener.maxlist = shortener.maxtuple = 64
    return shortener


# A message is sent by anybody: its values must neither break a log line nor fill the log.
_SHORTENER = _bounded_repr()


def describe(value: object) -> str:
    """Give the `repr` of a value on one line, shortened in the middle if it is very long."""
    return _SHORTENER.repr(value).replace("\n", " ")
