"""Tasks side by side on this machine, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final

from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.runner import (
    TaskEvent,
    TaskFailed,
    TaskRestarted,
    task_events,
)

MAX_ATTEMPTS: Final = 3
_DYING_S: Final = 5.0
# torch imports the second one when the first optimizer is made.
_SLOW_IMPORTS: Final = (task_events.__module__, "torch._dynamo")


class WorkerProcesses:
    """Runs tasks in processes; one that dies is replaced. An Executor."""

    def __init__(self, num_workers: int) -> None:
        """Says how many processes there are at a time."""
        self._num_workers = num_workers

    def __call__(
        self, tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready."""
        waiting = deque(tasks)
        working: dict[Any, _Worker] = {}
        try:
            while waiting or working:
                while waiting and len(working) < self._num_workers:
                    worker = _Worker.started(waiting.popleft(), options)
                    working[worker.events] = worker
                for events in wait(list(working)):
                    worker = working[events]
                    event = worker.next_event()
                    if event is None:
                        del working[events]
                        event = worker.end(options, waiting)
                    if event is not None:
                        yield worker.task, event
        finally:
            for worker in working.values():
                worker.stop()


@dataclass(eq=False)
class _Worker:
    """A process that runs one task."""

    task: EvaluationTask
    process: BaseProcess
    events: Connection
    done: set[int] = field(default_factory=set)
    is_complete: bool = False

    @classmethod
    def started(cls, task: EvaluationTask, options: EvaluationOptions) -> _Worker:
        # Not fork: torch and CUDA do not survive it. The server has imported all that is slow,
        # and done nothing else, so that its children begin at once.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_SLOW_IMPORTS))
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(sender, task, options), daemon=True)
        process.start()
        # The end of the pipe is seen only when nobody else could write to it.
        sender.close()
        return cls(task, process, receiver)

    def next_event(self) -> TaskEvent | None:
        """The next event, or None if there will be none."""
        try:
            event: TaskEvent = self.events.recv()
        except (EOFError, OSError):
            return None
        if isinstance(event, ResultRow):
            self.done.add(event.number)
        self.is_complete = self.is_complete or isinstance(event, (Findings, TaskFailed))
        return event

    def end(self, options: EvaluationOptions, waiting: deque[EvaluationTask]) -> TaskEvent | None:
        """Puts the process away; a task that is not complete is tried again, or given up."""
        # What dies by itself has a status to be told.
        self.process.join(timeout=_DYING_S)
        self.stop()
        if self.is_complete:
            return None
        reason = f"its process ended with status {self.process.exitcode}"
        if self.task.attempt + 1 >= MAX_ATTEMPTS:
            return TaskFailed(f"{reason}, {MAX_ATTEMPTS} times")
        waiting.append(self.task.again(self.done, options))
        return TaskRestarted(reason)

    def stop(self) -> None:
        """Ends the process if it still runs."""
        self.events.close()
        if self.process.is_alive():
            self.process.terminate()
            self.process.join(timeout=_DYING_S)
        if self.process.is_alive():
            self.process.kill()
        self.process.join()


def _work(events: Connection, task: EvaluationTask, options: EvaluationOptions) -> None:
    # Ctrl-C goes to all processes of the terminal; the parent ends this one when it is time, and
    # then what is half written is to be taken away.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for event in task_events(task, options):
            events.send(event)
    except (BrokenPipeError, KeyboardInterrupt):
        return
    finally:
        events.close()
