r"""The typed parts of a run <-> JSON that any program can read.

A number that is not finite is `null`. What cannot be encoded, as bytes of a path that are no text,
is for the writer of the file to escape.
"""

from __future__ import annotations

import json
import math
from typing import Any, Final, TypeVar

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.v import format_exception

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.options import ALL_POINTS
from mnsf_ros.evaluation.result_row import DROPPED, FailureKind, FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import OLD_FORMAT, RunIdentity, RunRecord
from mnsf_ros.settings import SettingValue

Kind = TypeVar("Kind")

_MAX_SHOWN: Final = 80
_NAMES: Final = {
    ResultRow: "a result row",
    FinishedTask: "a finished task",
    RunRecord: "the record of a run",
}
# Reference rows of runs that do not say so themselves.
_OLD_REFERENCES: Final = ("zero", "ego")


def to_json(value: object, *, indent: int | None = None) -> str:
    """Returns a typed object as JSON, without a newline at its end."""
    return json.dumps(plain(value), indent=indent, allow_nan=False, ensure_ascii=False)


def from_json(text: str, kind: type[Kind]) -> Kind:
    """Returns the typed object that a text holds.

    Raises:
        EvaluationError: It is not one; says in one line what is wrong.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise _not_one(kind, str(error), text) from error
    return structured(values, kind)


def plain(value: object) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Returns a typed object as dictionaries, lists and values of JSON."""
    return _CONVERTER.unstructure(value)


def structured(values: Any, kind: type[Kind]) -> Kind:  # noqa: ANN401 - whatever JSON can hold
    """Returns the typed object of dictionaries and lists; the counterpart of `plain`.

    Raises:
        EvaluationError: A key is unknown or missing, or a value has another type.
    """
    try:
        if not isinstance(values, dict):
            raise TypeError("expected an object with named values")
        return _CONVERTER.structure(_of_this_version(values, kind), kind)
    except Exception as error:  # cattrs raises groups of whatever its hooks raise
        reason = cattrs.transform_error(error, path="", format_exception=_reason)[0]
        raise _not_one(kind, reason, json.dumps(values, ensure_ascii=False)) from error


def _not_one(kind: type, reason: str, text: str) -> EvaluationError:
    return EvaluationError(
        f"is not {_NAMES.get(kind, kind.__name__)} ({reason}): {text[:_MAX_SHOWN]!r}"
    )


def _of_this_version(values: dict[str, Any], kind: type) -> dict[str, Any]:
    """What an earlier version has written, in the layout of this one."""
    if kind is ResultRow and isinstance(reason := values.get("failure"), str):
        failure = DROPPED.kind if reason == DROPPED.text else FailureKind.FAILED
        return values | {"failure": {"kind": failure.value, "text": reason} if reason else None}
    if kind is RunRecord and "format" not in values:
        methods = [
            {"name": name, "is_reference": name in _OLD_REFERENCES}
            for name in values.get("methods", ())
        ]
        return values | {"format": OLD_FORMAT, "methods": methods}
    return values


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    for kind, check in ((float, _float), (int, _int), (str, _str), (bool, _bool)):
        converter.register_structure_hook(kind, lambda value, _, check=check: check(value))
    converter.register_structure_hook_func(lambda kind: kind == SettingValue, _setting)
    converter.register_unstructure_hook(float, lambda x: x if math.isfinite(x) else None)
    # `all` in the files, None here.
    points = override(
        struct_hook=lambda value, _: None if value == ALL_POINTS else _int(value),
        unstruct_hook=lambda value: ALL_POINTS if value is None else value,
    )
    converter.register_structure_hook(
        RunIdentity,
        make_dict_structure_fn(
            RunIdentity, converter, _cattrs_forbid_extra_keys=True, num_points=points
        ),
    )
    converter.register_unstructure_hook(
        RunIdentity, make_dict_unstructure_fn(RunIdentity, converter, num_points=points)
    )
    return converter


def _reason(error: BaseException, kind: type | None) -> str:
    """What one of our hooks found, or cattrs itself."""
    is_ours = isinstance(error, (TypeError, ValueError)) and bool(error.args)
    return str(error) if is_ours else format_exception(error, kind)


def _float(value: object) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"got {value!r}, expected a number")
    return float(value)


def _int(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"got {value!r}, expected a whole number")
    return value


def _str(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"got {value!r}, expected text")
    return value


def _bool(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"got {value!r}, expected true or false")
    return value


def _setting(value: object, _: object) -> SettingValue:
    if not isinstance(value, (bool, int, float, str)):
        raise TypeError(f"got {value!r}, expected the value of a setting")
    return value


_CONVERTER: Final = _converter()
