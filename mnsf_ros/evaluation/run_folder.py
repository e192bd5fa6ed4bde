"""The folder of a run: what it was, its rows as they get ready, and which tasks are done.

`run.json` says what was run. `rows.jsonl` has one row per line, in the order in which they got
ready; `tasks.jsonl` one line per finished task, with what was noticed. Both only ever grow while
a run lasts, so that an interruption costs nothing but the line being written.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions, TaskKey
from mnsf_ros.evaluation.recordings import EvaluatedRecording, path_text
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_json import Kind, from_json, to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord

RUN_FILE: Final = "run.json"
ROWS_FILE: Final = "rows.jsonl"
TASKS_FILE: Final = "tasks.jsonl"
_LOCK_FILE: Final = ".lock"


class WritingError(EvaluationError):
    """A file of a run cannot be written, as on a full disk; what was there before still is."""


class RunFolder:
    """Reads and writes the files of a run; `start` makes or resumes one.

    Whatever reads raises an EvaluationError if a file is missing or damaged; whatever writes raises
    a WritingError if that fails.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def known_recordings(self) -> list[EvaluatedRecording]:
        """Returns the recordings of the run that is there; none if there is nothing yet."""
        return self.read_record().recordings if _holds_something(self.path) else []

    def start(
        self,
        recordings: Sequence[EvaluatedRecording],
        methods: Sequence[EvaluatedMethod],
        options: EvaluationOptions,
        *,
        resume: bool,
        arguments: Sequence[str] = (),
    ) -> RunFolder:
        """Makes the folder, or takes the run that is there if its rows fit; returns itself.

        A resumed run may have more recordings and methods. The command line is remembered.

        Raises:
            EvaluationError: The folder holds something and `resume` is not set; or it holds a run
                with other settings or another recording of the same name, which `resume` must not
                mix with this one; or another process is at it.
            WritingError: The record of the run cannot be written.
        """
        check_folder(self.path, resume=resume)
        is_there = _holds_something(self.path)
        sessions = [SessionRecord.now(arguments)]
        record = RunRecord(options, list(methods), list(recordings), sessions)
        if is_there:
            record = record.resuming(self.read_record(), self.path)
        self.path.mkdir(parents=True, exist_ok=True)
        # Not while another process adds rows: they would be lost.
        with self.locked():
            if is_there:
                self._cut_off_unfinished_lines()
            try:
                replace_file(self.path / RUN_FILE, [to_json(record, indent=2), "\n"])
            except WritingError:
                if not is_there:
                    self.remove_if_unused()
                raise
        return self

    def read_record(self) -> RunRecord:
        """Returns what was run."""
        if not (self.path / RUN_FILE).exists():
            raise EvaluationError(f"{self.path}: holds no run, {RUN_FILE} is missing")
        return read_json(self.path / RUN_FILE, RunRecord)

    def rows(self) -> Iterator[ResultRow]:
        """Yields all rows, in the order in which they got ready."""
        return _parsed(self.path / ROWS_FILE, ResultRow)

    def numbers(self) -> dict[TaskKey, set[int]]:
        """Returns the numbers of the sweeps of all rows, by recording and method."""
        numbers: dict[TaskKey, set[int]] = {}
        for row in self.rows():
            numbers.setdefault((row.recording, row.method), set()).add(row.number)
        return numbers

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

    def _cut_off_unfinished_lines(self) -> None:
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


def check_folder(out: Path, *, resume: bool) -> None:
    """Makes sure that nothing would be overwritten.

    Raises:
        EvaluationError: The folder holds something and `resume` is not set, or is none.
    """
    if out.exists() and not out.is_dir():
        raise EvaluationError(f"{out}: is not a folder")
    if _holds_something(out) and not resume:
        raise EvaluationError(f"{out}: exists already; name another folder, or add --resume")


def _holds_something(out: Path) -> bool:
    return out.is_dir() and any(out.iterdir())


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
