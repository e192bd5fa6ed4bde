"""Starting a run in a new folder, or going on in one that is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluatedRecording, EvaluationOptions
from mnsf_ros.evaluation.run_folder import RunFolder, WritingError
from mnsf_ros.evaluation.run_record import identity, recording_record, session_record

# What must be the same when a run goes on; paths may move. Runs of earlier versions have no
# fingerprint.
_SAME = ("points", "truth", "odometry", "num_sweeps", "fingerprint")
# Another preset changes dozens of settings; a few of them say as much.
_MAX_TOLD = 5


def start_or_resume(
    out: Path,
    recordings: Sequence[EvaluatedRecording],
    methods: Sequence[str],
    options: EvaluationOptions,
    *,
    resume: bool,
    arguments: Sequence[str] = (),
) -> RunFolder:
    """Makes the folder of a run, or takes the one that is there if its rows fit.

    Args:
        out: The folder.
        recordings: What is evaluated; a resumed run may have more of them.
        methods: With what; likewise.
        options: How.
        resume: Whether to go on with a run that is there.
        arguments: The command line, to be remembered.

    Raises:
        EvaluationError: The folder holds something and `resume` is not set; or it holds a run
            with other settings or another recording of the same name, which `resume` must not mix
            with this one; or another process is at it.
        WritingError: The record of the run cannot be written.
    """
    check_folder(out, resume=resume)
    folder = RunFolder(out)
    run: dict[str, Any] = {"identity": identity(options), "methods": [], "recordings": []}
    is_there = _holds_something(out)
    if is_there:
        run = folder.read_run()
        _check_identity(out, run.get("identity", {}), identity(options))
    out.mkdir(parents=True, exist_ok=True)
    # Not while another process adds rows: they would be lost.
    with folder.locked():
        if is_there:
            folder.cut_off_unfinished_lines()
        _add_recordings(out, run, recordings)
        run["methods"] += [method for method in methods if method not in run["methods"]]
        run.setdefault("sessions", []).append(session_record(arguments))
        try:
            folder.write_run(run)
        except WritingError:
            if not is_there:
                folder.remove_if_unused()
            raise
    return folder


def known_recordings(out: Path) -> list[dict[str, Any]]:
    """Returns the records of the recordings that the run in a folder has, if there is one.

    Raises:
        EvaluationError: The folder holds something, but no run that can be read.
    """
    recordings = RunFolder(out).read_run().get("recordings", []) if _holds_something(out) else []
    return list(recordings)


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


def _check_identity(out: Path, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    differences = _differences(old, new)
    if differences:
        listed = "; ".join(differences[:_MAX_TOLD])
        more = len(differences) - _MAX_TOLD
        end = f"; and {more} more" if more > 0 else ""
        raise EvaluationError(f"{out}: holds a run with other settings: {listed}{end}")


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


def _add_recordings(
    out: Path, run: dict[str, Any], recordings: Sequence[EvaluatedRecording]
) -> None:
    known = {recording["name"]: recording for recording in run["recordings"]}
    for record in map(recording_record, recordings):
        before = known.get(record["name"])
        if before is None:
            run["recordings"].append(record)
            continue
        same = [name for name in _SAME if name in before]
        differences = _differences(
            {name: before[name] for name in same}, {name: record[name] for name in same}
        )
        if differences:
            listed = "; ".join(differences)
            raise EvaluationError(f"{out}: holds another recording {record['name']!r}: {listed}")
        # Where it lies now, and what of it could not be read, now or then.
        damages = list(dict.fromkeys([*before["damages"], *record["damages"]]))
        has_checksums = before["has_checksums"] and record["has_checksums"]
        before.update({**record, "damages": damages, "has_checksums": has_checksums})
