"""Sweeps of a run with their flows, for pictures: as the run wrote them, or estimated again."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.core.flow_columns import FLOW_NAMES
from mnsf_ros.drawing.example_pictures import Again, PicturedExample, PicturedFlow
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import (
    ERROR_TOPIC,
    FLOW_TOPIC,
    TRUTH_TOPIC,
    folder_name,
)
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.methods import make_method
from mnsf_ros.recording.bag_reader import BagReader
from msg_utils.point_cloud2 import decode_points

# Tracks settle in that time, and it has the sweeps of 0.6 s ago, which slow movers show in.
_LEAST_BEFORE: Final = 8
# What happened longer ago plays hardly any part.
_MOST_BEFORE: Final = 30


class TimeBudget:
    """Counts from its making on; `known_s`: method to the seconds of one estimate so far."""

    def __init__(
        self, limit_s: float = math.inf, known_s: Mapping[str, float] | None = None
    ) -> None:
        self.limit_s = limit_s
        self._deadline_s = time.monotonic() + limit_s
        self._known_s = {k: s for k, s in (known_s or {}).items() if math.isfinite(s)}

    @property
    def left_s(self) -> float:
        """Seconds that are left."""
        return self._deadline_s - time.monotonic()

    def needs_s(self, method: str) -> float:
        """Seconds that one more estimate may take."""
        return self._known_s.get(method, 0.0)

    def allows(self, method: str) -> bool:
        """Whether one more estimate of this method should get ready in time."""
        return self.needs_s(method) < self.left_s

    @contextmanager
    def estimate(self, method: str) -> Iterator[None]:
        """Learns from an estimate how long the next one may take."""
        start_s = time.monotonic()
        yield
        self._known_s[method] = max(time.monotonic() - start_s, self.needs_s(method))


def recorded_examples(
    run_folder: Path, rows: Sequence[ResultRow], methods: Sequence[str]
) -> list[PicturedExample]:
    """Returns the examples of rows, in their order, whose flow by any of the methods was written.

    That is what `mnsf evaluate --write-flow` does.
    """
    examples: dict[tuple[str, int], PicturedExample] = {}
    for method in methods:
        for row in rows:
            folder = run_folder / "flow" / folder_name(row.recording, method)
            # A run that was interrupted has some of them; pictures of those are better than none.
            with suppress(MnsfError, OSError):
                _add_recorded(examples, row, method, folder)
    return [examples[_key(row)] for row in rows if _key(row) in examples]


def _add_recorded(
    examples: dict[tuple[str, int], PicturedExample], row: ResultRow, method: str, folder: Path
) -> None:
    with BagReader(folder) as reader:
        clouds = {topic: _cloud(reader, topic, row.stamp_ns) for topic in reader.topics}
    cloud = clouds.get(FLOW_TOPIC)
    if cloud is None:
        return
    truth, error = clouds.get(TRUTH_TOPIC), clouds.get(ERROR_TOPIC)
    errors_m = np.full(len(cloud), np.nan) if error is None else error["error_m"].astype(float)
    example = PicturedExample(
        row.recording,
        row.number,
        row.stamp_ns,
        xyz=_columns(cloud, ("x", "y", "z")),
        truth=None if truth is None else _columns(truth, FLOW_NAMES),
    )
    example = examples.setdefault(_key(row), example)
    # Clouds of another size belong to another run, and their rows to other points.
    if len(cloud) == len(example.xyz):
        example.flows.append(PicturedFlow(method, _columns(cloud, FLOW_NAMES), errors_m))


def _cloud(reader: BagReader, topic: str, stamp_ns: int) -> NDArray[np.void] | None:
    messages = reader.messages(topic, start_ns=stamp_ns, stop_ns=stamp_ns + 1)
    message = next(iter(messages), None)
    return None if message is None else decode_points(message).ravel()


def _columns(points: NDArray[np.void], names: Sequence[str]) -> NDArray[np.float32]:
    return np.stack([points[name].astype(np.float32) for name in names], axis=1)


def num_estimates(
    record: RunRecord, rows: Sequence[ResultRow], methods: Sequence[str], budget: TimeBudget
) -> dict[str, int]:
    """Returns method to how many estimates pictures of these rows take, with those before them."""
    num_before = _num_before(record, rows, methods, budget)
    carrying = _carrying(record, methods)
    return {
        method: len(
            {
                (row.recording, number)
                for row in rows
                for number in range(row.number - num_before * (method in carrying), row.number + 1)
                if number >= 0
            }
        )
        for method in methods
    }


def estimated_examples(
    record: RunRecord, rows: Sequence[ResultRow], methods: Sequence[str], budget: TimeBudget
) -> list[PicturedExample]:
    """Returns the examples of rows, in their order, with flows that are estimated for them.

    Methods that carry something from one example to the next estimate the ones before them, too,
    so that the flow is that of the run. The most important method comes first; those that fail on
    an example are left out of it. The budget is kept but for the estimate that is under way when
    it ends.

    Raises:
        MnsfError: A recording cannot be read any more.
    """
    options, stretches = record.options, []
    num_before = _num_before(record, rows, methods, budget)
    for recording in record.recordings:
        wanted = {row.number for row in rows if row.recording == recording.name}
        stretches += _stretches(recording, options, wanted, num_before, budget)
    wanted_keys = {_key(row) for row in rows}
    pictures = {
        _key(example): _pictured(example)
        for stretch in stretches
        for example in stretch
        if _key(example) in wanted_keys
    }
    for method in methods:
        for stretch in stretches:
            # Methods are other people's code, too: a bug in one costs its own pictures only.
            with suppress(Exception):
                _add_estimated(pictures, stretch, method, options, budget)
    found = [pictures[_key(row)] for row in rows if _key(row) in pictures]
    return [picture for picture in found if picture.flows]


def _carrying(record: RunRecord, methods: Sequence[str]) -> frozenset[str]:
    known = frozenset(one.name for one in record.methods if one.traits.carries_state)
    return known.intersection(methods)


def _num_before(
    record: RunRecord, rows: Sequence[ResultRow], methods: Sequence[str], budget: TimeBudget
) -> int:
    """How many examples before each one methods that carry state estimate: as time allows."""
    carrying = _carrying(record, methods)
    if not carrying:
        return 0
    one_s = len(rows) * sum(map(budget.needs_s, carrying))
    affordable = budget.limit_s / one_s - 1 if one_s > 0 else math.inf
    return int(min(max(affordable, _LEAST_BEFORE), _MOST_BEFORE))


def _stretches(
    recording: EvaluatedRecording,
    options: EvaluationOptions,
    wanted: set[int],
    num_before: int,
    budget: TimeBudget,
) -> list[list[Example]]:
    """The wanted examples, each behind so many ones before it; without a gap in a list."""
    stretches: list[list[Example]] = []
    if not wanted:
        return stretches
    recent: deque[Example] = deque(maxlen=num_before + 1)
    with recording.open() as reader:
        for example in read_examples(reader, recording, options, Findings()):
            recent.append(example)
            if example.number in wanted:
                # Nothing was pushed out since the last wanted one: one list goes on.
                if stretches and len(recent) <= num_before:
                    stretches[-1] += recent
                else:
                    stretches.append([*recent])
                recent.clear()
            if example.number >= max(wanted) or budget.left_s <= 0:
                break
    return stretches


def _add_estimated(
    pictures: Mapping[tuple[str, int], PicturedExample],
    stretch: Sequence[Example],
    method: str,
    options: EvaluationOptions,
    budget: TimeBudget,
) -> None:
    """Adds the flow of a method to the pictures of a stretch."""
    estimator, num_before = make_method(method, options.settings), 0
    carries_state = estimator.traits.carries_state
    for example in stretch:
        picture = pictures.get(_key(example))
        if picture is None and not carries_state:
            continue
        if not budget.allows(method):
            return
        with suppress(Exception), budget.estimate(method):
            flow = estimator.estimate(example.triplet).flow
            if picture is not None:
                flow = flow[example.scored]
                errors_m = _errors(example, picture, flow)
                found = PicturedFlow(method, flow, errors_m, Again(num_before))
                picture.flows.append(found)
        num_before += carries_state


def _pictured(example: Example) -> PicturedExample:
    true_flow = None
    if example.truth is not None:
        truth = example.truth.of_points(np.flatnonzero(example.scored))
        true_flow = np.where(truth.valid[:, None], truth.flow, np.float32(np.nan))
    return PicturedExample(
        recording=example.recording,
        number=example.number,
        stamp_ns=example.triplet.current.stamp_ns,
        xyz=example.triplet.current.kept_xyz,
        truth=true_flow,
        next_from_current=example.triplet.next_from_current,
        error_name="distance to next sweep" if true_flow is None else "end point error",
    )


def _errors(
    example: Example, picture: PicturedExample, flow: NDArray[np.float32]
) -> NDArray[np.float64]:
    """The errors (M,) of the flow (M, 3) of the scored points."""
    if picture.truth is not None:
        return end_point_errors(flow, picture.truth)
    answered = np.isfinite(flow).all(axis=1)
    distances = np.full(len(flow), np.nan)
    tree = cKDTree(example.triplet.next.kept_xyz)
    distances[answered], _ = tree.query(picture.xyz[answered] + flow[answered])
    return distances


def _key(one: ResultRow | Example) -> tuple[str, int]:
    return one.recording, one.number
