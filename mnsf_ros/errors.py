# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The errors that callers of this package may catch, and texts that fit into any line."""

import re
import reprlib
import sys
from collections.abc import Iterable
from typing import Final


class MnsfError(Exception):
    """Root of all errors raised on purpose by `mnsf_ros`; its text is one line for the user."""


class SettingsError(MnsfError, ValueError):
    """A setting is unknown, of the wrong type or out of its range."""


class LibraryError(SettingsError):
    """A method needs a Python library that is not installed, or cannot be imported."""


class SweepError(MnsfError, ValueError):
    """A sweep cannot be used, for example because too few of its points are left."""


class OptimizationError(MnsfError):
    """An optimization produced no finite flow."""


class MethodError(MnsfError):
    """A method that is another program or package gave no usable flow."""


class CancelledError(MnsfError):
    """An estimate was abandoned because its caller asked for it (shutdown, cancel)."""


class RecordingError(MnsfError):
    """A recording is missing, damaged, or lacks the requested data."""


class DatasetError(MnsfError):
    """Files of a data set are missing, damaged, or laid out in another way."""


class EvaluationError(MnsfError, ValueError):
    """Flows, masks, table rows or the files of a run do not fit together, or cannot be scored."""


# Not decoded from bytes by Python.
_SHORTENER: Final = reprlib.Repr()
_SHORTENER.maxstring = _SHORTENER.maxlong = _SHORTENER.maxother = 500
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


def shortened(value: object) -> str:
    """Returns the `repr` of a value, without the middle if it is very long."""
    return _SHORTENER.repr(value)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Returns the nearest known names, as the end of a message; empty if none is near."""
    import difflib

    near = difflib.get_close_matches(name, known, n=3)
    return f"; did you mean {' or '.join(near)}?" if near else ""


# Parsers fail on damaged files with errors of any kind: a wrong length, name or number surfaces as
# the error of whatever stumbled over it. Catch this only around calls into libraries.
UNREADABLE: Final = Exception
_MAX_LENGTH: Final = 300


def reason(error: BaseException) -> str:
    """Returns the cause of an error of a library as one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, MemoryError):
        return "it takes more memory than the limit"
    text = " ".join(str(error).split())[:_MAX_LENGTH].rstrip(".")
    # A KeyError's text is only the key.
    return f"it has no {text}" if isinstance(error, KeyError) else text or type(error).__name__


def one_line(error: BaseException) -> str:
    """Returns an error of other people's code as one line of at most some hundred characters."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:_MAX_LENGTH]}"


def is_caused_by(error: BaseException | None, kind: type[BaseException]) -> bool:
    """Returns whether an error is of a kind, or came of one that is.

    Libraries make another error of a signal that they meet: compiled loops a SystemError.
    """
    while error is not None and not isinstance(error, kind):
        error = error.__cause__ or error.__context__
    return error is not None


# Library to the extra of setup.py that installs it.
_EXTRAS: Final = {
    **dict.fromkeys(("cattrs", "jinja2", "matplotlib", "pandas"), "evaluation"),
    **dict.fromkeys(("pyarrow", "h5py"), "datasets"),
    "optuna": "tune",
    "ray": "ray",
}

_REMEDIES: Final = {
    **{name: f"in the checkout: pip install '.[{extra}]'" for name, extra in _EXTRAS.items()},
    # From the default index, PyTorch takes gigabytes of CUDA.
    **dict.fromkeys(
        ("torch", "edt"),
        "in the checkout: make complete, or PyTorch (pytorch.org) and then "
        "pip install '.[networks]' (or use a method without networks, for example online)",
    ),
    "rclpy": "source your ROS 2 (source /opt/ros/jazzy/setup.bash), or install its wheels (in the "
    "checkout: pip install '.[wheels]')",
}


def library_missing(error: ModuleNotFoundError) -> str:
    """Returns one line: the missing library, the Python it is missing for, and the remedy."""
    name = (error.name or str(error)).partition(".")[0]
    remedy = _REMEDIES.get(
        name,
        "see Install in README.md; in a workspace of ROS 2, build with 'python3 -m colcon build' "
        "in the virtual environment that has it",
    )
    return f"the Python library {name!r} is not installed for {sys.executable}: {remedy}"
