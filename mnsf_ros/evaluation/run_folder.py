"""The folder of a run: what it was, its rows as they get ready, and which tasks are done.

`run.json` says what was run. `rows.jsonl` has one row per line, in the order in which they got
ready; `tasks.jsonl` one line per finished task, with what was noticed. Both only ever grow while
a run lasts, so that an interruption costs nothing but the line being written.

A number that is not finite is `null`, so that any program can read the files.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.v import format_exception

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, TaskKey
from mnsf_ros.evaluation.recordings import EvaluatedRecording, path_text
from mnsf_ros.evaluation.results import DROPPED, FailureKind, FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings, SettingValue, declared_settings

RUN_FILE: Final = "run.json"
ROWS_FILE: Final = "rows.jsonl"
TASKS_FILE: Final = "tasks.jsonl"
_LOCK_FILE: Final = ".lock"

Kind = TypeVar("Kind")

_MAX_SHOWN: Final = 80
_NAMES: Final = {
    ResultRow: "a result row",
    FinishedTask: "a finished task",
    RunRecord: "the record of a run",
}
# Reference rows of runs that do not say so themselves.
_OLD_REFERENCES: Final = ("zero", "ego")


class WritingError(EvaluationError):
    """A file of a run cannot be written, as on a full disk; what was there before still is."""


class RunFolder:
    """Reads and writes the files of a run; `start_or_resume` opens one for writing.

    Whatever reads raises an EvaluationError if a file is missing or damaged; whatever writes raises
    a WritingError if that fails.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read_record(self) -> RunRecord:
        """Returns what was run."""
        if not (self.path / RUN_FILE).exists():
            raise EvaluationError(f"{self.path}: holds no run, {RUN_FILE} is missing")
        return read_json(self.path / RUN_FILE, RunRecord)

    def write_record(self, record: RunRecord) -> None:
        """Writes what is run."""
        replace_file(self.path / RUN_FILE, [to_json(record, indent=2), "\n"])

    def rows(self) -> Iterator[ResultRow]:
        """Yields all rows, in the order in which they got ready."""
        return _parsed(self.path / ROWS_FILE, ResultRow)

    def read_finished(self) -> dict[TaskKey, FinishedTask]:
        """Returns recording and method of each finished task, and what was noticed."""
        tasks = _parsed(self.path / TASKS_FILE, FinishedTask)
        return {(task.recording, task.method): task for task in tasks}

    def append_row(self, row: ResultRow) -> None:
        """Adds a row."""
        _append(self.path / ROWS_FILE, to_json(row))

    def append_finished(self, key: TaskKey, findings: Findings, num_examples: int) -> None:
        """Adds a finished task."""
        counts = {event.value: count for event, count in findings.counts.items()}
        damages = [path_text(str(damage)) for damage in findings.damages]
        _append(self.path / TASKS_FILE, to_json(FinishedTask(*key, num_examples, counts, damages)))

    def drop_rows_of(self, keys: Iterable[TaskKey]) -> None:
        """Takes the rows of some tasks away."""
        dropped = set(keys)
        rows = (row for row in self.rows() if (row.recording, row.method) not in dropped)
        replace_file(self.path / ROWS_FILE, (f"{to_json(row)}\n" for row in rows))

    def cut_off_unfinished_lines(self) -> None:
        """Takes away what was being written when a run was killed."""
        for name in (ROWS_FILE, TASKS_FILE):
            replace_file(self.path / name, (f"{line}\n" for line in _lines(self.path / name)))

    def remove_if_unused(self) -> bool:
        """Takes the folder away if it holds nothing but the start of a run; says whether it did."""
        if not {entry.name for entry in self.path.iterdir()} <= {RUN_FILE, _LOCK_FILE}:
            return False
        for name in (RUN_FILE, _LOCK_FILE):
            (self.path / name).unlink(missing_ok=True)
        self.path.rmdir()
        return True

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other processes from writing to the same folder; an EvaluationError if one does."""
        with (self.path / _LOCK_FILE).open("a", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise EvaluationError(f"{self.path}: another process is writing to it") from error
            yield


def read_json(file: Path, kind: type[Kind]) -> Kind:
    """Returns the typed object that a file holds.

    Raises:
        EvaluationError: It cannot be read, or holds something else.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error
    try:
        return from_json(text, kind)
    except EvaluationError as error:
        raise EvaluationError(f"{file}: {error}") from error


def _parsed(file: Path, kind: type[Kind]) -> Iterator[Kind]:
    number = 0
    try:
        for line in _lines(file):
            number += 1
            yield from_json(line, kind)
    except EvaluationError as error:
        raise EvaluationError(f"{file}, line {number}: {error}") from error


def _lines(file: Path) -> Iterator[str]:
    """The complete lines of a file; a last one without an end was being written and is lost."""
    try:
        # One at a time: the rows of many recordings are too much for the memory.
        with file.open(encoding="utf-8", newline="\n") as stream:
            for line in stream:
                if line.endswith("\n"):
                    yield line[:-1]
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error


def _append(file: Path, line: str) -> None:
    with _writing(file), file.open("a", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(f"{line}\n")


def replace_file(file: Path, parts: Iterable[str]) -> None:
    r"""Writes a file so that it is there as a whole, the old or the new one, at any time.

    It is UTF-8 in every locale. What cannot be encoded, as bytes of a path that are no text, is
    written as `\udcff`, which is read back from JSON as it was.

    Raises:
        WritingError: That fails; the old file is still there.
    """
    draft = file.with_name(f".{file.name}.new")
    with _writing(file):
        try:
            with draft.open("w", encoding="utf-8", errors="backslashreplace") as stream:
                stream.writelines(parts)
                stream.flush()
                os.fsync(stream.fileno())
            draft.replace(file)
        finally:
            draft.unlink(missing_ok=True)


@contextmanager
def _writing(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise WritingError(f"{file}: cannot be written: {error.strerror or error}") from error


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
    # A resumed run may write flow or not, as it likes; what is in recordings may be read again.
    for owner, name in ((EvaluationOptions, "flow_folder"), (EvaluatedRecording, "inspection")):
        left_out: dict[str, Any] = {name: override(omit=True)}
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
    """What one of our hooks found, or cattrs itself."""
    is_ours = isinstance(error, (TypeError, ValueError)) and bool(error.args)
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
