"""What recordings are called in results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mnsf_ros.evaluation.errors import EvaluationError


def recording_names(paths: Sequence[Path]) -> list[str]:
    """Returns a name for each recording: the last part of its path, or all of it if need be.

    Raises:
        EvaluationError: The same path is named twice.
    """
    twice = [path for path, count in Counter(paths).items() if count > 1]
    if twice:
        raise EvaluationError(f"{twice[0]}: is named {paths.count(twice[0])} times")
    short = [path.stem if path.is_file() else path.resolve().name for path in paths]
    counts = Counter(short)
    return [
        name if counts[name] == 1 else str(path) for name, path in zip(short, paths, strict=True)
    ]
