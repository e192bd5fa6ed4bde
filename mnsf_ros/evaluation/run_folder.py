# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
r"""The folder of a run: `run.json` (its record) and `rows.jsonl` (its results, one row per line).

Rows are added during the run, so that an interruption costs nothing but the line being written.
A task is finished if the record lists it and all of its rows are there.

All files are UTF-8 in every locale. Bytes of paths that are not UTF-8 are written as `\udcff`,
which JSON reads back unchanged. Numbers that are not finite are `null`.
"""

import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, Final, TypeVar

import cattrs

from mnsf_ros.errors import DatasetError, EvaluationError
from mnsf_ros.evaluation.options import EvaluationTask, TaskKey
from mnsf_ros.evaluation.pictures import Picture
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.task import FinishedTask, TaskEvent
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps_io.files import new_file

RUN_FILE: Final = "run.json"
ROWS_FILE: Final = "rows.jsonl"
_MAX_SHOWN: Final = 80

Kind = TypeVar("Kind")


class StoppedError(EvaluationError):
    """A run cannot go on, for example because the disk is full; `--resume` continues it."""


class RunFolder:
    """Reads the files of a run, and adds to them: `begin`, then `take`.

    A missing or damaged file raises an EvaluationError, a failed write a StoppedError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._rows = path / ROWS_FILE

    def begin(self, record: RunRecord, *, resume: bool) -> list[EvaluationTask]:
        """Writes the record of the run; returns the tasks that are left to do.

        A resumed run may have more recordings and methods. Its unfinished tasks continue after the
        rows that are there, or start again if rows depend on earlier ones.

        Raises:
            EvaluationError: The folder is not empty and `resume` is not set, or it has no run, or a
                run with other settings or another recording of the same name.
        """
        check_folder(self.path, resume=resume)
        whole, rows = record, list[ResultRow]()
        if _holds_something(self.path):
            before, rows = self.read()
            whole = record.resuming(before, self.path)
        with _writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        tasks = [EvaluationTask(*pair) for pair in product(record.recordings, record.methods)]
        finished = {task.key for task in whole.finished}
        left = [task for task in tasks if task.key not in finished]
        again = {task.key for task in left if record.options.is_indivisible(task.method)}
        rows = [row for row in rows if row.task not in again]
        if self._rows.exists():
            # Removes the line that was being written when a process was killed.
            replace_file(self._rows, "".join(f"{to_json(row)}\n" for row in rows))
        self._write(whole)
        known: dict[TaskKey, set[int]] = defaultdict(set)
        for row in rows:
            known[row.task].add(row.number)
        return [replace(task, skipped=frozenset(known[task.key])) for task in left]

    def take(self, event: TaskEvent) -> None:
        """Writes down an event of a task."""
        if isinstance(event, ResultRow):
            line = to_json(event)
            with _writing(self._rows), self._rows.open("ab") as stream:
                stream.write(f"{line}\n".encode("utf-8", "backslashreplace"))
        elif isinstance(event, FinishedTask) and event.failure is None:
            self._write(replace(self._record, finished=[*self._record.finished, event]))
        elif isinstance(event, Picture):
            file = self.path / event.file
            with _writing(file):
                file.parent.mkdir(parents=True, exist_ok=True)
            replace_file(file, event.image)

    def read(self) -> tuple[RunRecord, list[ResultRow]]:
        """Returns the record of the run, and the rows in the order of their writing.

        Tasks that lack a row are not finished.
        """
        file = self.path / RUN_FILE
        if not file.exists():
            raise EvaluationError(f"{self.path}: holds no run, {RUN_FILE} is missing")
        record = from_json(_text_of(file), RunRecord, str(file))
        *lines, _ = _text_of(self._rows).split("\n")
        rows = [
            from_json(line, ResultRow, f"{self._rows}, line {number}")
            for number, line in enumerate(lines, 1)
        ]
        counts = Counter(row.task for row in rows)
        finished = [one for one in record.finished if counts[one.key] == one.num_examples]
        return replace(record, finished=finished), rows

    def _write(self, record: RunRecord) -> None:
        self._record = record
        replace_file(self.path / RUN_FILE, f"{to_json(record, indent=2)}\n")


def check_folder(out: Path, *, resume: bool) -> None:
    """Checks that nothing would be overwritten.

    Raises:
        EvaluationError: It is not a folder, or it is not empty and `resume` is not set.
    """
    if out.exists() and not out.is_dir():
        raise EvaluationError(f"{out}: is not a folder")
    if _holds_something(out) and not resume:
        raise EvaluationError(f"{out}: exists already; name another folder, or add --resume")


def replace_file(file: Path, content: str | bytes) -> None:
    """Writes a file, or leaves the old one as it is.

    Raises:
        StoppedError: Writing fails.
    """
    if isinstance(content, str):
        content = content.encode("utf-8", "backslashreplace")
    try:
        with new_file(file, overwrite=True) as draft:
            draft.write_bytes(content)
    except DatasetError as error:
        raise StoppedError(str(error)) from error


def to_json(value: object, *, indent: int | None = None) -> str:
    """Returns a typed object as JSON, without a newline at its end."""
    values = _CONVERTER.unstructure(value)
    return json.dumps(values, indent=indent, allow_nan=False, ensure_ascii=False)


def from_json(text: str, kind: type[Kind], place: str) -> Kind:
    """Returns the typed object in a text that was found at a place.

    Raises:
        EvaluationError: The text holds something else; names the place in one line.
    """
    try:
        return _CONVERTER.structure(json.loads(text), kind)
    except Exception as error:  # cattrs raises groups of any errors of its hooks
        reason = cattrs.transform_error(error, path="")[0].removesuffix(" @ ")
        shown = " ".join(text[:_MAX_SHOWN].split())
        raise EvaluationError(f"{place}: cannot be read ({reason}): {shown!r}") from error


def _holds_something(out: Path) -> bool:
    """Whether a folder has files other than drafts."""
    return out.is_dir() and any(not entry.name.startswith(".") for entry in out.iterdir())


@contextmanager
def _writing(file: Path) -> Iterator[None]:
    """Makes a StoppedError of an OSError while a file or folder is written."""
    try:
        yield
    except OSError as error:
        raise StoppedError(f"{file}: cannot be written: {error.strerror or error}") from error


def _text_of(file: Path) -> str:
    """Returns the content of a file, empty if there is none; reading a pipe might never end."""
    if not file.exists():
        return ""
    if not file.is_file():
        raise EvaluationError(f"{file}: is not a file")
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook(float, _number)
    converter.register_unstructure_hook(float, lambda x: x if math.isfinite(x) else None)
    converter.register_structure_hook_func(lambda kind: kind == SettingValue, lambda x, _: x)
    converter.register_structure_hook(Settings, lambda values, _: _settings(**values))
    converter.register_unstructure_hook(
        Settings, lambda one: {"values": one.to_mapping(), "explicit": sorted(one.explicit)}
    )
    return converter


def _number(value: Any, _: type) -> float:  # noqa: ANN401 - any value of JSON
    return math.nan if value is None else float(value)


def _settings(values: dict[str, object], explicit: list[str]) -> Settings:
    return replace(Settings().changed(values), explicit=frozenset(explicit))


_CONVERTER: Final = _converter()
