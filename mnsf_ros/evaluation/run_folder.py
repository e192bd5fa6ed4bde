"""The folder of a run: `run.json`, which says what was run, and its rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_files import WritingError, read_json, replace_file
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.run_rows import LOCK_FILE, RunRows

RUN_FILE: Final = "run.json"


class RunFolder:
    """Reads and writes the files of a run; `start` makes or resumes one.

    Whatever reads raises an EvaluationError if a file is missing or damaged; whatever writes raises
    a WritingError if that fails.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows = RunRows(path)

    def before(self, *, resume: bool) -> RunRecord | None:
        """Returns the record of the run that is there; None if there is nothing yet.

        Raises:
            EvaluationError: The folder holds something and `resume` is not set, or no run, or it
                is none.
        """
        check_folder(self.path, resume=resume)
        return self.read_record() if _holds_something(self.path) else None

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
        before = self.before(resume=resume)
        sessions = [SessionRecord.now(arguments)]
        record = RunRecord(options, list(methods), list(recordings), sessions)
        if before is not None:
            record = record.resuming(before, self.path)
        self.path.mkdir(parents=True, exist_ok=True)
        # Not while another process adds rows: they would be lost.
        with self.rows.locked():
            if before is not None:
                self.rows.cut_off_unfinished_lines()
            try:
                replace_file(self.path / RUN_FILE, [to_json(record, indent=2), "\n"])
            except WritingError:
                if before is None:
                    self.remove_if_unused()
                raise
        return self

    def read_record(self) -> RunRecord:
        """Returns what was run."""
        if not (self.path / RUN_FILE).exists():
            raise EvaluationError(f"{self.path}: holds no run, {RUN_FILE} is missing")
        return read_json(self.path / RUN_FILE, RunRecord)

    def remove_if_unused(self) -> bool:
        """Takes the folder away if it holds nothing but the start of a run; says whether it did."""
        if not {entry.name for entry in self.path.iterdir()} <= {RUN_FILE, LOCK_FILE}:
            return False
        for name in (RUN_FILE, LOCK_FILE):
            (self.path / name).unlink(missing_ok=True)
        self.path.rmdir()
        return True


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
