"""Starting a run in a new folder or resuming one, and what its recordings are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluatedRecording, EvaluationOptions
from mnsf_ros.evaluation.run_folder import RunFolder, WritingError, plain
from mnsf_ros.evaluation.run_record import RecordingRecord, RunRecord, SessionRecord, path_text
from mnsf_ros.recording.bag_files import fingerprint, storage_files

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
        recordings=[RecordingRecord.of(recording) for recording in recordings],
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


def known_recordings(out: Path) -> list[RecordingRecord]:
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
    out: Path, before: Sequence[RecordingRecord], now: Sequence[RecordingRecord]
) -> list[RecordingRecord]:
    joined = {recording.name: recording for recording in before}
    for new in now:
        old = joined.get(new.name)
        joined[new.name] = new if old is None else _joined_recording(out, old, new)
    return list(joined.values())


def _joined_recording(out: Path, old: RecordingRecord, new: RecordingRecord) -> RecordingRecord:
    differences = _differences(*({name: plain(one)[name] for name in _SAME} for one in (old, new)))
    if differences:
        listed = "; ".join(differences)
        raise EvaluationError(f"{out}: holds another recording {new.name!r}: {listed}")
    # Where it lies now, and what of it could not be read, now or then.
    damages = list(dict.fromkeys([*old.damages, *new.damages]))
    return replace(new, damages=damages, has_checksums=old.has_checksums and new.has_checksums)


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


def recording_names(paths: Sequence[Path], known: Sequence[RecordingRecord] = ()) -> list[str]:
    """Returns a name for each recording: the last part of its path, or all of it if need be.

    Those known to a run keep their names, also where they have moved; others get one that is free.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
    """
    _check_each_once(paths)
    names = _known_names(paths, known)
    taken = {record.name for record in known}
    short = {path: short_name(path) for path in paths if path not in names}
    counts = Counter(chain(short.values(), taken))
    for path, name in short.items():
        names[path] = name if counts[name] == 1 else _free_name(path, taken)
        taken.add(names[path])
    return [names[path] for path in paths]


def _check_each_once(paths: Sequence[Path]) -> None:
    for path, times in Counter(paths).items():
        if times > 1:
            raise EvaluationError(f"{path}: is named {times} times")
    owners: dict[Path, Path] = {}
    for path in paths:
        for file in storage_files(path):
            owner = owners.setdefault(file, path)
            if owner != path:
                raise EvaluationError(f"{path}: is the same recording as {owner}; name it once")


def _known_names(paths: Sequence[Path], known: Sequence[RecordingRecord]) -> dict[Path, str]:
    """The names of recordings that a run has already."""
    left = {record.name: record for record in known}
    names: dict[Path, str] = {}
    # Read once: that is up to some megabytes of each file.
    contents = {path: _content(path) for path in paths if known}
    # Copies may lie side by side, and another recording where one was before it moved. One that
    # is like none, but lies or is called as one, is for `start_or_resume` to compare.
    for key_of_path, key_of_record in (
        (
            lambda path: (_files(path), contents[path]),
            lambda one: (_files(one.path), one.fingerprint),
        ),
        (contents.__getitem__, lambda one: one.fingerprint),
        (_files, lambda one: _files(one.path)),
        (short_name, lambda one: one.name),
    ):
        names_of = {repr(key_of_record(record)): name for name, record in left.items()}
        for path in (path for path in paths if path not in names and names_of):
            name = names_of.pop(repr(key_of_path(path)), None)
            if name is not None:
                names[path] = name
                del left[name]
    return names


def _files(path: Path | str) -> list[Path]:
    return storage_files(Path(path))


def _content(path: Path) -> dict[str, Any]:
    try:
        return fingerprint(path)
    except OSError:
        # Whoever reads it says why it cannot be read.
        return {}


def short_name(path: Path) -> str:
    """Returns the last part of a path."""
    return path_text(path.stem if path.is_file() else path.resolve().name)


def _free_name(path: Path, taken: set[str]) -> str:
    whole = path_text(path.resolve())
    names = chain((path_text(path), whole), (f"{whole} ({number})" for number in count(2)))
    return next(name for name in names if name not in taken)
