"""Result rows <-> JSON that any program can read: a number that is none (NaN) is `null`."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any, Final, get_type_hints

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.result_row import ResultRow

_OF_ERRORS: Final = ("errors", "by_range", "by_speed")
_KINDS: Final[dict[str, Any]] = get_type_hints(ResultRow)


def row_to_json(row: ResultRow) -> str:
    """Returns a row as one line of JSON, without its end."""
    return json.dumps(plain(dataclasses.asdict(row)), allow_nan=False, ensure_ascii=False)


def row_from_json(line: str) -> ResultRow:
    """Returns the row that a line of JSON holds.

    Raises:
        EvaluationError: It is no result row.
    """
    try:
        values = json.loads(line)
        names = {field.name for field in dataclasses.fields(ResultRow)}
        if not isinstance(values, dict) or not values.keys() <= names:
            raise EvaluationError(f"is no result row: {line[:80]!r}")
        for name in _OF_ERRORS:
            groups = values.get(name, {}).items()
            values[name] = {key: FlowErrors(**_numbers(errors)) for key, errors in groups}
        return ResultRow(**{name: _value(name, value) for name, value in values.items()})
    except (ValueError, TypeError, AttributeError) as error:
        raise EvaluationError(f"is no result row ({error}): {line[:80]!r}") from error


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Returns a value with None in place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _value(name: str, value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    if name in _OF_ERRORS:
        return value
    return math.nan if value is None and _KINDS[name] is float else _numbers(value)


def _numbers(value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Puts NaN back where there is None."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    return math.nan if value is None else value
