"""The examples of a study: of recordings, or of a street that is simulated for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import (
    EvaluatedRecording,
    EvaluationOptions,
    EvaluationTask,
    choose_topics,
)
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.run_start import recording_names
from mnsf_ros.evaluation.runner import Executor, TaskEvent, TaskRun, run_serially, task_events
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.studies.study import StudyOptions

# A lidar of medium density: a few thousand points without ground, as the paper's smaller table.
_BEAMS, _COLUMNS = 32, 1024
# Where a street is simulated it has so many, unless the user says how many.
_SIMULATED_EXAMPLES = 4


def study_recordings(options: StudyOptions, num_sweeps: int = 3) -> list[EvaluatedRecording]:
    """Returns the recordings of a study; without any, writes a simulated one into its folder.

    Args:
        options: Which.
        num_sweeps: Sweeps that an example needs.

    Raises:
        RecordingError: A recording cannot be used, is too short, or the simulated one cannot be
            written.
    """
    paths = options.recordings
    if not paths:
        street = options.out / "street"
        if not street.exists():
            options.say("simulating a street")
            write_recording(_simulation(options, num_sweeps), street)
        paths = (street,)
    recordings = [
        choose_topics(inspect_recording(path), name)
        for path, name in zip(paths, recording_names(paths), strict=True)
    ]
    for path, recording in zip(paths, recordings, strict=True):
        if recording.num_sweeps < num_sweeps:
            raise RecordingError(
                f"{path}: has {recording.num_sweeps} sweeps, the study needs {num_sweeps}"
            )
    return recordings


def study_examples(options: StudyOptions, num_sweeps: int = 3) -> Iterator[Example]:
    """Yields the examples of a study.

    Raises:
        RecordingError: A recording cannot be used.
    """
    for recording in study_recordings(options, num_sweeps):
        with recording.inspection.open() as reader:
            evaluation = options.evaluation(num_sweeps)
            examples = read_examples(reader, recording, evaluation, Findings())
            yield from islice(examples, options.max_examples)


def first_example(options: StudyOptions) -> Example:
    """Returns the first example of a study.

    Raises:
        RecordingError: There is none.
    """
    for example in study_examples(options):
        return example
    raise RecordingError("the recordings hold no three sweeps in a row")


def _simulation(options: StudyOptions, num_sweeps: int) -> SimulationSettings:
    usual = SimulationSettings()
    num_examples = options.max_examples or _SIMULATED_EXAMPLES
    return SimulationSettings(
        seed=options.seed,
        # An example lies between the sweeps before it and the one after.
        duration_s=(num_examples + num_sweeps - 1) * usual.interval_s,
        num_beams=_BEAMS,
        num_columns=_COLUMNS,
    )


def first_examples(number: int | None) -> Executor:
    """Returns an Executor that runs tasks one after the other, each only to so many examples."""
    if number is None:
        return run_serially

    def execute(
        runs: Sequence[TaskRun], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        for run in runs:
            num_left = number - len(run.skipped)
            events = task_events(run, options) if num_left > 0 else iter([Findings()])
            for event in events:
                yield run.task, event
                num_left -= isinstance(event, ResultRow)
                if isinstance(event, ResultRow) and num_left == 0:
                    yield run.task, Findings()
                    break

    return execute
