# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The records of a run as JSON and back; a number that is not finite is `null`."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any, Final, TypeVar

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import UNRECORDED, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings

Kind = TypeVar("Kind")

_MAX_SHOWN: Final = 80
_NAMES: Final = {
    ResultRow: "a result row",
    FinishedTask: "a finished task",
    RunRecord: "the record of a run",
}


def to_json(value: object, *, indent: int | None = None) -> str:
    """Returns a typed object as JSON, without a newline at its end."""
    values = _CONVERTER.unstructure(value)
    return json.dumps(values, indent=indent, allow_nan=False, ensure_ascii=False)


def from_json(text: str, kind: type[Kind]) -> Kind:
    """Returns the typed object in a text.

    Raises:
        EvaluationError: The text holds something else; says in one line what is wrong.
    """
    try:
        return _CONVERTER.structure(json.loads(text), kind)
    except Exception as error:  # cattrs raises groups of whatever its hooks raise
        reason = cattrs.transform_error(error, path="")[0].removesuffix(" @ ")
        shown = " ".join(text[:_MAX_SHOWN].split())
        name = _NAMES.get(kind, kind.__name__)
        raise EvaluationError(f"is not {name} ({reason}): {shown!r}") from error


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook(float, _number)
    converter.register_unstructure_hook(float, lambda x: x if math.isfinite(x) else None)
    converter.register_structure_hook_func(lambda kind: kind == SettingValue, lambda x, _: x)
    converter.register_structure_hook(Settings, lambda values, _: _settings(**values))
    converter.register_unstructure_hook(
        Settings, lambda one: {"values": one.to_mapping(), "explicit": sorted(one.explicit)}
    )
    unrecorded: dict[type[Any], tuple[str, ...]] = {
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


def _number(value: Any, _: type) -> float:  # noqa: ANN401 - whatever JSON has there
    return math.nan if value is None else float(value)


def _settings(values: dict[str, object], explicit: list[str]) -> Settings:
    return replace(Settings().changed(values), explicit=frozenset(explicit))


_CONVERTER: Final = _converter()
