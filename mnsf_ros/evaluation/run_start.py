"""Starting a run in a new folder or resuming one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import RunFolder, WritingError, plain
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord

# What must be the same when a run goes on; paths may move.
_SAME = ("points", "truth", "odometry", "num_sweeps", "fingerprint")
# Another preset changes dozens of settings; a few of them say as much.
_MAX_TOLD = 5


def start_or_resume(
    out: Path,
    recordings: Sequence[EvaluatedRecording],
    methods: Sequence[EvaluatedMethod],
    options: EvaluationOptions,
    *,
    resume: bool,
    arguments: Sequence[str] = (),
) -> RunFolder:
    """Makes the folder of a run, or takes the one that is there if its rows fit.

    A resumed run may have more recordings and methods. The command line is remembered.

    Raises:
        EvaluationError: The folder holds something and `resume` is not set; or it holds a run with
            other settings or another recording of the same name, which `resume` must not mix with
            this one; or another process is at it.
        WritingError: The record of the run cannot be written.
    """
    check_folder(out, resume=resume)
    folder = RunFolder(out)
    now = RunRecord(
        options=options,
        methods=list(methods),
        recordings=list(recordings),
        sessions=[SessionRecord.now(arguments)],
    )
    is_there = _holds_something(out)
    record = _joined(out, folder.read_record(), now) if is_there else now
    out.mkdir(parents=True, exist_ok=True)
    # Not while another process adds rows: they would be lost.
    with folder.locked():
        if is_there:
            folder.cut_off_unfinished_lines()
        try:
            folder.write_record(record)
        except WritingError:
            if not is_there:
                folder.remove_if_unused()
            raise
    return folder


def known_recordings(out: Path) -> list[EvaluatedRecording]:
    """Returns the records of the recordings that the run in a folder has, if there is one.

    Raises:
        EvaluationError: The folder holds something, but no run that can be read.
    """
    return RunFolder(out).read_record().recordings if _holds_something(out) else []


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


def _joined(out: Path, before: RunRecord, now: RunRecord) -> RunRecord:
    """The record of a run that goes on.

    Raises:
        EvaluationError: It must not.
    """
    if not before.is_of_this_version:
        raise EvaluationError(
            f"{out}: holds a run of another version of mnsf_ros, which cannot be resumed; "
            "name another folder (`mnsf report` still reads this one)"
        )
    differences = _differences(plain(before.options), plain(now.options))
    if differences:
        listed = "; ".join(differences[:_MAX_TOLD])
        more = len(differences) - _MAX_TOLD
        end = f"; and {more} more" if more > 0 else ""
        raise EvaluationError(f"{out}: holds a run with other settings: {listed}{end}")
    return RunRecord(
        options=before.options,
        methods=list({one.name: one for one in (*before.methods, *now.methods)}.values()),
        recordings=_joined_recordings(out, before.recordings, now.recordings),
        sessions=[*before.sessions, *now.sessions],
    )


def _joined_recordings(
    out: Path, before: Sequence[EvaluatedRecording], now: Sequence[EvaluatedRecording]
) -> list[EvaluatedRecording]:
    joined = {recording.name: recording for recording in before}
    for new in now:
        old = joined.get(new.name, new)
        differences = _differences(
            *({name: plain(one)[name] for name in _SAME} for one in (old, new))
        )
        if differences:
            listed = "; ".join(differences)
            raise EvaluationError(f"{out}: holds another recording {new.name!r}: {listed}")
        # Where it lies now, and what of it could not be read, now or then.
        damages = list(dict.fromkeys([*old.damages, *new.damages]))
        has_checksums = old.has_checksums and new.has_checksums
        joined[new.name] = replace(new, damages=damages, has_checksums=has_checksums)
    return list(joined.values())


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    before, now = _flat(old), _flat(new)
    return [
        f"{name} was {before.get(name)}, is {now.get(name)}"
        for name in sorted({*before, *now})
        if before.get(name) != now.get(name)
    ]


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}: ")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
