# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The records of a run as JSON and back, also those that earlier versions have written.

A number that is not finite is `null`, so that any program can read it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, TypeVar

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.v import format_exception

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import UNRECORDED, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import DROPPED, FailureKind, FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings, declared_settings

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
    values = _CONVERTER.unstructure(value)
    return json.dumps(values, indent=indent, allow_nan=False, ensure_ascii=False)


def from_json(text: str, kind: type[Kind]) -> Kind:
    """Returns the typed object that a text holds.

    Raises:
        EvaluationError: It is not one; says in one line what is wrong.
    """
    try:
        values = json.loads(text)
        if not isinstance(values, dict):
            raise TypeError("expected an object with named values")
        return _CONVERTER.structure(_of_this_version(values, kind), kind)
    except Exception as error:  # cattrs raises groups of whatever its hooks raise
        reason = cattrs.transform_error(error, path="", format_exception=_reason)[0].removesuffix(
            " @ "
        )
        shown = " ".join(text[:_MAX_SHOWN].split())
        name = _NAMES.get(kind, kind.__name__)
        raise EvaluationError(f"is not {name} ({reason}): {shown!r}") from error


def _of_this_version(values: dict[str, Any], kind: type) -> dict[str, Any]:
    """What an earlier version has written, in the layout of this one."""
    if kind is ResultRow and isinstance(reason := values.get("failure"), str):
        failure = DROPPED.kind if reason == DROPPED.text else FailureKind.FAILED
        return values | {"failure": {"kind": failure.value, "text": reason} if reason else None}
    if kind is RunRecord and "identity" in values:
        values = {"format": 1, **values}
        values["options"] = _old_options(values.pop("identity"))
        values["methods"] = [_old_method(method) for method in values["methods"]]
    return values


def _old_options(identity: dict[str, Any]) -> dict[str, Any]:
    """The options of a run: `settings` was what methods got, `crop_and_ground` chose points."""
    options = dict(identity)
    told = {**options.pop("settings"), **options.pop("crop_and_ground")}
    explicit = options.pop("explicit", None) or []
    known = {one.name: told[one.name] for one in declared_settings() if one.name in told}
    presets = [preset(name).to_mapping() for name in PRESET_NAMES]
    nearest = max(presets, key=lambda values: sum(values[k] == x for k, x in known.items()))
    num_points = None if options["num_points"] == "all" else options["num_points"]
    settings = {"values": {**nearest, **known}, "explicit": explicit}
    return options | {"settings": settings, "num_points": num_points}


def _old_method(method: str | dict[str, Any]) -> dict[str, Any]:
    """A method that was its name, or a name with what is a trait now."""
    if isinstance(method, str):
        return {"name": method, "traits": {"is_reference": method in _OLD_REFERENCES}}
    traits = {key: value for key, value in method.items() if key != "name"}
    return {"name": method["name"], "traits": traits}


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    for kind in (float, int, str, bool):
        converter.register_structure_hook(kind, _checked)
    converter.register_structure_hook_func(lambda kind: kind == SettingValue, _checked)
    converter.register_unstructure_hook(float, lambda x: x if math.isfinite(x) else None)
    converter.register_structure_hook(Settings, lambda values, _: _settings(**values))
    converter.register_unstructure_hook(
        Settings, lambda one: {"values": one.to_mapping(), "explicit": sorted(one.explicit)}
    )
    # What is in recordings may be read again.
    unrecorded: dict[type[Any], Sequence[str]] = {
        EvaluationOptions: UNRECORDED,
        EvaluatedRecording: ("inspection",),
    }
    for owner, names in unrecorded.items():
        left_out: dict[str, Any] = {name: override(omit=True) for name in names}
        structure = make_dict_structure_fn(
            owner, converter, _cattrs_forbid_extra_keys=True, **left_out
        )
        converter.register_structure_hook(owner, structure)
        unstructure = make_dict_unstructure_fn(owner, converter, **left_out)
        converter.register_unstructure_hook(owner, unstructure)
    return converter


def _settings(values: dict[str, object], explicit: list[str]) -> Settings:
    return replace(Settings().changed(values), explicit=frozenset(explicit))


def _reason(error: BaseException, kind: type | None) -> str:
    """What the JSON parser, one of our hooks or cattrs itself found."""
    is_ours = isinstance(error, (TypeError, ValueError, RecursionError)) and bool(error.args)
    return str(error) if is_ours else format_exception(error, kind)


# Type of a value to the types that JSON may have for it, and what an error calls it.
_KINDS: Final[dict[Any, tuple[Any, str]]] = {
    float: ((float, int), "a number"),
    int: ((int,), "a whole number"),
    str: ((str,), "text"),
    bool: ((bool,), "true or false"),
    SettingValue: ((bool, int, float, str), "the value of a setting"),
}


def _checked(value: Any, kind: Any) -> Any:  # noqa: ANN401 - a type or a union of some
    """The value if it has the type; a null is no number."""
    if value is None and kind is float:
        return math.nan
    kinds, expected = _KINDS[kind]
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise TypeError(f"got {value!r}, expected {expected}")
    return float(value) if kind is float else value


_CONVERTER: Final = _converter()
